"""The position in a bag follows a clock, and whatever changes leaves it where it is."""

from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.ros.replay.timeline import Timeline

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
NOW = 5_000 * SECOND

rates = st.floats(1e-3, 1e3)
waits = st.integers(0, 1000 * SECOND)
changes = st.one_of(
    st.just(lambda timeline, now: timeline.pause(now)),
    st.just(lambda timeline, now: timeline.resume(now)),
    rates.map(lambda rate: lambda timeline, now: timeline.with_rate(now, rate)),
)


def test_it_moves_as_many_times_as_fast_as_the_clock():
    timeline = Timeline(START, NOW, 4.0)
    assert timeline.position_at(NOW) == START
    assert timeline.position_at(NOW + SECOND) == START + 4 * SECOND
    assert timeline.due(START + 4 * SECOND) == NOW + SECOND


def test_it_stands_until_it_begins():
    assert Timeline(START, NOW).position_at(NOW - SECOND) == START


def test_it_stands_while_it_is_paused_and_nothing_is_due():
    timeline = Timeline(START, NOW, 2.0).pause(NOW + SECOND)
    assert timeline.position_at(NOW + 100 * SECOND) == START + 2 * SECOND
    assert timeline.due(START + 2 * SECOND) == inf
    timeline = timeline.resume(NOW + 100 * SECOND)
    assert timeline.position_at(NOW + 101 * SECOND) == START + 4 * SECOND


def test_a_seek_moves_it_and_nothing_else():
    timeline = Timeline(START, NOW, 2.0, paused=True).seek(NOW + 7, START + SECOND)
    assert timeline == Timeline(START + SECOND, NOW + 7, 2.0, paused=True)


@given(st.lists(st.tuples(waits, changes)), rates)
def test_no_change_but_a_seek_moves_it(steps, rate):
    timeline, now = Timeline(START, NOW + 10, rate), NOW
    for wait, change in steps:
        now += wait
        before = timeline.position_at(now)
        timeline = change(timeline, now)
        assert timeline.position_at(now) == before


@given(st.lists(st.tuples(waits, changes)), rates)
def test_it_never_goes_back(steps, rate):
    timeline, now, last = Timeline(START, NOW, rate), NOW, START
    for wait, change in steps:
        timeline = change(timeline, now)
        now += wait
        assert timeline.position_at(now) >= last
        last = timeline.position_at(now)


@given(st.integers(0, 1000 * SECOND), rates)
def test_what_is_due_is_reached_when_it_is_due(offset, rate):
    timeline = Timeline(START, NOW, rate)
    due = timeline.due(START + offset)
    assert due >= NOW
    # A float of the clock's nanoseconds is good to some hundreds of them in years of uptime.
    assert timeline.position_at(round(due)) == pytest.approx(START + offset, abs=max(2.0, 2 * rate))
