"""Messages are published when they are due, whatever the commands to the replay meanwhile.

Time is a number here: a playback is called again at the time that it returned.
"""

import itertools
import math
import threading
import time
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.ros.options import RATE, ReplayOptions
from rpud_sim.ros.replay.playback import Playback, read_ahead
from rpud_sim.ros.threads import RequestError

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
NOW = 5_000 * SECOND


replay_options = partial(ReplayOptions, bag="bag")


class Stage:
    """A playback with a clock of its own, and a log of what was published when."""

    def __init__(
        self, offsets, takes=0, first=START, last=None, latched=lambda position: (), **options
    ):
        self.now = NOW
        self.sent, self.hurried, self.ticks, self.log = [], [], [], []
        self.takes = takes  # time that publishing takes [ns]
        self.bag = [Message("/a", START + offset, START, b"") for offset in sorted(offsets)]
        self.opened = []
        self.last = last or (self.bag[-1].log_time if self.bag else START)
        self.playback = Playback(
            *(self.read, (first, self.last), replay_options(**options), self),
            lambda: self.now,
            latched=latched,
        )
        self.playback.begin()

    def read(self, position):
        self.opened.append(each for each in self.bag if position <= each.log_time <= self.last)
        return self.opened[-1]

    def publish(self, message, *, hurried):
        self.hurried.append(hurried)
        self.sent.append((message.log_time - START, self.now - NOW))
        self.log.append((message.log_time - START, "message"))
        self.now += self.takes
        return True

    def publish_clock(self, bag_time):
        self.ticks.append((bag_time - START, self.now - NOW))
        self.log.append((bag_time - START, "clock"))

    def run(self, seconds=math.inf):
        """Let time pass; stop where nothing more is to come."""
        until = self.now + seconds * SECOND
        while (delay := self.playback.advance()) is not None:
            if self.now + delay * SECOND > until:
                self.now = int(until) if until < math.inf else self.now
                return True
            self.now += math.ceil(delay * SECOND)
        return False


def close_to(pairs):
    """Ignore what rounding of the times may do [ns]."""
    return [pytest.approx(pair, abs=1000) for pair in pairs]


@given(st.lists(st.integers(0, 100 * SECOND)), st.floats(1e-2, 1e3))
def test_every_message_comes_when_it_is_due(offsets, rate):
    stage = Stage(offsets, rate=rate)
    stage.run()
    assert stage.sent == close_to([(offset, offset / rate) for offset in sorted(offsets)])
    assert stage.playback.lateness.greatest < 1e-6
    assert stage.playback.published == len(offsets)


@pytest.mark.parametrize("rate", [0.0, -1.0, math.nan, math.inf, -math.inf, 2 * RATE.maximum])
def test_an_impossible_rate_is_refused_and_changes_nothing(rate):
    stage = Stage([0, SECOND])
    with pytest.raises(RequestError, match=r"rate = .* is outside its range \(0, 1e\+06\]"):
        stage.playback.set_rate(rate)
    assert stage.playback.rate == 1.0


@pytest.mark.parametrize("paused", [False, True])
@pytest.mark.parametrize("to", [0, 1, 5])
def test_a_seek_goes_anywhere_and_on_from_there(to, paused):
    stage = Stage(range(0, 6 * SECOND, SECOND))
    stage.run(2.5)
    if paused:
        stage.playback.pause()
    stage.playback.seek(START + to * SECOND)
    assert stage.playback.position == START + to * SECOND
    assert stage.playback.paused == paused
    assert stage.opened[0].gi_frame is None  # closed
    stage.run(10.0)
    expected = [] if paused else [(at * SECOND, (2.5 + at - to) * SECOND) for at in range(to, 6)]
    assert stage.sent[3:] == close_to(expected)


def test_what_is_latched_comes_first_at_the_beginning_and_after_a_seek():
    asked = []

    def latched(position):
        asked.append(position - START)
        return [Message("/latched", position - 1, START, b"")]

    stage = Stage(range(0, 6 * SECOND, SECOND), first=START + 2 * SECOND, latched=latched)
    assert stage.sent == [(2 * SECOND - 1, 0)]
    stage.run(0.5)
    stage.playback.seek(START + 4 * SECOND)
    stage.run(0.5)
    assert asked == [2 * SECOND, 4 * SECOND]
    assert [at for at, _ in stage.sent[1:]] == [2 * SECOND, 4 * SECOND - 1, 4 * SECOND]
    assert stage.playback.published == 2


def test_a_seek_before_the_beginning_or_after_the_end_is_refused():
    stage = Stage([0, SECOND, 9 * SECOND], first=START + SECOND)
    stage.run(0.5)
    with pytest.raises(RequestError, match=r"time = 0\.000 s is before the first, 1700000001\.0"):
        stage.playback.seek(0)
    with pytest.raises(RequestError, match=r"after the last, 1700000009\.0"):
        stage.playback.seek(START + 9 * SECOND + 1)
    assert START + SECOND <= stage.playback.position < START + 2 * SECOND


