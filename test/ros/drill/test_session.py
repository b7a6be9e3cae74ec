"""Blocks are computed ahead and published at their deadlines; time plays, stands still or steps."""

import dataclasses
import threading
import time
from functools import partial
from types import SimpleNamespace

import pytest
import rclpy
from rclpy.clock import ClockType
from rclpy.parameter import Parameter
from rclpy.time import Time
from support import SECOND, ManualClock

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill import health, session
from rpud_sim.ros.drill.commands import Inbox, result_of
from rpud_sim.ros.drill.pacing_loop import take_turn
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.session import Session
from rpud_sim.ros.drill.timeline import Pacer
from rpud_sim.ros.threads import RequestError
from rpud_sim.simulation.changes import Inject, SetOrigin
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings, to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.topics import PROVED

NO_OTHERS = SimpleNamespace(count=lambda: 0)  # of the same name
MILLISECOND = 1_000_000
PERIOD = 10 * MILLISECOND
START = 17 * SECOND
HALT = Session.halt


def play(drill):
    drill.timeline.play()


def pause(drill):
    drill.timeline.pause()


class Publishers(DrillPublishers):
    """Publishers that note when a block is computed and when it is sent, by a clock."""

    def __init__(self, clock, *arguments):
        super().__init__(*arguments)
        self.clock = clock
        self.computed, self.sent_at, self.messages = [], [], []
        self.meanwhile = lambda: None

    def encode(self, entries):
        encoded = super().encode(entries)
        if any(name == "nodal_plane" for _, name, _ in encoded):
            self.computed.append(self.clock())
            self.meanwhile()  # what happens while a block is computed
        return encoded

    def _send(self, name, message):
        self.messages.append((name, message))
        if name == "nodal_plane":
            self.sent_at.append(self.clock())
        super()._send(name, message)

    def count(self, topic):
        return sum(name == topic for name, _ in self.messages)

    @property
    def streams(self):
        return [name for name, _ in self.messages if name in ("waveform", "trajectory")]


class Drill(Session):
    """A session with a pacer whose clock is moved by hand, without a thread."""

    def __init__(self, node, settings):
        self.clock, self.inbox, self.restored = ManualClock(START), Inbox(node.get_logger()), []
        super().__init__(node, settings, self.inbox, NO_OTHERS, self.restored.append)
        self.publishers.complete = True
        schedule = self.timeline.source.schedule
        self.timeline.pacer = Pacer(100, schedule, self.clock, self.clock.sleep)
        self.publishers.clock = self.clock
        self.begin(settings)

    def command(self, force):
        self.inbox.accept(WeightOnBit(force), result_of("weight_on_bit"))

    def go_on(self):
        """Do what is due, waiting for it as the thread does, and give the simulation time."""
        while (idle := take_turn(self)) > 0.0:
            self.clock.now += round(idle * SECOND)
        return self.run.time

    def finish_step(self):
        while self.timeline.goal is not None:
            take_turn(self)

    @property
    def weight_on_bit(self):
        return self.run.simulation.applied.weight_on_bit.force


@pytest.fixture
def make(nodes, monkeypatch):
    made = []
    monkeypatch.setattr(session, "DrillPublishers", partial(Publishers, None))

    def create(use_sim_time=False, **values):
        overrides = [Parameter("use_sim_time", value=use_sim_time)]
        node = rclpy.create_node("drill_node", namespace="/rpud", parameter_overrides=overrides)
        nodes.append(node)
        made.append(Drill(node, Settings(thread_priority=0, **values)))
        return made[-1]

    yield create
    for each in made:
        each.close()


@pytest.fixture
def drill(make):
    """A paused drill."""
    return make()


@pytest.fixture
def playing(drill):
    drill.timeline.play()
    return drill


def test_blocks_are_computed_ahead_of_their_deadlines_and_published_at_them(playing):
    drain = playing.inbox.drain

    def slow(apply):  # what acts after a block is not its lateness
        playing.clock.now += 3 * MILLISECOND
        return drain(apply)

    playing.inbox.drain = slow
    deadlines = [START + number * PERIOD for number in (1, 2, 3)]
    assert [playing.go_on() for _ in deadlines] == [PERIOD, 2 * PERIOD, 3 * PERIOD]
    assert playing.publishers.sent_at == pytest.approx(deadlines, abs=2)
    # 10 ms ahead, or after the block before
    begun = [START, *(each + 3 * MILLISECOND for each in deadlines[:2])]
    assert playing.publishers.computed == pytest.approx(begun, abs=2)
    timing = playing.timeline.pacer.read()
    assert (timing["deadlines_missed"], timing["lag"]) == (0, 0.0)
    assert timing["lateness_max"] == pytest.approx(0.0, abs=1e-8)


