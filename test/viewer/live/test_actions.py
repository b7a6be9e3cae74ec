"""Queue of actions before any of them reaches a drill; test_live_drill.py has the rest."""

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.watch.actions import Actions


@pytest.mark.parametrize("name", ["close", "set_parameters", "__init__", "node"])
def test_nothing_but_actions_of_the_drill_can_be_called(name):
    with pytest.raises(ParameterError, match="unknown"):
        Actions().add(name, {})


@pytest.mark.parametrize("arguments", [{}, {"weight": 3.0}, {"force": 1.0, "self": 2}])
def test_arguments_that_an_action_has_not_are_refused(arguments):
    with pytest.raises(ParameterError, match="action press"):
        Actions().add("press", arguments)


def test_more_actions_than_can_wait_fail_at_once():
    actions = Actions()
    for _ in range(33):
        actions.add("pause", {})
    states = [outcome.state for outcome in actions.outcomes]
    assert states == ["waiting"] * 32 + ["failed"]
    actions.fail_all("no drill")
    assert {outcome.text for outcome in actions.outcomes} <= {"no drill", "32 actions wait already"}
    assert len(actions.outcomes) == 20
