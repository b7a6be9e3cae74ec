"""Time plays, is paused, stopped or stepped; a step ends at its goal or by an error."""

import pytest
import rclpy

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.live_run import InterruptedStepError, LiveRun
from rpud_sim.ros.drill.namesakes import DuplicateNodes
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.simulation.configuration import Settings

SECOND = 1_000_000_000
GOAL = SECOND // 100
PLAY, PAUSE, HALT = LiveRun.play, LiveRun.pause, LiveRun.halt


@pytest.fixture
def live():
    rclpy.init()
    node = rclpy.create_node("drill_node", namespace="/rpud")
    made = LiveRun(node, Settings(), Inbox(node.get_logger()), DuplicateNodes(node))
    made.begin(made.settings)
    yield made
    made.close()
    node.destroy_node()
    rclpy.try_shutdown()


def finish_step(live):
    loop = PacingLoop()
    while live.goal is not None:
        loop.turn(live)


@pytest.mark.parametrize(
    ("changes", "playing", "at_start", "state"),
    [
        ((), False, False, "paused"),
        ((PLAY,), True, False, "running"),
        ((PLAY, PAUSE), False, False, "paused"),
        ((PLAY, HALT), False, True, "stopped"),
        ((HALT, PAUSE), False, False, "paused"),
        ((HALT, PLAY), True, False, "running"),
    ],
)
def test_the_state_is_that_of_the_last_change(live, changes, playing, at_start, state):
    for change in changes:
        change(live)
    assert (live.playing, live.at_start, live.state) == (playing, at_start, state)
    assert live.goal is None


def test_without_commands_that_act_the_state_is_inactive(live):
    live.play()
    live.act(lambda run: run.control.activate(False))
    assert (live.state, live.reporter.last.status["state"]) == ("inactive", "inactive")


def test_a_step_runs_until_its_goal_and_its_status_comes_before_its_result(live, monkeypatch):
    step = live.step(GOAL)
    assert (live.goal, live.state, live.playing) == (GOAL, "running", False)
    reported = []
    report = live.report
    monkeypatch.setattr(
        live, "report", lambda: reported.append((live.state, step.done())) or report()
    )
    finish_step(live)
    assert reported == [("paused", False)]
    assert step.result(0.0).stamp == live.stamp == live.run.origin + GOAL


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (PLAY, "the simulation was set to play"),
        (PAUSE, "the simulation was paused"),
        (HALT, "the simulation was reset"),
        (lambda live: live.restore("here"), "a checkpoint was restored"),
        (lambda live: live.interrupt("the drill has stopped"), "the drill has stopped"),
    ],
)
def test_whatever_comes_before_the_goal_interrupts_a_step(live, change, reason):
    live.save("here")
    step = live.step(GOAL)
    change(live)
    with pytest.raises(InterruptedStepError, match=f"^{reason}$"):
        step.result(0.0)
    assert live.goal is None
    live.interrupt("nothing is under way any more")


def test_a_step_after_an_interrupted_one_is_another(live):
    first = live.step(GOAL)
    live.pause()
    second = live.step(2 * GOAL)
    finish_step(live)
    assert second.result(0.0).stamp == live.run.origin + 2 * GOAL
    assert first is not second


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (PLAY, "it is playing, not paused"),
        (HALT, "it is stopped, not paused"),
        (lambda live: live.step(GOAL), "it is stepping already, not paused"),
    ],
)
def test_only_a_paused_simulation_steps(live, change, reason):
    change(live)
    before = live.goal
    with pytest.raises(ParameterError, match=f"^{reason}$"):
        live.step(2 * GOAL)
    assert live.goal == before


@pytest.mark.parametrize("goal", [-1, 0, 10**15 + 1])
def test_a_step_goes_forward_and_not_too_far(live, goal):
    with pytest.raises(ParameterError, match=r"step = .* s is outside its range \(0, 1e\+06\] s"):
        live.step(goal)
    assert live.goal is None