def test_a_command_that_comes_during_a_block_acts_at_its_end(playing):
    playing.go_on()
    before, seen = playing.weight_on_bit, []
    playing.publishers.meanwhile = lambda: seen.append(playing.weight_on_bit) or playing.command(33)
    assert playing.go_on() == 2 * PERIOD
    assert (seen, playing.weight_on_bit) == ([before], 33.0)


def test_a_stream_of_commands_acts_in_each_block_and_is_reported_at_a_rate_of_its_own(playing):
    playing.go_on()
    began, before = time.monotonic(), playing.publishers.count("status")
    for number in range(100):
        playing.command(10.0 + number)
        playing.go_on()
        assert playing.weight_on_bit == 10.0 + number
    periods = (time.monotonic() - began) / health.CHANGE_PERIOD
    assert playing.inbox.accepted == 100
    assert playing.publishers.count("status") - before <= periods + 2


def slow(drill):
    """Let the making of a block take twice as long as it lasts."""
    drill.publishers.meanwhile = lambda: drill.clock.sleep(0.02)
    return drill


def test_the_first_line_has_the_weight_on_bit_that_acts(make, capfd):
    given = to_settings({"feed_model": "given"}).configuration
    for configuration, weight in (Settings().configuration, "8 N"), (given, "0 N"):
        drill = make(configuration=configuration)
        drill.start_time(threading.Event(), lambda: None)
        assert f"regime drilling, weight on bit {weight}, drive on" in capfd.readouterr().err


def test_the_first_pause_names_publish_clock_unless_there_is_a_clock(make, capfd):
    lines = []
    for values in ({}, {"publish_clock": True}):
        drill = make(**values)
        for _ in range(2):
            pause(drill)
        lines.append(capfd.readouterr().err.count("with publish_clock other nodes follow"))
    assert lines == [1, 0]


def test_a_step_that_could_not_deliver_says_what_a_running_subscriber_lacks(drill):
    step, own = drill.step(20_000_000), drill.publishers.own
    own.overwritten.update({("contact_force", False): 7, ("wrench", True): 2})
    drill.finish_step()
    expected = "up to 7 messages of contact_force are lost: a subscriber did not take them in 10 s"
    assert step.result().failure == expected
    step = drill.step(40_000_000)
    drill.finish_step()
    assert step.result().failure == ""


