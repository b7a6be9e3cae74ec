"""Blocks are computed ahead and published at their deadlines; commands act between two."""

import time

import pytest
import rclpy
from manual_clock import SECOND, ManualClock
from std_msgs.msg import Header

from rpud_sim.ros.drill.inbox import Fate, Inbox
from rpud_sim.ros.drill.namesakes import DuplicateNodes
from rpud_sim.ros.drill.paced_run import PacedRun
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.status_reporter import CHANGE_PERIOD, StatusReporter
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.run import Beginning, Run

MILLISECOND = 1_000_000
PERIOD = 10 * MILLISECOND
LEAD = 10 * MILLISECOND
START = 17 * SECOND

GIVEN = Fate("weight_on_bit", Header())


class Publishers(DrillPublishers):
    """Publishers that note when a block is computed and when it is sent, by a clock."""

    def __init__(self, node, clock):
        super().__init__(node, publish_clock=False)
        self.clock = clock
        self.computed, self.sent_at, self.topics = [], [], []
        self.messages = []
        self.meanwhile = lambda: None

    def wanted(self, topic):
        return True

    def encode(self, entries):
        encoded = super().encode(entries)
        if any(name == "nodal_plane" for name, _ in encoded):
            self.computed.append(self.clock())
            self.meanwhile()  # what happens while a block is computed
        return encoded

    def _send(self, name, message):
        self.topics.append(name)
        if name == "nodal_plane":
            self.sent_at.append(self.clock())
        self.messages.append((name, message))
        super()._send(name, message)

    def bytes_of(self, *names):
        return [message for name, message in self.messages if name in names]


class Drill:
    """A run under an reporter, an inbox and a pacer whose clock is moved by hand."""

    def __init__(self, node, factor, schedule=None):
        self.clock = ManualClock(START)
        self.inbox = Inbox(node.get_logger())
        self.publishers = Publishers(node, self.clock)
        self.reporter = StatusReporter(node, 100, self.publishers, self.inbox, DuplicateNodes(node))
        self.pacer = Pacer(100, 1.0, self.clock, schedule, self.clock.sleep)
        run = Run(Beginning(Settings()), wanted=self.publishers.wanted, on_block=self.reporter.add)
        self.paced = PacedRun(
            run, self.publishers, self.reporter, self.inbox, self.pacer, node.get_logger()
        )
        self.factor = factor

    def play(self, due=None):
        self.paced.time_control.play()
        self.paced.pace(self.factor, 0, due)

    def pause(self):
        self.paced.time_control.pause()
        self.paced.pace(self.factor, 0)

    def advance(self):
        """Do what is due, waiting for it as the thread does, and give the simulation time."""
        while (idle := self.paced.advance()) > 0.0:
            self.clock.now += round(idle * SECOND)
        return self.paced.run.time

    @property
    def weight_on_bit(self):
        return self.paced.run.simulation.applied.weight_on_bit.force


@pytest.fixture
def drill():
    rclpy.init()
    node = rclpy.create_node("drill_node", namespace="/rpud")
    yield lambda factor=1.0, schedule=None: Drill(node, factor, schedule)
    node.destroy_node()
    rclpy.try_shutdown()


def test_blocks_are_computed_ahead_of_their_deadlines_and_published_at_them(drill):
    drill = drill()
    drill.play()
    for number in (1, 2, 3):
        assert drill.advance() == number * PERIOD
    assert drill.publishers.computed == pytest.approx(
        [START + number * PERIOD - LEAD for number in (1, 2, 3)], abs=2
    )
    assert drill.publishers.sent_at == pytest.approx(
        [START + number * PERIOD for number in (1, 2, 3)], abs=2
    )
    timing = drill.pacer.read()
    assert (timing.deadlines_missed, timing.lag) == (0, 0.0)
    assert timing.lateness_max == pytest.approx(0.0, abs=1e-8)


def test_a_block_ends_when_it_is_published_and_what_acts_after_it_is_not_its_lateness(
    drill, monkeypatch
):
    drill = drill()
    drill.play()
    drain = drill.inbox.drain

    def slow():
        drill.clock.now += 3 * MILLISECOND
        return drain()

    monkeypatch.setattr(drill.inbox, "drain", slow)
    drill.advance()
    assert drill.clock.now >= START + PERIOD + 3 * MILLISECOND
    assert drill.pacer.read().lateness_max == pytest.approx(0.0, abs=1e-8)


def test_a_command_that_comes_while_a_block_waits_acts_at_its_end(drill):
    drill = drill()
    drill.play()
    drill.advance()
    before = drill.weight_on_bit
    seen = []
    drill.publishers.meanwhile = lambda: (
        seen.append(drill.weight_on_bit),
        drill.inbox.accept(WeightOnBit(33.0), GIVEN),
    )
    assert drill.advance() == 2 * PERIOD
    assert seen == [before]
    assert drill.weight_on_bit == 33.0


def test_a_stream_of_commands_acts_in_each_block_and_is_reported_at_a_rate_of_its_own(drill):
    drill = drill()
    drill.play()
    drill.advance()
    began = time.monotonic()
    drill.publishers.topics.clear()
    for number in range(100):
        drill.inbox.accept(WeightOnBit(10.0 + number), GIVEN)
        drill.advance()
        assert drill.weight_on_bit == 10.0 + number
    elapsed = time.monotonic() - began
    assert drill.inbox.accepted == 100
    assert drill.publishers.topics.count("status") <= elapsed / CHANGE_PERIOD + 2


