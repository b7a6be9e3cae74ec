"""Short campaigns of the fuzzer, which finds what harms; `make fuzz` runs long ones."""

import multiprocessing
import random
from concurrent.futures import ProcessPoolExecutor

import pytest

from tools.fuzz import bag_campaign, campaign
from tools.fuzz.drill import Drill
from tools.fuzz.tally import Tally

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


@pytest.mark.parametrize(
    ("way", "harm"),
    [
        (lambda drill: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda drill: "one\ntwo", "the reason is not one line: 'one\\ntwo'"),
        (
            lambda drill: drill.do(lambda live: live.timeline.pause()) or "no",
            "but the state has changed",
        ),
    ],
)
def test_an_input_that_harms_is_found(drill, monkeypatch, way, harm):
    monkeypatch.setattr(campaign, "WAYS", {"way": lambda random, drill: way(drill)})
    (found,) = campaign.send(random.Random(0), drill, "way", Tally())
    drill.restore()
    assert harm in found


def test_hostile_bags_are_read_or_refused_in_one_line():
    # In a process without threads: the workers of a campaign are forked.
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as pool:
        outcome = pool.submit(bag_campaign.run, 400, 0).result()
    assert outcome.harms == []
    for way, tally in outcome.tallies.items():
        assert 0 < tally.refused < tally.inputs, way