def test_without_time_they_wait_but_not_longer_than_two_periods_of_theirs(playing):
    slow(playing)
    for _ in range(9):
        playing.go_on()
    assert playing.publishers.streams == []
    for _ in range(41):
        playing.go_on()
    assert len(playing.publishers.streams) >= 2 * (50 // 5 - 2)
    playing.timeline.pause()
    assert playing.publishers.streams == ["waveform", "trajectory"] * 10


def test_what_was_put_off_comes_before_the_end_and_with_the_stamps_of_its_time(make):
    sent = []
    for drill in (slow(make()), make()):
        drill.timeline.play()
        for _ in range(5):
            drill.go_on()
        drill.run.apply(SetOrigin(7 * SECOND))
        drill.finish()
        assert drill.publishers.streams == ["waveform", "trajectory"]
        sent.append([each for each in drill.publishers.messages if each[0] == "trajectory"])
    assert sent[0] == sent[1]


def test_at_a_standstill_only_commands_act_until_it_plays_from_there_on(playing):
    playing.go_on()
    playing.timeline.pause()
    playing.clock.now += 5 * SECOND
    playing.command(33.0)
    assert take_turn(playing) > 0.0
    assert (playing.run.time, playing.weight_on_bit) == (PERIOD, 33.0)
    resumed = playing.clock.now
    playing.timeline.play()
    assert playing.go_on() == 2 * PERIOD
    assert playing.publishers.sent_at[-1] == pytest.approx(resumed + PERIOD, abs=2)


def test_as_fast_as_possible_no_deadline_is_waited_for_and_streams_follow_their_blocks(make):
    drill = make(real_time_factor=0.0)
    drill.timeline.play()
    for number in range(1, 11):
        assert (take_turn(drill), drill.run.time) == (0.0, number * PERIOD)
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    assert drill.publishers.patient
    assert drill.publishers.streams == ["waveform", "trajectory"] * 2


@pytest.mark.parametrize(
    ("changes", "is_playing", "at_start", "state"),
    [
        ((), False, False, "paused"),
        ((play,), True, False, "running"),
        ((play, pause), False, False, "paused"),
        ((play, HALT), False, True, "stopped"),
        ((HALT, pause), False, False, "paused"),
        ((HALT, play), True, False, "running"),
    ],
)
def test_the_state_is_that_of_the_last_change(drill, changes, is_playing, at_start, state):
    for change in changes:
        change(drill)
    assert (drill.timeline.playing, drill.timeline.at_start, drill.state) == (
        is_playing,
        at_start,
        state,
    )
    drill.activate(False)
    assert drill.state == drill.reporter.last.status["state"] == "inactive"


def test_a_step_ends_at_its_goal_without_a_deadline_and_its_status_comes_first(drill, monkeypatch):
    goal = PERIOD + PERIOD // 2
    drill.command(33.0)  # it acts before the step, and is reported
    step = drill.step(goal)
    assert drill.reporter.last.status["weight_on_bit"] == 33.0
    assert (drill.timeline.goal, drill.state, drill.timeline.playing) == (goal, "running", False)
    reported, tell = [], drill.report
    monkeypatch.setattr(
        drill, "report", lambda **_: reported.append((drill.run.time, step.done())) or tell()
    )
    drill.finish_step()
    assert reported == [(goal, False)]
    assert step.result(0.0).stamp == drill.stamp == drill.run.origin + goal
    assert drill.reporter.last.status["state"] == "paused"
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    drill.timeline.play()
    assert drill.go_on() == 2 * PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(START + PERIOD // 2, abs=2)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (play, "the simulation was set to play"),
        (pause, "the simulation was paused"),
        (HALT, "the simulation was reset"),
        (lambda drill: drill.timeline.interrupt("the drill has stopped"), "the drill has stopped"),
    ],
)
def test_whatever_comes_before_the_goal_interrupts_a_step(drill, change, reason):
    step = drill.step(PERIOD)
    change(drill)
    with pytest.raises(RequestError, match=f"^interrupted: {reason}$"):
        step.result(0.0)
    drill.timeline.pause()
    another = drill.step(2 * PERIOD)
    drill.finish_step()
    assert another.result(0.0).stamp == drill.run.origin + 2 * PERIOD


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (play, "it is playing, not paused, as after `rpud pause`"),
        (HALT, "it is stopped, not paused, as after `rpud pause`"),
        (
            lambda drill: drill.step(PERIOD),
            "it is stepping already, not paused, as after `rpud pause`",
        ),
    ],
)
def test_only_a_paused_simulation_steps(drill, change, reason):
    change(drill)
    before = drill.timeline.goal
    with pytest.raises(ParameterError, match=f"^{reason}$"):
        drill.step(2 * PERIOD)
    assert drill.timeline.goal == before


def test_the_settings_of_the_run_come_back_with_it_but_for_its_pace(drill):
    first, changed = drill.settings, dataclasses.replace(drill.settings, command_timeout=2.0)
    drill.configure(changed)
    drill.reset(time=True, state=True)
    assert drill.settings == drill.restored[-1] == first
    drill.configure(dataclasses.replace(changed, real_time_factor=0.5))
    drill.reset(time=True, state=True)
    expected = dataclasses.replace(first, real_time_factor=0.5)
    assert drill.settings == drill.restored[-1] == expected


def test_a_reset_that_cannot_be_leaves_the_step_that_goes_on(make, tmp_path):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: []\n")
    drill = make(scenario=str(scenario))
    step = drill.step(PERIOD)
    scenario.write_text("faults: [{kind: hard_rock, onset: 1.0}]\n")  # and there is no rock
    with pytest.raises(ParameterError, match=r"scenario\.yaml:1: hard_rock is not possible"):
        drill.reset(time=True, state=True, seed=5)
    assert drill.timeline.goal == PERIOD
    drill.finish_step()
    assert step.result(0.0).stamp == drill.run.origin + PERIOD


