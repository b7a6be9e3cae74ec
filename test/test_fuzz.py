"""Short campaigns of the fuzzer, which finds what harms; `make fuzz` runs long ones."""

import multiprocessing
from concurrent.futures import ProcessPoolExecutor

import pytest

from tools.fuzz import bag_campaign, campaign
from tools.fuzz.drill import Drill

pytestmark = pytest.mark.extended

NEVER_REFUSED = {
    *("get_parameters", "get_parameter_types", "describe_parameters", "list_parameters"),
    *("list_faults", "get_journal", "simulation/get_state", "simulation/get_delivery", "engage"),
}


@pytest.fixture(scope="module")
def drill(tmp_path_factory):
    made = Drill(tmp_path_factory.mktemp("fuzz"))
    yield made
    made.close()


def test_hostile_inputs_are_refused_with_a_reason_and_harm_nothing(drill):
    outcome = campaign.run(drill, 3000, seed=0)
    assert outcome.harms == []
    for way, tally in outcome.tallies.items():
        assert tally.inputs > 0, way
        if tally.inputs > 10:
            assert (tally.refused > 0) == (way not in NEVER_REFUSED), way


def test_hostile_bags_are_read_or_refused_in_one_line():
    # In a process without threads: the workers of a campaign are forked.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        outcome = pool.submit(bag_campaign.run, 400, 0).result()
    assert outcome.harms == []
    for way, tally in outcome.tallies.items():
        assert 0 < tally.refused < tally.inputs, way
