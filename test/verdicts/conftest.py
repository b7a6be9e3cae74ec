"""A bag of a drill with faults, for all tests of verdicts."""

import pytest
from random_expectations import TOPICS, messages_of
from sample_bags import write_offline_bag

from rpud_sim.simulation import preset
from rpud_sim.simulation.scenario_file import parse_scenario

FAULTS = [
    {"kind": "bias", "channel": "reacting_force", "magnitude": 20.0, "onset": 0.3, "duration": 0.1},
    {"kind": "free_mass_jammed", "onset": 0.6, "duration": 0.5},
    {"kind": "off", "channel": "contact_force", "onset": 1.3, "duration": 0.1},
    {"kind": "garbage", "channel": "wrench", "onset": 0.0, "duration": 0.05},
]


@pytest.fixture(scope="session")
def faulty_bag(tmp_path_factory):
    """Return the bag of a run of 1.5 s with faults."""
    path = tmp_path_factory.mktemp("verdicts") / "bag"
    scenario = parse_scenario({"faults": FAULTS}, "test")
    write_offline_bag(path, preset("drilling"), 1.5, scenario=scenario)
    return path


@pytest.fixture(scope="session")
def faulty_messages(faulty_bag):
    """Return its messages as a subscriber has them: topic, stamp and message."""
    return messages_of(faulty_bag, TOPICS)
