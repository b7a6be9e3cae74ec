"""One thread computes blocks ahead, publishes them at their deadlines, and serves requests."""

import dataclasses
import threading
import time
from collections import Counter
from functools import partial

import pytest
from manual_clock import SECOND, ManualClock
from support import PATIENCE, until

from rpud_sim.ros.drill import live_run, report
from rpud_sim.ros.drill.commands import Inbox, result_of
from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes
from rpud_sim.ros.drill.live_run import InterruptedStepError, LiveRun
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.report import CHANGE_PERIOD
from rpud_sim.ros.threads import StoppedError
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Settings

MILLISECOND = 1_000_000
PERIOD = 10 * MILLISECOND
LEAD = 10 * MILLISECOND
START = 17 * SECOND

GIVEN = result_of("weight_on_bit")


class Publishers(DrillPublishers):
    """Publishers that note when a block is computed and when it is sent, by a clock."""

    def __init__(self, clock, *arguments):
        super().__init__(*arguments)
        self.clock = clock
        self.computed, self.sent_at, self.topics = [], [], []
        self.messages = []
        self.meanwhile = lambda: None

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
    """A live run in a loop without a thread, with a pacer whose clock is moved by hand."""

    def __init__(self, node, monkeypatch, factor):
        self.clock = ManualClock(START)
        self.inbox = Inbox(node.get_logger())
        monkeypatch.setattr(live_run, "DrillPublishers", partial(Publishers, self.clock))
        settings = Settings(real_time_factor=factor)
        namesakes = DuplicateNodes(node)
        self.live = LiveRun(node, settings, self.inbox, namesakes, sent=Counter())
        self.live.pacer = Pacer(100, None, self.clock, self.clock.sleep)
        self.publishers, self.reporter = self.live.publishers, self.live.reporter
        self.live.begin(settings)

    def turn(self):
        return self.live.turn()

    def advance(self):
        """Do what is due, waiting for it as the thread does, and give the simulation time."""
        while (idle := self.turn()) > 0.0:
            self.clock.now += round(idle * SECOND)
        return self.live.run.time

    @property
    def weight_on_bit(self):
        return self.live.run.simulation.applied.weight_on_bit.force


@pytest.fixture
def drill(drill_node, monkeypatch):
    return lambda factor=1.0: Drill(drill_node, monkeypatch, factor)


def test_blocks_are_computed_ahead_of_their_deadlines_and_published_at_them(drill):
    drill = drill()
    drill.live.play()
    for number in (1, 2, 3):
        assert drill.advance() == number * PERIOD
    assert drill.publishers.computed == pytest.approx(
        [START + number * PERIOD - LEAD for number in (1, 2, 3)], abs=2
    )
    assert drill.publishers.sent_at == pytest.approx(
        [START + number * PERIOD for number in (1, 2, 3)], abs=2
    )
    timing = drill.live.pacer.read()
    assert (timing["deadlines_missed"], timing["lag"]) == (0, 0.0)
    assert timing["lateness_max"] == pytest.approx(0.0, abs=1e-8)


def test_a_block_ends_when_it_is_published_and_what_acts_after_it_is_not_its_lateness(
    drill, monkeypatch
):
    drill = drill()
    drill.live.play()
    drain = drill.inbox.drain

    def slow():
        drill.clock.now += 3 * MILLISECOND
        return drain()

    monkeypatch.setattr(drill.inbox, "drain", slow)
    drill.advance()
    assert drill.clock.now >= START + PERIOD + 3 * MILLISECOND
    assert drill.live.pacer.read()["lateness_max"] == pytest.approx(0.0, abs=1e-8)


def test_a_command_that_comes_while_a_block_waits_acts_at_its_end(drill):
    drill = drill()
    drill.live.play()
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
    drill.live.play()
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
    drill.live.play()
    drill.advance()
    before = drill.weight_on_bit
    drill.inbox.accept(WeightOnBit(33.0), GIVEN)
    assert drill.turn() > 0.0  # nothing is due yet
    assert (drill.weight_on_bit, drill.live.run.time) == (before, PERIOD)
    assert drill.advance() == 2 * PERIOD
    assert drill.weight_on_bit == 33.0


def streams_of(drill):
    return [name for name in drill.publishers.topics if name in ("waveform", "trajectory")]


