"""Time plays, is paused, stopped or stepped; a step ends at its goal or by an error."""

import dataclasses
import threading

import pytest
import rclpy
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.commands import Inbox, result_of
from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes
from rpud_sim.ros.drill.live_run import InterruptedStepError, LiveRun
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings

SECOND = 1_000_000_000
GOAL = SECOND // 100
PLAY, PAUSE, HALT = LiveRun.play, LiveRun.pause, LiveRun.halt


@pytest.fixture
def make(nodes):
    made = []

    def create(use_sim_time=False, **values):
        overrides = [Parameter("use_sim_time", value=use_sim_time)]
        node = rclpy.create_node("drill_node", namespace="/rpud", parameter_overrides=overrides)
        nodes.append(node)
        inbox, restored = Inbox(node.get_logger()), []
        live = LiveRun(node, Settings(**values), inbox, DuplicateNodes(node), restored.append)
        live.node, live.inbox, live.restored = node, inbox, restored
        live.begin(live.settings)
        made.append(live)
        return live

    yield create
    for live in made:
        live.close()


@pytest.fixture
def live(make):
    return make()


@pytest.fixture
def own_clock(make):
    return make(publish_clock=True)


def finish_step(live):
    while live.goal is not None:
        live.turn()


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
    live.activate(False)
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


def test_a_step_reports_at_every_second_of_its_own_time(live, monkeypatch):
    reported = []
    report = live.report
    monkeypatch.setattr(live, "report", lambda: reported.append(live.run.time) or report())
    live.reporter.end_period()  # however much time has elapsed
    live.step(5 * SECOND // 2)
    finish_step(live)
    assert reported == [SECOND, 2 * SECOND, 5 * SECOND // 2]


def test_commands_that_came_before_a_step_act_before_it_and_are_reported(live):
    live.inbox.accept(WeightOnBit(33.0), result_of("weight_on_bit"))
    live.step(GOAL)
    assert live.run.time == 0
    assert live.reporter.last.status["weight_on_bit"] == 33.0


def test_the_settings_of_the_run_come_back_with_it_but_for_its_pace(live):
    first, changed = live.settings, dataclasses.replace(live.settings, command_timeout=2.0)
    live.configure(changed)
    live.save("changed")
    live.reset(time=True, state=True)
    assert live.settings == live.restored[-1] == first
    live.configure(dataclasses.replace(first, real_time_factor=0.5))
    live.restore("changed")
    assert live.settings == live.restored[-1] == dataclasses.replace(changed, real_time_factor=0.5)


def test_a_reset_of_the_time_alone_goes_on_at_stamp_zero_where_the_drill_is_its_source(own_clock):
    own_clock.step(GOAL)
    finish_step(own_clock)
    assert own_clock.stamp == GOAL
    own_clock.reset(time=True, state=False)
    assert (own_clock.run.time, own_clock.stamp) == (GOAL, 0)
    own_clock.step(2 * GOAL)
    finish_step(own_clock)
    assert own_clock.stamp == GOAL
    own_clock.reset(time=False, state=True)
    assert (own_clock.run.time, own_clock.stamp) == (0, GOAL)


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
    with pytest.raises(InterruptedStepError, match=f"^interrupted: {reason}$"):
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


def test_a_drill_that_follows_a_clock_does_not_drift_from_it_when_its_settings_change(make):
    live = make(use_sim_time=True)
    clock = live.node.get_clock()

    def tell(nanoseconds):
        clock.set_ros_time_override(Time(nanoseconds=nanoseconds, clock_type=ClockType.ROS_TIME))

    tell(7 * SECOND)
    live.start_time(threading.Event(), lambda: None)
    assert (live.follows_clock, live.playing, live.stamp) == (True, True, 7 * SECOND)
    tell(7 * SECOND + GOAL // 2)
    live.configure(dataclasses.replace(live.settings, real_time_factor=0.5))
    assert live.pacer.remaining(GOAL) == pytest.approx(GOAL / 2 / SECOND)
