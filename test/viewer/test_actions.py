"""Queue of actions before any of them reaches a drill; test_live_drill.py has the rest."""

from types import SimpleNamespace

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.viewer.commands import plain_refusal
from rpud_sim.viewer.live import Actions


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
    assert [outcome["text"] for outcome in actions.outcomes] == ["32 actions wait already"]
    actions.fail_all("no drill")
    assert [outcome["number"] for outcome in actions.outcomes] == [*range(26, 34)]
    assert {(each["state"], each["text"]) for each in actions.outcomes} == {("failed", "no drill")}


def test_an_action_that_waited_too_long_is_not_carried_out(monkeypatch):
    actions, clock, done = Actions(), [0.0], []
    monkeypatch.setattr("rpud_sim.viewer.live.time.monotonic", lambda: clock[0])
    drill = SimpleNamespace(press=lambda force: done.append(force))
    actions.add("press", {"force": 1.0})
    clock[0] = 2.0
    actions.add("press", {"force": 2.0})
    assert actions.execute(drill)
    actions.add("press", {"force": 3.0})
    clock[0] = 5.1
    assert actions.execute(drill)
    assert [each["text"] for each in actions.outcomes] == ["", "expired: it waited for 3 s"]
    assert done == [1.0]
    monkeypatch.undo()


@pytest.mark.parametrize(
    ("reason", "text"),
    [
        ("drive_voltage = 9999 V is outside its range [0, 200] V", "9999 V is above 200 V"),
        ("weight_on_bit = -5 N is outside its range [0, 1000] N", "-5 N is below 0 N"),
        ("torque = 1e+06 N m is outside its range (0, 20] N m", "1e+06 N m is above 20 N m"),
        ("share = 3 is outside its range [0, 1]", "3 is above 1"),
        ("seconds = 0 s is outside its range (0, 1000] s",) * 2,
        ("mass = nan kg is outside its range (0, 100] kg",) * 2,
        ("it is playing, not paused, as after `rpud pause`",) * 2,
    ],
)
def test_a_refusal_is_said_in_few_words(reason, text):
    assert plain_refusal(reason) == text