def test_waveform_and_trajectory_follow_in_the_time_before_the_next_deadline(drill):
    drill = drill()
    drill.live.play()
    for _ in range(4):
        drill.advance()
    assert streams_of(drill) == []
    drill.advance()
    assert streams_of(drill) == ["waveform", "trajectory"]
    after = drill.publishers.topics.index("trajectory")
    assert drill.publishers.topics[:after].count("nodal_plane") == 4  # ahead of the fifth


def test_without_time_they_wait_but_not_longer_than_two_periods_of_theirs(drill):
    drill = drill()
    drill.live.play()
    drill.publishers.meanwhile = lambda: drill.clock.sleep(0.02)  # twice as long as a block
    for _ in range(9):
        drill.advance()
    assert streams_of(drill) == []
    for _ in range(41):
        drill.advance()
    assert len(streams_of(drill)) >= 2 * (50 // 5 - 2)
    drill.live.pause()
    assert streams_of(drill) == ["waveform", "trajectory"] * 10


def test_what_was_put_off_comes_before_the_end_and_with_the_stamps_of_its_time(drill):
    slow, prompt = drill(), drill()
    slow.publishers.meanwhile = lambda: slow.clock.sleep(0.02)
    for each in (slow, prompt):
        each.live.play()
        for _ in range(5):
            each.advance()
        each.live.run.place(7 * SECOND)
        each.live.finish()
    assert streams_of(slow) == streams_of(prompt) == ["waveform", "trajectory"]
    sent = [each.publishers.bytes_of("waveform", "trajectory") for each in (slow, prompt)]
    assert sent[0] == sent[1]


def test_the_diagnostics_of_changes_wait_for_time_and_come_once(drill, monkeypatch):
    monkeypatch.setattr(report, "CHANGE_PERIOD", 0.0)  # each change is reported at once
    monkeypatch.setattr(report, "REPORT_PERIOD", 3600.0)
    drill = drill()
    drill.live.play()
    drill.advance()
    drill.publishers.meanwhile = lambda: drill.clock.sleep(0.02)
    before = Counter(drill.publishers.topics)
    for force in (31.0, 32.0, 33.0):
        drill.inbox.accept(WeightOnBit(force), GIVEN)
        drill.advance()
    assert drill.publishers.topics.count("status") == before["status"] + 3
    assert drill.publishers.topics.count("/diagnostics") == before["/diagnostics"]
    drill.publishers.meanwhile = lambda: None
    for _ in range(20):
        drill.advance()
    assert drill.publishers.topics.count("/diagnostics") == before["/diagnostics"] + 1


def test_impacts_are_published_within_a_period_of_their_stamps(drill):
    drill = drill()
    drill.live.play()
    for _ in range(20):
        drill.advance()
    delays = drill.reporter.impact_delays
    assert delays.count == drill.live.run.simulation.impact_count > 0
    assert 0.0 < delays.quantile(0.5) <= delays.quantile(0.99) <= delays.greatest <= PERIOD / SECOND


def test_at_a_standstill_nothing_is_computed_until_it_plays_from_there_on(drill):
    drill = drill()
    drill.live.play()
    drill.advance()
    drill.live.pause()
    drill.clock.now += 5 * SECOND
    assert drill.turn() > 0.0
    assert drill.live.run.time == PERIOD
    drill.inbox.accept(WeightOnBit(33.0), GIVEN)
    drill.turn()
    assert drill.weight_on_bit == 33.0  # commands act at a standstill
    resumed = drill.clock.now
    drill.live.play()
    assert drill.advance() == 2 * PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(resumed + PERIOD, abs=2)


def test_a_step_waits_for_no_deadline_and_stops_at_its_goal(drill):
    drill = drill()
    drill.live.pause()
    step = drill.live.step(PERIOD + PERIOD // 2)
    assert drill.turn() == 0.0
    assert (drill.live.run.time, step.done()) == (PERIOD, False)
    assert drill.turn() == 0.0
    assert step.result(0.0).stamp == drill.live.run.time == PERIOD + PERIOD // 2
    assert drill.reporter.last.status["state"] == "paused"
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    drill.live.play()
    assert drill.advance() == 2 * PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(START + PERIOD // 2, abs=2)


def test_as_fast_as_possible_no_deadline_is_waited_for_and_streams_follow_their_blocks(drill):
    drill = drill(factor=0.0)
    drill.live.play()
    for number in range(1, 11):
        assert drill.turn() == 0.0
        assert drill.live.run.time == number * PERIOD
    assert (drill.clock.slept, drill.clock.now) == ([], START)
    assert drill.publishers.patient
    assert streams_of(drill) == ["waveform", "trajectory"] * 2


def test_another_factor_changes_the_pace_from_a_block_on(drill):
    drill = drill()
    drill.live.play()
    drill.advance()
    drill.live.configure(dataclasses.replace(drill.live.settings, real_time_factor=0.5))
    drill.advance()
    assert drill.publishers.sent_at[-1] == pytest.approx(START + 3 * PERIOD, abs=2)
    assert not drill.publishers.patient


def test_a_reset_run_begins_at_zero_with_its_own_schedule(drill):
    drill = drill()
    drill.live.play()
    drill.advance()
    drill.live.reset(time=True, state=True)
    assert drill.live.run.time == 0
    replaced = drill.clock.now
    assert drill.advance() == PERIOD
    assert drill.publishers.sent_at[-1] == pytest.approx(replaced + PERIOD, abs=2)


@pytest.fixture
def start(drill_node):
    """Start the thread of a drill; it is stopped at the end of the test."""
    loops = []

    def create(restored=lambda settings: None, end=10**18, begin=True, **values):
        settings = Settings().replace(values)
        loops.append(PacingLoop())
        inbox = Inbox(drill_node.get_logger(), loops[-1].wake)
        names = DuplicateNodes(drill_node)
        live = LiveRun(drill_node, settings, inbox, names, restored, end)
        loops[-1].configure(live)
        if begin:
            loops[-1].start(settings)
        return loops[-1], live

    yield create
    for loop in loops:
        loop.clean_up()


def test_before_the_start_a_request_is_refused(start):
    loop, _ = start(begin=False)
    assert loop.begun is None
    with pytest.raises(StoppedError, match="the node has not been activated"):
        loop.request(lambda live: None)


@pytest.mark.parametrize("factor", [0.0, 1.0, 100.0])
def test_it_ends_where_the_simulation_ends_and_refuses_what_comes_later(start, factor):
    loop, live = start(end=5 * PERIOD, real_time_factor=factor)
    until(lambda: loop.finished)
    assert loop.failure is None
    assert live.run.time == 5 * PERIOD
    loop.stop()
    assert live.run.time == 5 * PERIOD
    with pytest.raises(StoppedError, match="the drill has stopped"):
        loop.request(lambda live: None)


@pytest.mark.parametrize("factor", [0.01, 1.0])
def test_requests_act_at_block_boundaries_in_the_order_in_which_they_came(start, factor):
    loop, _ = start(real_time_factor=factor)
    times = [loop.request(lambda live: live.run.time) for _ in range(20)]
    assert times == sorted(times)
    assert all(time % PERIOD == 0 for time in times)


def test_what_a_request_asks_for_itself_is_done_at_once(start):
    asked = []

    def restored(settings):  # the node sets its parameters, which asks the drill to configure
        asked.append(loop.request(lambda live: (threading.current_thread().name, settings)))

    loop, _ = start(restored, start_paused=True, command_timeout=2.0)
    loop.request(lambda live: live.configure(Settings(start_paused=True)))
    loop.request(lambda live: live.reset(time=True, state=True))
    assert asked == [("pacing", Settings(start_paused=True, command_timeout=2.0))]


def test_a_stop_ends_a_step_with_an_error_and_a_standstill_at_once(start):
    loop, live = start(start_paused=True)
    reached = loop.request(lambda live: live.step(PERIOD))
    assert reached.stamp == live.run.origin + PERIOD
    failures = []

    def step():
        try:
            loop.request(lambda live: live.step(10**6 * SECOND))
        except InterruptedStepError as error:
            failures.append(str(error))

    stepper = threading.Thread(target=step)
    stepper.start()
    until(lambda: live.goal is not None)
    loop.stop()
    stepper.join(PATIENCE)
    assert failures == ["interrupted: the drill has stopped"]
    assert loop.failure is None


def test_an_error_ends_it_and_every_request(start, tmp_path):
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text("faults: []\n")
    loop, live = start(scenario=str(scenario))
    scenario.unlink()
    with pytest.raises(Exception, match=r"scenario\.yaml: No such file"):
        loop.request(lambda live: live.reset(time=True, state=True))
    assert not loop.finished  # the error is the client's

    def fail():
        raise OSError("the disk is gone")

    live.turn = fail
    until(lambda: loop.finished)
    assert str(loop.failure) == "the disk is gone"
    with pytest.raises(StoppedError):
        loop.request(lambda live: None)