@pytest.mark.parametrize("time", [False, True])
def test_a_seed_that_cannot_be_is_rejected_by_each_reset_and_the_next_one_has_another(make, time):
    drill = make(publish_clock=True)
    drill.run.apply(Inject(Fault("lost_preload")))

    def faults():
        return drill.run.simulation.faults.active

    drill.step(PERIOD)
    drill.finish_step()
    for state in (False, True):
        with pytest.raises(ParameterError, match=r"^seed = -2 is outside its range \[-1, 4\.29"):
            drill.reset(time, state, faults=True, seed=-2)
        assert (drill.stamp, drill.run.time, len(faults())) == (PERIOD, PERIOD, 1)
    drill.reset(time, state=False, faults=True, seed=8)
    assert not faults()
    drill.reset(time, state=True)
    assert drill.run.beginning.seed == 8


def test_a_reset_to_a_seed_gives_the_bytes_of_a_drill_that_was_started_with_it(make):
    def drilled(drill, seed):
        drill.reset(time=True, state=True, seed=seed)
        before = len(drill.publishers.messages)
        drill.step(SECOND // 5)
        drill.finish_step()
        return [each for each in drill.publishers.messages[before:] if each[0] in PROVED]

    started = drilled(make(publish_clock=True, seed=7), None)
    drill = make(publish_clock=True)
    assert {name for name, _ in started} >= {"contact_force", "trajectory", "wrench"}
    assert drilled(drill, 7) == drilled(drill, 7) == started != drilled(drill, 8)


def test_a_reset_of_the_time_alone_goes_on_at_stamp_zero_where_the_drill_is_its_source(make):
    drill = make(publish_clock=True)
    drill.step(PERIOD)
    drill.finish_step()
    assert drill.stamp == PERIOD
    drill.reset(time=True, state=False)
    assert (drill.run.time, drill.stamp) == (PERIOD, 0)
    drill.step(2 * PERIOD)
    drill.finish_step()
    assert drill.stamp == PERIOD
    drill.reset(time=False, state=True)
    assert (drill.run.time, drill.stamp) == (0, PERIOD)


def tell(drill, nanoseconds):
    time = Time(nanoseconds=nanoseconds, clock_type=ClockType.ROS_TIME)
    drill.timeline.source._clock.set_ros_time_override(time)


def test_a_drill_that_follows_a_clock_does_not_drift_and_restarts_where_that_goes_back(make):
    drill = make(use_sim_time=True)
    tell(drill, 7 * SECOND)
    drill.start_time(threading.Event(), lambda: None)
    timeline = drill.timeline
    assert (timeline.source.follows, timeline.playing, drill.stamp) == (True, True, 7 * SECOND)
    tell(drill, 7 * SECOND + PERIOD // 2)
    drill.configure(dataclasses.replace(drill.settings, real_time_factor=0.5))
    assert drill.timeline.pacer.remaining(PERIOD) == pytest.approx(PERIOD / 2 / SECOND)
    tell(drill, 7 * SECOND + PERIOD)
    assert (take_turn(drill), drill.run.time) == (0.0, PERIOD)
    # What comes while the clock stands acts before its next tick.
    drill.command(20.0)
    tell(drill, 7 * SECOND + 2 * PERIOD)
    assert (take_turn(drill), drill.run.time) == (0.0, 2 * PERIOD)
    assert (drill.weight_on_bit, drill.run.simulation.applied.weight_on_bit_time) == (20.0, PERIOD)
    tell(drill, 3 * SECOND)
    take_turn(drill)
    assert (drill.run.time, drill.stamp) == (0, 3 * SECOND)


@pytest.mark.parametrize("content", ["faults: [{kind: hard_rock, onset: 1.0}]\n", None])
def test_it_restarts_there_whatever_became_of_its_scenario(make, tmp_path, content, capfd):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: [{kind: lost_preload, onset: 0.0}]\n")
    drill = make(use_sim_time=True, scenario=str(scenario))
    tell(drill, 7 * SECOND)
    drill.start_time(threading.Event(), lambda: None)
    drill.configure(dataclasses.replace(drill.settings, real_time_factor=0.5))
    begun = drill.run.beginning
    scenario.unlink() if content is None else scenario.write_text(content)
    tell(drill, 3 * SECOND)
    take_turn(drill)
    assert (drill.run.beginning, drill.run.time, drill.stamp) == (begun, 0, 3 * SECOND)
    assert drill.run.settings == drill.settings
    assert "the drill restarts as it last began" in capfd.readouterr().err
