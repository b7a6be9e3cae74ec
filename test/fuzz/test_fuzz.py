"""Hostile inputs leave the drill as it is; `make fuzz` sends many more."""

import random

import pytest

from fuzz import campaign
from fuzz.drill import Drill
from fuzz.inputs import WAYS
from fuzz.tally import Tally

pytestmark = pytest.mark.extended

INPUTS = 3000
NEVER_REFUSED = {
    *("get_parameters", "get_parameter_types", "describe_parameters", "list_parameters"),
    *("list_faults", "simulation/get_state", "simulation/get_delivery", "engage"),
}


@pytest.fixture(scope="module")
def drill(tmp_path_factory):
    made = Drill(tmp_path_factory.mktemp("fuzz"))
    yield made
    made.close()


def test_hostile_inputs_are_refused_with_a_reason_and_harm_nothing(drill):
    outcome = campaign.run(drill, INPUTS, seed=0)
    assert outcome.harms == []
    for way, tally in outcome.tallies.items():
        assert tally.inputs > 0, way
        if tally.inputs > 10:
            assert (tally.refused > 0) == (way not in NEVER_REFUSED), way


def paused(drill):
    drill.do(lambda live: live.pause())
    return "so to say"


@pytest.mark.parametrize(
    ("way", "harm"),
    [
        (lambda drill: 1 / 0, "ZeroDivisionError: division by zero"),
        (lambda drill: "", "the reason is not one line: ''"),
        (lambda drill: "one\ntwo", "the reason is not one line: 'one\\ntwo'"),
        (paused, "refused, so to say, but the state has changed"),
    ],
)
def test_what_harms_is_found(drill, monkeypatch, way, harm):
    monkeypatch.setattr(campaign, "WAYS", {"way": lambda random, drill: way(drill)})
    (found,) = campaign.send(random.Random(0), drill, "way", Tally())
    drill.restore()
    assert harm in found


def test_a_command_that_is_refused_but_not_counted_is_found(drill, monkeypatch):
    monkeypatch.setattr(
        drill.node._inbox, "refuse", lambda result, reason: drill.reasons.append(reason)
    )

    def send(inputs):
        for number in range(inputs):
            WAYS["command/weight_on_bit"](random.Random(number), drill)

    with pytest.raises(AssertionError, match="counted 0"):
        send(100)