def test_a_command_between_two_blocks_acts_at_the_next_end(drill):
    drill = drill(factor=0.5)  # with time between two blocks
    drill.play()
    drill.advance()
    before = drill.weight_on_bit
    drill.inbox.accept(WeightOnBit(33.0), GIVEN)
    assert drill.paced.advance() > 0.0  # nothing is due yet
    assert (drill.weight_on_bit, drill.paced.run.time) == (before, PERIOD)
    assert drill.advance() == 2 * PERIOD
    assert drill.weight_on_bit == 33.0


def streams_of(drill):
    return [name for name in drill.publishers.topics if name in ("waveform", "trajectory")]


def test_waveform_and_trajectory_follow_in_the_time_before_the_next_deadline(drill):
    drill = drill()
    drill.play()
    for _ in range(4):
        drill.advance()
    assert streams_of(drill) == []
    drill.advance()
    assert streams_of(drill) == ["waveform", "trajectory"]
    after = drill.publishers.topics.index("trajectory")
    assert drill.publishers.topics[:after].count("nodal_plane") == 4  # ahead of the fifth


def test_without_time_they_wait_but_not_longer_than_two_periods_of_theirs(drill):
    drill = drill()
    drill.play()
    drill.publishers.meanwhile = lambda: drill.clock.sleep(0.02)  # twice as long as a block
    for _ in range(9):
        drill.advance()
    assert streams_of(drill) == []
    for _ in range(41):
        drill.advance()
    assert len(streams_of(drill)) >= 2 * (50 // 5 - 2)
    drill.pause()
    assert streams_of(drill) == ["waveform", "trajectory"] * 10


def test_what_was_put_off_comes_before_a_flush_and_with_the_stamps_of_its_time(drill):
    slow, prompt = drill(), drill()
    slow.publishers.meanwhile = lambda: slow.clock.sleep(0.02)
    for each in (slow, prompt):
        each.play()
        for _ in range(5):
            each.advance()
        each.paced.run.place(7 * SECOND)
        each.paced.flush()
    assert streams_of(slow) == streams_of(prompt) == ["waveform", "trajectory"]
    sent = [each.publishers.bytes_of("waveform", "trajectory") for each in (slow, prompt)]
    assert sent[0] == sent[1]


def test_the_diagnostics_of_a_change_wait_for_time_and_come_once_in_a_report(drill):
    drill = drill()
    drill.play()
    drill.advance()
    drill.publishers.meanwhile = lambda: drill.clock.sleep(0.02)
    before = drill.publishers.topics.count("/diagnostics")
    for force in (31.0, 32.0, 33.0):
        drill.inbox.accept(WeightOnBit(force), GIVEN)
        drill.advance()
    assert drill.publishers.topics.count("/diagnostics") == before
    drill.pause()
    assert drill.publishers.topics.count("/diagnostics") >= before + 1
    assert drill.publishers.topics[-1] == "/diagnostics"


def test_impacts_are_published_within_a_period_of_their_stamps(drill):
    drill = drill()
    drill.play()
    for _ in range(20):
        drill.advance()
    drill.reporter.finish()
    drill.paced.report()
    delays = drill.reporter.last.impact_delays
    assert delays.count == drill.paced.run.simulation.impact_count > 0
    assert 0.0 < delays.p50 <= delays.p99 <= delays.greatest <= PERIOD / SECOND


def test_at_a_standstill_nothing_is_computed_until_it_plays_from_there_on(drill):
    drill = drill()
    drill.play()
    drill.advance()
    drill.pause()
    drill.clock.now += 5 * SECOND
    assert drill.paced.advance() > 0.0
    assert drill.paced.run.time == PERIOD
    drill.inbox.accept(WeightOnBit(33.0), GIVEN)
    drill.paced.advance()
    assert drill.weight_on_bit == 33.0  # commands act at a standstill
    resumed = drill.clock.now
    drill.play()
    assert drill.advance() == 2 * PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(resumed + PERIOD, abs=2)


def test_a_step_waits_for_no_deadline_and_stops_at_its_goal(drill):
    drill = drill()
    drill.pause()
    step = drill.paced.step(PERIOD + PERIOD // 2)
    assert drill.paced.advance() == 0.0
    assert (drill.paced.run.time, step.done()) == (PERIOD, False)
    assert drill.paced.advance() == 0.0
    assert step.result(0.0).stamp == drill.paced.run.time == PERIOD + PERIOD // 2
    assert drill.reporter.last.status["state"] == "paused"
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    drill.play()
    assert drill.advance() == 2 * PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(START + PERIOD // 2, abs=2)


def test_as_fast_as_possible_no_deadline_is_waited_for(drill):
    drill = drill(factor=0.0)
    drill.play()
    for number in range(1, 6):
        assert drill.paced.advance() == 0.0
        assert drill.paced.run.time == number * PERIOD
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    assert drill.publishers.patient


def test_another_factor_changes_the_pace_from_a_block_on(drill):
    drill = drill()
    drill.play()
    drill.advance()
    drill.paced.pace(0.5, 0)
    drill.advance()
    assert drill.publishers.sent_at[-1] == pytest.approx(START + 3 * PERIOD, abs=2)
    assert not drill.publishers.patient


def test_a_run_that_replaces_another_begins_at_zero_with_its_own_schedule(drill):
    drill = drill()
    drill.play()
    drill.advance()
    drill.paced.replace(Run(Beginning(Settings()), wanted=drill.publishers.wanted), SECOND)
    assert drill.paced.run.time == 0
    replaced = drill.clock.now
    drill.play()
    assert drill.advance() == PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(replaced + PERIOD, abs=2)
