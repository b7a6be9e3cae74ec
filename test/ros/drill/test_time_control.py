"""Time plays, is paused, stopped or stepped; a step ends at its goal or by an error."""

import pytest

from rpud_sim.ros.drill.time_control import InterruptedStepError, TimeControl

PLAY, PAUSE, STOP = TimeControl.play, TimeControl.pause, TimeControl.stop


@pytest.mark.parametrize(
    ("changes", "playing", "at_start", "state"),
    [
        ((), False, False, "paused"),
        ((PLAY,), True, False, "running"),
        ((PLAY, PAUSE), False, False, "paused"),
        ((PLAY, STOP), False, True, "stopped"),
        ((STOP, PAUSE), False, False, "paused"),
        ((STOP, PLAY), True, False, "running"),
    ],
)
def test_the_state_is_that_of_the_last_change(changes, playing, at_start, state):
    control = TimeControl()
    for change in changes:
        change(control)
    assert (control.playing, control.at_start, control.state) == (playing, at_start, state)
    assert (control.stepping, control.goal) == (False, None)


def test_a_step_runs_until_its_goal_and_the_result_is_for_the_caller_to_set():
    control = TimeControl()
    step = control.step(30)
    assert (control.stepping, control.goal, control.state) == (True, 30, "running")
    assert not control.playing
    assert control.complete_step(29) is None
    assert control.complete_step(30) is step
    assert not step.done()
    assert (control.stepping, control.state) == (False, "paused")
    assert control.complete_step(31) is None


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (PLAY, "the simulation was set to play"),
        (PAUSE, "the simulation was paused"),
        (STOP, "the simulation was stopped"),
        (lambda control: control.interrupt("the drill has stopped"), "the drill has stopped"),
    ],
)
def test_whatever_comes_before_the_goal_interrupts_a_step(change, reason):
    control = TimeControl()
    step = control.step(30)
    change(control)
    with pytest.raises(InterruptedStepError, match=f"^{reason}$"):
        step.result(0.0)
    assert not control.stepping
    control.interrupt("nothing is under way any more")


def test_a_step_after_an_interrupted_one_is_another():
    control = TimeControl()
    first = control.step(30)
    control.pause()
    second = control.step(40)
    assert control.complete_step(40) is second
    assert first is not second
