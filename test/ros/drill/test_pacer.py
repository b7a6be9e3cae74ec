"""Deadlines are absolute: simulation time never drifts, and every lateness is counted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import SECOND, ManualClock

from rpud_sim.ros.drill.timeline import Pacer
from rpud_sim.simulation.block import boundary

MILLISECOND = 1_000_000
PERIOD = 10 * MILLISECOND
START = 17 * SECOND


class Run:
    """Blocks that follow each other under a pacer, each with its work."""

    def __init__(self, rate=100, factor=1.0, schedule=None, number=0):
        self.clock, self.rate, self.number = ManualClock(START), rate, number
        self.pacer = Pacer(rate, schedule, self.clock, self.clock.sleep)
        self.pacer.start(boundary(number, rate), factor)

    def blocks(self, works):
        for work in works:
            self.number += 1
            until = boundary(self.number, self.rate)
            if (remaining := self.pacer.remaining(until)) > 0.0:
                self.clock.sleep(remaining)
            self.clock.now += work
            self.pacer.finish(until)

    @property
    def elapsed(self):
        return self.clock.now - START

    def read(self, *names):
        """Give some of the timing."""
        timing = self.pacer.read()
        return tuple(timing[name] for name in names)


LATENESS = ("lag", "lateness_max", "deadlines_missed")


@given(st.integers(1, 1000), st.integers(1, 200))
def test_blocks_are_due_at_multiples_of_the_period_forever(rate, count):
    run = Run(rate, number=10**7)
    for number in range(1, count + 1):
        run.blocks([0])
        # As exact as a float tells the time until the next one.
        assert run.elapsed == boundary(10**7 + number, rate) - boundary(10**7, rate)


def test_a_late_block_is_made_up_for_without_a_pause_and_counted():
    run = Run()
    run.blocks([0] * 10)
    run.blocks([55 * MILLISECOND])
    sleeps = len(run.clock.slept)
    run.blocks([0] * 5)
    assert len(run.clock.slept) == sleeps
    # Late by 55, 45, 35, 25, 15 and 5 ms: but for the last, by more than a period of 10 ms.
    found = run.read("deadlines_missed", "lateness_max", "lateness")
    assert found == pytest.approx((5, 0.055, 0.005))
    run.blocks([0])
    assert run.elapsed == 17 * PERIOD
    assert run.read("lateness") == (0.0,)


def test_as_fast_as_possible_nothing_is_waited_for_and_nothing_late():
    run = Run(factor=0.0)
    run.blocks([7 * MILLISECOND] * 100)
    run.pacer.wait(PERIOD)
    assert (run.pacer.idle(PERIOD), run.pacer.paces, run.clock.slept) == (0.0, False, [])
    assert run.read(*LATENESS, "blocks", "real_time_factor") == pytest.approx(
        (0.0, 0.0, 0, 100, 10.0 / 7.0)
    )


def test_a_pause_and_its_steps_are_neither_late_nor_behind_and_a_start_has_its_own_factor():
    run = Run()
    run.blocks([0] * 10)
    run.pacer.stop()
    run.clock.now += 5 * SECOND
    run.pacer.wait(11 * PERIOD)
    run.pacer.finish(11 * PERIOD)
    run.number += 1
    assert run.read(*LATENESS, "blocks") == (0.0, 0.0, 0, 11)
    run.pacer.start(11 * PERIOD, 4.0)
    run.blocks([0] * 100)
    assert run.elapsed == 10 * PERIOD + 5 * SECOND + SECOND // 4
    assert run.read(*LATENESS) == (0.0, 0.0, 0)


@pytest.fixture
def schedule():
    """A clock that goes in steps, as that of another node does."""
    return ManualClock(1000 * SECOND)


def test_a_block_is_due_at_the_step_that_brings_its_end(schedule):
    run = Run(schedule=schedule)
    schedule.now += 9 * MILLISECOND
    assert run.pacer.idle(PERIOD) == run.pacer.remaining(PERIOD) == pytest.approx(0.001)
    schedule.now += 46 * MILLISECOND
    assert run.pacer.remaining(PERIOD) <= 0.0
    # One step has brought the ends of five blocks: none of them is late.
    run.blocks([0] * 5)
    assert run.pacer.remaining(6 * PERIOD) == pytest.approx(0.005)
    assert run.read(*LATENESS) == (0.0, 0.0, 0)
    schedule.now -= 500 * SECOND  # it goes back while a block is computed
    run.pacer.wait(6 * PERIOD)
    assert run.clock.slept == []


def test_who_does_not_keep_up_with_the_steps_is_late(schedule):
    run = Run(schedule=schedule)
    schedule.now += PERIOD
    assert run.pacer.idle(PERIOD) == 0.0
    schedule.now += 25 * MILLISECOND  # while the block is made
    run.pacer.finish(PERIOD)
    assert run.read("lateness", "deadlines_missed", "lag") == pytest.approx((0.025, 1, 0.02))
