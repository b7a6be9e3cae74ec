"""Deadlines are absolute: simulation time never drifts, and every lateness is counted."""

import time

import pytest

from rpud_sim.ros.pacing import Pacer

MILLISECOND = 1_000_000
SECOND = 1_000_000_000


class Clock:
    """A clock that moves when somebody sleeps or works."""

    def __init__(self, now=17 * SECOND):
        self.now = now
        self.slept = []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        self.slept.append(seconds)
        self.now += round(seconds * SECOND)

    def work(self, nanoseconds):
        self.now += nanoseconds


@pytest.fixture
def clock():
    return Clock()


def run(pacer, clock, works):
    """Go through blocks that take so much work each."""
    for work in works:
        pacer.wait()
        clock.work(work)
        pacer.finish()


@pytest.mark.parametrize("rate", [1, 3, 7, 100, 333, 1000])
def test_blocks_are_due_at_multiples_of_the_period_forever(clock, rate):
    pacer = Pacer(rate, clock, clock.sleep)
    for number in range(1, 5 * rate + 1):
        assert pacer.block_end() == number * SECOND // rate
        pacer.wait()
        assert clock.now == 17 * SECOND + number * SECOND // rate
        pacer.finish()


def test_work_does_not_make_it_drift(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [3 * MILLISECOND] * 1000)
    assert clock.now == 17 * SECOND + 10 * SECOND + 3 * MILLISECOND
    timing = pacer.take()
    assert timing.blocks == 1000
    assert timing.deadlines_missed == 0
    assert timing.lateness == timing.lateness_max == pytest.approx(0.003)
    assert timing.lag == 0.0
    assert timing.real_time_factor == pytest.approx(10.0 / 10.003)


def test_a_late_block_is_made_up_for_without_a_pause_and_counted(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [0] * 10)
    run(pacer, clock, [55 * MILLISECOND])
    sleeps = len(clock.slept)
    assert pacer.block_end() == 12 * SECOND // 100
    run(pacer, clock, [0] * 5)
    assert len(clock.slept) == sleeps
    # Late by 55, 45, 35, 25, 15 and 5 ms: but for the last, by more than a period of 10 ms.
    timing = pacer.take()
    assert timing.deadlines_missed == 5
    assert timing.lateness_max == pytest.approx(0.055)
    assert timing.lateness == pytest.approx(0.005)
    run(pacer, clock, [0])
    assert clock.now == 17 * SECOND + 17 * SECOND // 100
    assert pacer.take().lateness == 0.0


def test_a_block_late_by_just_a_period_is_in_time(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [10 * MILLISECOND])
    assert pacer.take().deadlines_missed == 0
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [10 * MILLISECOND + 1])
    assert pacer.take().deadlines_missed == 1


def test_the_lag_is_what_simulation_time_is_behind(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [0] * 10)
    clock.work(30 * MILLISECOND + 1)
    assert pacer.take().lag == pytest.approx(0.03)
    run(pacer, clock, [0] * 3)
    assert pacer.take().lag == 0.0


def test_who_cannot_keep_up_lags_more_and_more(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [20 * MILLISECOND] * 100)
    timing = pacer.take()
    assert clock.slept == [0.01]
    assert timing.real_time_factor == pytest.approx(0.5, rel=0.01)
    assert timing.lag == pytest.approx(1.01)
    assert timing.deadlines_missed == 99 + 1


def test_factor_and_maximum_are_those_since_the_report_before(clock):
    pacer = Pacer(100, clock, clock.sleep)
    run(pacer, clock, [5 * MILLISECOND] * 100)
    pacer.take()
    run(pacer, clock, [MILLISECOND] * 100)
    timing = pacer.take()
    assert timing.lateness_max == pytest.approx(0.001)
    assert timing.real_time_factor == pytest.approx(1.0, abs=0.01)
    assert timing.blocks == 200
    assert pacer.take().real_time_factor == 1.0


def test_a_real_clock_keeps_its_deadlines():
    began = time.monotonic()
    pacer = Pacer(200)
    for _ in range(40):
        pacer.wait()
        assert time.monotonic() - began >= pacer.block_end() / SECOND
        pacer.finish()
    assert pacer.take().blocks == 40
