"""Deadlines are absolute: simulation time never drifts, and every lateness is counted."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from manual_clock import SECOND, ManualClock

from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.simulation.block import boundary

MILLISECOND = 1_000_000
START = 17 * SECOND


class Run:
    """Blocks that follow each other under a pacer, each with its work."""

    def __init__(self, rate=100, factor=1.0, begin=True):
        self.clock, self.rate, self.number = ManualClock(START), rate, 0
        self.pacer = Pacer(rate, factor, self.clock)
        if begin:
            self.pacer.start(0)

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


@given(st.integers(1, 1000), st.integers(1, 200))
def test_blocks_are_due_at_multiples_of_the_period_forever(rate, count):
    run = Run(rate)
    run.number = 10**7
    run.pacer.start(boundary(run.number, rate))
    for number in range(1, count + 1):
        run.blocks([0])
        # As exact as a float tells the time until the next one.
        assert run.elapsed == boundary(10**7 + number, rate) - boundary(10**7, rate)


def test_work_does_not_make_it_drift():
    run = Run()
    run.blocks([3 * MILLISECOND] * 1000)
    assert run.elapsed == 10 * SECOND + 3 * MILLISECOND
    timing = run.pacer.read()
    assert timing.blocks == 1000
    assert timing.deadlines_missed == 0
    assert timing.lateness == timing.lateness_max == pytest.approx(0.003)
    assert timing.lag == 0.0
    assert timing.real_time_factor == pytest.approx(10.0 / 10.003)


def test_a_late_block_is_made_up_for_without_a_pause_and_counted():
    run = Run()
    run.blocks([0] * 10)
    run.blocks([55 * MILLISECOND])
    sleeps = len(run.clock.slept)
    run.blocks([0] * 5)
    assert len(run.clock.slept) == sleeps
    # Late by 55, 45, 35, 25, 15 and 5 ms: but for the last, by more than a period of 10 ms.
    timing = run.pacer.read()
    assert timing.deadlines_missed == 5
    assert timing.lateness_max == pytest.approx(0.055)
    assert timing.lateness == pytest.approx(0.005)
    run.blocks([0])
    assert run.elapsed == 17 * SECOND // 100
    assert run.pacer.read().lateness == 0.0


def test_a_block_late_by_just_a_period_is_in_time():
    for work, missed in ((10 * MILLISECOND, 0), (10 * MILLISECOND + 1, 1)):
        run = Run()
        run.blocks([work])
        assert run.pacer.read().deadlines_missed == missed


def test_the_lag_is_what_simulation_time_is_behind():
    run = Run()
    run.blocks([0] * 10)
    run.clock.now += 30 * MILLISECOND + 1
    assert run.pacer.read().lag == pytest.approx(0.03)
    run.blocks([0] * 3)
    assert run.pacer.read().lag == 0.0


def test_factor_and_maximum_are_those_since_the_report_before():
    run = Run()
    run.blocks([5 * MILLISECOND] * 100)
    run.pacer.read()
    run.blocks([MILLISECOND] * 100)
    timing = run.pacer.read()
    assert timing.lateness_max == pytest.approx(0.001)
    assert timing.real_time_factor == pytest.approx(1.0, abs=0.01)
    assert timing.blocks == 200
    assert run.pacer.read().real_time_factor == 1.0


def test_quantiles_are_of_all_blocks_since_the_start():
    run = Run()
    for _ in range(100):
        run.blocks([MILLISECOND] * 9 + [5 * MILLISECOND])
        timing = run.pacer.read()
    assert timing.lateness_p50 == pytest.approx(0.001, rel=0.05)
    assert timing.lateness_p99 == timing.lateness_p999 == pytest.approx(0.005, rel=0.05)


@pytest.mark.parametrize("factor", [0.01, 0.1, 0.5, 2.0, 10.0, 1000.0])
def test_simulated_over_elapsed_time_is_the_factor(factor):
    run = Run(factor=factor)
    run.blocks([0] * 300)
    assert run.elapsed == pytest.approx(3 * SECOND / factor, rel=1e-9)
    timing = run.pacer.read()
    assert timing.real_time_factor == pytest.approx(factor, rel=1e-9)
    assert (timing.lag, timing.deadlines_missed) == (0.0, 0)


def test_a_period_is_shorter_where_time_goes_faster():
    for work, missed in ((MILLISECOND, 0), (MILLISECOND + 2, 1)):
        run = Run(factor=10.0)
        run.blocks([work])
        assert run.pacer.read().deadlines_missed == missed
    run = Run(factor=10.0)
    run.blocks([0])
    run.clock.now += 2 * MILLISECOND
    assert run.pacer.read().lag == pytest.approx(0.02)


def test_as_fast_as_possible_nothing_is_waited_for_and_nothing_late():
    run = Run(factor=0.0)
    run.blocks([7 * MILLISECOND] * 100)
    assert run.clock.slept == []
    timing = run.pacer.read()
    assert (timing.deadlines_missed, timing.lateness_max, timing.lag) == (0, 0.0, 0.0)
    assert timing.blocks == 100
    assert timing.real_time_factor == pytest.approx(10.0 / 7.0)


def test_a_pause_is_neither_late_nor_behind_and_the_schedule_goes_on_from_its_end():
    run = Run()
    run.blocks([0] * 10)
    run.pacer.stop()
    run.clock.now += 5 * SECOND
    assert run.pacer.read().lag == 0.0
    run.pacer.start(SECOND // 10)
    run.blocks([0] * 10)
    assert run.elapsed == 5 * SECOND + SECOND // 5
    timing = run.pacer.read()
    assert (timing.lag, timing.lateness_max, timing.deadlines_missed) == (0.0, 0.0, 0)


def test_steps_of_a_paused_simulation_are_counted_and_never_late():
    run = Run(begin=False)
    for number in range(1, 6):
        run.clock.now += SECOND
        run.pacer.finish(boundary(number, 100))
    timing = run.pacer.read()
    assert timing.blocks == 5
    assert (timing.lag, timing.lateness_max, timing.deadlines_missed) == (0.0, 0.0, 0)
    assert timing.real_time_factor == pytest.approx(0.01)


def test_another_factor_holds_from_its_start_on():
    run = Run()
    run.blocks([0] * 100)
    run.pacer.start(SECOND, factor=4.0)
    run.blocks([0] * 100)
    assert run.elapsed == SECOND + SECOND // 4
    run.pacer.start(2 * SECOND)
    run.blocks([0] * 100)
    assert run.elapsed == SECOND + SECOND // 2


class Steps(Run):
    """A schedule of its own that goes in steps, as the clock of another node does."""

    def __init__(self, rate=100):
        super().__init__(rate)
        self.schedule = ManualClock(1000 * SECOND)
        self.pacer = Pacer(rate, 1.0, self.clock, self.schedule)
        self.pacer.start(0, 1000 * SECOND)


def test_a_block_is_due_at_the_step_that_brings_its_end():
    run = Steps()
    run.schedule.now += 9 * MILLISECOND
    assert run.pacer.remaining(10 * MILLISECOND) == pytest.approx(0.001)
    run.schedule.now += 46 * MILLISECOND
    assert run.pacer.remaining(10 * MILLISECOND) <= 0.0
    # One step has brought the ends of five blocks: none of them is late.
    run.blocks([0] * 5)
    assert run.pacer.remaining(60 * MILLISECOND) == pytest.approx(0.005)
    timing = run.pacer.read()
    assert (timing.lateness_max, timing.deadlines_missed) == (0.0, 0)
    assert run.clock.slept == []


def test_who_does_not_keep_up_with_the_steps_is_late():
    run = Steps()
    run.schedule.now += 10 * MILLISECOND
    assert run.pacer.idle(10 * MILLISECOND) == 0.0
    run.schedule.now += 25 * MILLISECOND  # while the block is made
    run.pacer.wait(10 * MILLISECOND)
    run.pacer.finish(10 * MILLISECOND)
    timing = run.pacer.read()
    assert timing.lateness == pytest.approx(0.025)
    assert timing.deadlines_missed == 1
    assert timing.lag == pytest.approx(0.02)


class Sleeper(Run):
    """Blocks that are computed ahead of their deadlines, as the drill does it."""

    def __init__(self, rate=100, factor=1.0, schedule=None):
        super().__init__(rate, factor, begin=False)
        self.pacer = Pacer(rate, factor, self.clock, schedule, self.clock.sleep)
        self.pacer.start(0, None if schedule is None else schedule())


@pytest.mark.parametrize(
    ("rate", "factor", "lead"),
    [
        (100, 1.0, 0.01),
        (10, 1.0, 0.01),
        (1000, 1.0, 0.001),
        (100, 5.0, 0.002),
        (100, 0.1, 0.01),
    ],
)
def test_a_block_is_computed_ahead_of_its_deadline_and_published_at_it(rate, factor, lead):
    run = Sleeper(rate, factor)
    until = boundary(1, rate)
    period = 1.0 / (rate * factor)
    assert run.pacer.idle(until) == pytest.approx(period - lead)
    run.clock.sleep(run.pacer.idle(until))
    assert run.pacer.idle(until) <= 0.0 < run.pacer.remaining(until)
    run.pacer.wait(until)
    assert run.elapsed == pytest.approx(period * SECOND, abs=2)
    run.pacer.wait(until)  # it is there
    assert run.elapsed == pytest.approx(period * SECOND, abs=2)


def test_without_deadlines_nothing_is_computed_ahead_or_waited_for():
    fast = Sleeper(factor=0.0)
    assert (fast.pacer.idle(10 * MILLISECOND), fast.pacer.paces) == (0.0, False)
    held = Sleeper()
    assert held.pacer.paces
    held.pacer.stop()
    assert not held.pacer.paces
    for run in (fast, held):
        run.pacer.wait(10 * MILLISECOND)
        assert run.clock.slept == []


def test_with_another_clock_a_block_waits_for_its_step_and_for_nothing_else():
    schedule = ManualClock(1000 * SECOND)
    run = Sleeper(schedule=schedule)
    until = 10 * MILLISECOND
    schedule.now += 9 * MILLISECOND
    assert run.pacer.idle(until) == pytest.approx(0.001)
    schedule.now += MILLISECOND
    assert run.pacer.idle(until) == 0.0
    schedule.now -= 500 * SECOND  # it goes back while the block is computed
    run.pacer.wait(until)
    assert run.clock.slept == []


def test_a_reset_counts_from_zero_and_holds_the_schedule():
    run = Sleeper()
    run.blocks([15 * MILLISECOND] * 3)
    run.pacer.reset()
    assert not run.pacer.paces
    timing = run.pacer.read()
    assert (timing.blocks, timing.deadlines_missed, timing.lateness_p50) == (0, 0, 0.0)
    assert (timing.lag, timing.lateness) == (0.0, 0.0)
