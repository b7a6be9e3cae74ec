"""The scenario that a journal's beginning holds."""

import json

import pytest
import yaml

from rpud_sim.ros.record.parameter_query import scenario_text
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.plans import parse_scenario
from rpud_sim.simulation.run import Beginning

FAULTS = [
    {"kind": "lost_preload", "onset": 0.1, "duration": 0.7, "magnitude": 0.25},
    {"kind": "noise", "channel": "contact_force", "onset": {"uniform": [1.0, 2.0]}},
    {"kind": "free_mass_jammed", "onset": 5},
]


def content(faults):
    scenario = parse_scenario({"seed": 3, "faults": faults}, "x.yaml")
    beginning = Beginning(Settings(), seed=3, scenario=scenario)
    return scenario, JournalEntry(0, 0, "begin", beginning.to_journal()).text


def test_it_is_a_scenario_again_with_what_was_drawn():
    scenario, text = content(FAULTS)
    again = parse_scenario(yaml.safe_load(scenario_text(text)), "y.yaml")
    assert again.faults == scenario.faults


def test_without_a_fault_it_is_empty():
    assert scenario_text(content([])[1]) == ""


@pytest.mark.parametrize(
    "text",
    [
        "",
        "[]",
        "{}",
        '{"faults": 3}',
        '{"faults": [{}]}',
        "[" * 100_000,
        json.dumps({"faults": [1]}),
    ],
)
def test_what_is_none_is_refused(text):
    with pytest.raises(ValueError, match="no beginning of a journal"):
        scenario_text(text)
