"""Pacer: absolute deadlines of blocks, and how late each one was."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.lateness import Lateness


@dataclasses.dataclass(frozen=True)
class Timing:
    """How well the schedule was kept.

    Args:
        blocks: blocks finished since the start.
        deadlines_missed: of them, those finished later than one period after their deadline.
        lateness: of the last block, from its deadline to its end [s].
        lateness_max: since the last call of ``Pacer.take`` [s].
        lateness_p50: half of the blocks since the start were not later [s].
        lateness_p99: of all blocks since the start, 99 % were not later [s].
        lateness_p999: of all blocks since the start, 99.9 % were not later [s].
        lag: how far simulation time is behind its schedule, in whole periods [s].
        real_time_factor: simulated time over elapsed time since the last call of ``Pacer.take``.
    """

    blocks: int
    deadlines_missed: int
    lateness: float
    lateness_max: float
    lateness_p50: float
    lateness_p99: float
    lateness_p999: float
    lag: float
    real_time_factor: float


NO_TIMING = Timing(0, 0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # before the start


class Pacer:
    """Deadlines of simulation times, on an absolute schedule.

    From a start on, simulation time t is due t / factor after it, whatever happened before, so that
    it never drifts. A block that is late is made up for by the ones after it, without a pause.

    Args:
        rate: blocks per second of simulation time, a whole number [Hz].
        factor: simulated time over elapsed time; 0 for as fast as possible.
        clock: monotonic time [ns].
        schedule: the time that the schedule follows [ns]; None for the monotonic one. With another
            one, which goes in steps, a block is due at the step that brings its end.
    """

    def __init__(
        self,
        rate: int,
        factor: float = 1.0,
        clock: Callable[[], int] = time.monotonic_ns,
        schedule: Callable[[], int] | None = None,
    ) -> None:
        self._rate = rate
        self._factor = factor
        self._clock = clock
        self._schedule = schedule or clock
        self._in_steps = schedule is not None
        self._begun = 0
        self._running = False
        self._blocks = 0
        self._missed = 0
        self._lateness = 0.0
        self._lateness_max = 0.0
        self._all = Lateness()
        self._start = self._start_time = self._time = 0
        self._taken_at = self._clock()
        self._taken_time = 0

    def start(self, time: int, at: int | None = None, factor: float | None = None) -> None:
        """Begin a schedule: a simulation time [ns] is due at a time of the schedule, now if None.

        Args:
            time: simulation time.
            at: time of the schedule.
            factor: a new one from here on.
        """
        self._running = True
        self._factor = self._factor if factor is None else factor
        self._start = self._schedule() if at is None else at
        self._time = self._start_time = time

    def stop(self) -> None:
        """Hold the schedule: until the next start nothing is due, late or behind."""
        self._running = False

    def remaining(self, time: int) -> float:
        """Time until a simulation time [ns] is due [s], zero or less if it is."""
        if self._factor == 0.0:
            return 0.0
        self._begun = self._schedule()
        return (self._due(time) - self._begun) / SECOND

    def finish(self, time: int) -> None:
        """Note that the block up to a simulation time [ns] is finished."""
        self._blocks += 1
        self._time = time
        if not (self._running and self._factor):
            return
        due = max(self._due(time), self._begun) if self._in_steps else self._due(time)
        late = self._schedule() - due
        lateness = late / SECOND
        self._lateness = lateness
        self._lateness_max = max(self._lateness_max, lateness)
        self._all.add(late)
        if lateness * self._rate * self._factor > 1.0:
            self._missed += 1

    def take(self) -> Timing:
        """Return the timing so far, and begin a new interval for its rates and maxima."""
        now = self._clock()
        elapsed = now - self._taken_at
        behind = 0.0
        if self._running and self._factor:
            scheduled = (self._schedule() - self._start) * self._factor
            behind = max(0.0, scheduled - (self._time - self._start_time)) / SECOND
        timing = Timing(
            blocks=self._blocks,
            deadlines_missed=self._missed,
            lateness=self._lateness,
            lateness_max=self._lateness_max,
            lateness_p50=self._all.quantile(0.5),
            lateness_p99=self._all.quantile(0.99),
            lateness_p999=self._all.quantile(0.999),
            lag=math.floor(behind * self._rate) / self._rate,
            real_time_factor=(self._time - self._taken_time) / elapsed if elapsed > 0 else 1.0,
        )
        self._taken_at = now
        self._taken_time = self._time
        self._lateness_max = 0.0
        return timing

    def _due(self, time: int) -> int:
        return self._start + round((time - self._start_time) / self._factor)
