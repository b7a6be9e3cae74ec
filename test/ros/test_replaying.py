"""Messages and ticks are due at their times, without drift."""

import itertools
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.bag import Message
from rpud_sim.ros.replaying import Timeline, with_ticks
from rpud_sim.ros.stopping import StopRequest

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND


def messages(*offsets):
    return [Message("/a", START + offset, START, b"") for offset in offsets]


def test_without_ticks_there_are_only_messages():
    events = list(with_ticks(messages(0, 5), START, None))
    assert [(time, message.topic) for time, message in events] == [(START, "/a"), (START + 5, "/a")]


def test_ticks_come_steadily_from_the_start_to_the_last_message():
    events = list(with_ticks(messages(10, 35), START, 10.0))
    assert [(at - START, message is None) for at, message in events] == [
        (0, True),
        (10, True),
        (10, False),
        (20, True),
        (30, True),
        (35, False),
    ]


@given(st.lists(st.integers(0, 10_000), max_size=30), st.floats(1.0, 1e6))
def test_events_are_in_order_and_no_message_is_missing(offsets, period):
    sent = messages(*sorted(offsets))
    events = list(with_ticks(sent, START, period))
    assert [message for _, message in events if message] == sent
    assert all(before[0] <= after[0] for before, after in itertools.pairwise(events))


@pytest.mark.parametrize("rate", [0.5, 1.0, 20.0])
def test_times_are_due_by_the_monotonic_clock_and_the_rate(rate):
    timeline = Timeline(START, time.monotonic(), rate)
    assert timeline.delay(START + SECOND) == pytest.approx(1 / rate, abs=0.1)
    assert timeline.delay(START) <= 0.0


def test_sleeping_ends_when_it_is_due():
    with StopRequest() as stop:
        timeline = Timeline(START, time.monotonic(), 2.0)
        assert not timeline.sleep_until(START + SECOND // 10, stop)
        assert timeline.delay(START + SECOND // 10) <= 0.0


def test_a_stop_ends_any_sleep():
    with StopRequest() as stop:
        stop.request()
        assert Timeline(START, time.monotonic(), 1e-300).sleep_until(START + SECOND, stop)
