"""Campaign files: the plan of all runs, and every error with its line and a hint."""

import re
import sys
from pathlib import Path

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.campaign_file import read_campaign

ROOT = Path(__file__).resolve().parents[3]
CAMPAIGN = """\
requirements:
  SAFE-1: The arm feels no more than 100 N.
system:
  command: python supervisor.py --ros-args -r __ns:=/rpud
  answers: [command/weight_on_bit]
  subscribes_to: [reacting_force]
drill: {regime: drilling, drive_enabled: true}
duration: 2.0
seeds: [1, 2]
scenarios:
  nominal: {}
  noisy:
    faults: faults.yaml
  jammed:
    duration: 3.0
    faults:
      - {kind: free_mass_jammed, onset: 1.0}
      - {kind: off, channel: wrench, onset: 2.0}
parameters:
  free_mass: [0.004, 0.005, 0.006]
expectations:
  - name: force
    requirement: SAFE-1
    expect: {always: reacting_force.force < 100 N}
"""
FAULTS = "faults: [{kind: noise, channel: wrench, magnitude: 0.5, onset: 1.0}]\n"


def read(folder, text=CAMPAIGN):
    (folder / "supervisor.py").write_text("")
    (folder / "faults.yaml").write_text(FAULTS)
    (folder / "campaign.yaml").write_text(text)
    return read_campaign(folder / "campaign.yaml")


def test_the_plan_has_every_combination_once(tmp_path):
    campaign = read(tmp_path)
    assert len(campaign.runs) == 3 * 3 * 2
    assert campaign.runs[0].name == "nominal free_mass=0.004 seed=1"
    assert len({run.name for run in campaign.runs}) == len(campaign.runs)
    scenarios = dict.fromkeys((run.scenario, run.faults, run.duration) for run in campaign.runs)
    assert list(scenarios) == [
        ("nominal", (), 2.0),
        ("noisy", ("noise on wrench",), 2.0),
        ("jammed", ("free_mass_jammed", "off on wrench"), 3.0),
    ]
    assert campaign.runs[0].setup.parameters == {
        "regime": "drilling",
        "drive_enabled": True,
        "free_mass": 0.004,
    }
    assert campaign.name == "campaign"
    assert campaign.system.words[0] == sys.executable


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("seeds:", "seads:", 9, "'seads' is not a key here; did you mean seeds?"),
        ("seeds: [1, 2]", "seeds: [1, 1]", 9, ".* has a value twice"),
        ("supervisor.py", "supervisr.py", 4, "is not a file: .*; did you mean supervisor.py?"),
        ("python supervisor.py", "pyhton supervisor.py", 4, "no program 'pyhton' on the PATH"),
        ("weight_on_bit]", "weight_on_bitt]", 5, "did you mean command/weight_on_bit?"),
        ("[command/weight_on_bit]", "[status]", 5, "is a topic of the drill itself"),
        ("[command/weight_on_bit]", "[]", 5, "answers = [] has 0 entries"),
        ("drive_enabled: true", "start_paused: true", 7, "runs in lockstep"),
        ("drive_enabled: true", "seed: 3", 7, "seed cannot be set here: give seeds"),
        ("faults.yaml", "fault.yaml", 13, "did you mean faults.yaml?"),
        ("free_mass: [", "free_mas: [", 20, "did you mean free_mass?"),
        ("[0.004, 0.005, 0.006]", "0.004", 20, "free_mass = 0.004 is not a list"),
        ("requirement: SAFE-1", "requirement: SAVE-1", 23, "did you mean SAFE-1?"),
        ("reacting_force.force", "reacting.force", 24, "did you mean reacting_force?"),
        ("command: python", "launch: x.py\n  command: python", 3, "either command or launch"),
        ("duration: 2.0\n", "", 1, "duration is missing"),
    ],
)
def test_a_mistake_is_one_line_with_its_place_and_a_hint(tmp_path, old, new, line, words):
    assert old in CAMPAIGN
    with pytest.raises(ParameterError) as caught:
        read(tmp_path, CAMPAIGN.replace(old, new, 1))
    text = str(caught.value)
    assert text.startswith(f"{tmp_path / 'campaign.yaml'}:{line}: "), text
    assert re.search(re.escape(words).replace(r"\.\*", ".*"), text), text
    assert "\n" not in text


def test_a_file_of_expectations_is_read_with_its_own_lines(tmp_path):
    campaign, keyword, entries = CAMPAIGN.partition("expectations:")
    text = f"{campaign}expectations: expect.yaml\n"
    (tmp_path / "expect.yaml").write_text(keyword + entries)
    assert len(read(tmp_path, text).expectations) == 1
    (tmp_path / "expect.yaml").write_text(keyword + entries.replace("force.force", "force.forze"))
    with pytest.raises(ParameterError, match=r"expect\.yaml:4: .*did you mean force\?"):
        read(tmp_path, text)


def test_the_example_can_be_used():
    campaign = read_campaign(ROOT / "config" / "campaign.yaml")
    assert {each.requirement for each in campaign.expectations} == set(campaign.requirements)