def test_steps_go_from_message_to_message():
    stage = Stage([0, SECOND, SECOND, 5 * SECOND], start_paused=True, clock=1.0)
    assert stage.run(0.5)
    for position in (0, SECOND, SECOND, 5 * SECOND):
        stage.playback.play_next()
        assert stage.playback.position == START + position
    assert [offset for offset, _ in stage.sent] == [0, SECOND, SECOND, 5 * SECOND]
    # Whoever follows /clock has the time of a message when it comes.
    assert [offset for offset, _ in stage.ticks[1:]] == [0, SECOND, SECOND, 5 * SECOND]
    with pytest.raises(RequestError, match="at its end"):
        stage.playback.play_next()
    assert stage.run(10.0)  # it stays, to be moved back
    stage.playback.seek(START + SECOND)
    stage.playback.pause(False)
    stage.run()
    assert [offset for offset, _ in stage.sent[4:]] == [SECOND, SECOND, 5 * SECOND]


def test_a_loop_begins_again_a_moment_later():
    stage = Stage([0, SECOND], loop=True)
    stage.run(3.25)
    assert stage.sent == close_to(
        [
            (number % 2 * SECOND, number // 2 * 1.1 * SECOND + number % 2 * SECOND)
            for number in range(6)
        ]
    )
    assert all(reading.gi_frame is None for reading in stage.opened[:-1])


def test_the_clock_ticks_by_the_real_time_and_stands_while_it_is_paused():
    stage = Stage([0, SECOND], rate=2.0, clock=10.0)
    stage.run(0.25)
    stage.playback.pause()
    stage.run(0.25)
    stage.playback.pause(False)
    stage.run()
    times = [offset for offset, _ in stage.ticks]
    moving, standing = [0.0, 0.2, 0.4], [0.5, 0.5, 0.5]
    assert times == close_to([at * SECOND for at in [*moving, *standing, 0.7, 0.9]])
    steps = [after - before for (_, before), (_, after) in itertools.pairwise(stage.ticks)]
    assert set(steps) == {SECOND // 10}


changes = st.sampled_from(["pause", "resume", "faster", "slower", "busy", "next"])


@given(
    st.lists(st.integers(0, 20 * SECOND), min_size=1),
    st.lists(st.tuples(st.floats(0.0, 3.0), changes), max_size=20),
)
def test_without_a_seek_nothing_goes_back_and_nothing_is_lost_or_early(offsets, story):
    stage = Stage(offsets, clock=20.0)
    playback = stage.playback
    act = {
        "pause": playback.pause,
        "resume": lambda: playback.pause(False),
        "faster": lambda: playback.set_rate(min(RATE.maximum, playback.rate * 3)),
        "slower": lambda: playback.set_rate(playback.rate / 3),
        "busy": lambda: setattr(stage, "now", stage.now + 2 * SECOND),
        "next": lambda: playback.play_next() if playback.paused and playback._next else None,
    }
    last = START
    for wait, change in story:
        if not stage.run(wait):
            break
        before = playback.position
        assert before >= last
        act[change]()
        if change not in ("busy", "next"):
            assert playback.position == before
        last = playback.position
    playback.set_rate(RATE.maximum)
    playback.pause(False)
    stage.run()
    assert [offset for offset, _ in stage.sent] == sorted(offsets)
    clocks = [offset for offset, _ in stage.ticks]
    assert clocks == sorted(clocks)


def test_what_nothing_paces_is_hurried():
    stage = Stage([0, SECOND, 2 * SECOND])
    stage.run(0.5)
    stage.now += SECOND
    stage.run()
    assert stage.hurried == [False, True, False]
    assert stage.playback.lateness.greatest == pytest.approx(0.5)
    stage = Stage([0, SECOND, 2 * SECOND], rate=2.0)
    stage.run()
    assert stage.hurried == [True, True, True]
    stage = Stage([0, SECOND], start_paused=True)
    stage.playback.play_next()
    assert stage.hurried == [True]


def message(number, size=0):
    return Message("/a", number, number, bytes(size))


@given(st.integers(0, 2000), st.sampled_from([0, 10_000]), st.booleans())
def test_all_come_in_order_and_the_error_where_they_end(count, size, damaged):
    sent = [message(number, size) for number in range(count)]

    def read():
        yield from sent
        if damaged:
            raise BagFormatError("it is damaged")

    ahead = read_ahead(read())
    assert list(itertools.islice(ahead, count)) == sent
    if damaged:
        with pytest.raises(BagFormatError, match="it is damaged"):
            next(ahead)
    assert next(ahead, None) is None


@pytest.mark.parametrize(("size", "least", "most"), [(0, 4096, 6000), (1 << 20, 16, 20)])
def test_it_reads_as_far_as_there_is_room_before_the_first_one_comes(size, least, most):
    taken = 0

    def endless():
        nonlocal taken
        for number in itertools.count(1):
            taken = number
            yield message(number, size)

    ahead = read_ahead(endless())
    assert next(ahead).log_time == 1
    assert taken >= least
    before = -1
    while taken != before:
        before = taken
        threading.Event().wait(0.2)
    assert taken < most
    ahead.close()
    after = taken
    time.sleep(0.05)
    assert taken == after
