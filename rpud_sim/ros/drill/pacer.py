"""Absolute deadlines of blocks."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.threads import DelayHistogram
from rpud_sim.simulation.topics import Fields

# A block is computed this long before its deadline, or right after the block before [s]. Requests
# and parameters wait for its end from then on: with a longer lead services would answer late.
LEAD = 0.01


class Pacer:
    """Deadlines of simulation times, on an absolute schedule of blocks at a whole rate [Hz].

    From a start on, simulation time t is due t / factor after it, whatever happened before, so that
    it never drifts; 0 is as fast as possible. A block that is late is made up for by the ones after
    it, without a pause. Another ``schedule`` [ns] than the monotonic ``clock`` [ns] goes in steps:
    a block is due at the step that brings its end.
    """

    def __init__(
        self,
        rate: int,
        schedule: Callable[[], int] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rate = rate
        self._factor = 1.0
        self._clock = clock
        self._schedule = schedule or clock
        self._in_steps = schedule is not None
        self._sleep = sleep
        self.reset()

    @property
    def paces(self) -> bool:
        """Whether blocks have deadlines: it is started, and the factor is not zero."""
        return self._running and self._factor != 0.0

    @property
    def ahead(self) -> bool:
        """Whether blocks are computed ahead of their deadlines."""
        return self.paces and not self._in_steps

    def reset(self) -> None:
        """Count from zero, and hold the schedule until the next start."""
        self._running = False
        self._blocks = self._missed = 0
        self._lateness = self._lateness_max = 0.0
        self._all = DelayHistogram()  # latenesses
        self._start = self._start_time = self._time = self._read_time = 0
        self._begun = 0  # when the remaining time was asked for last, on the schedule
        self._read_at = self._clock()

    def start(self, time: int, factor: float, at: int | None = None) -> None:
        """Begin a schedule: simulation time [ns] is due at a time of the schedule, now if None."""
        self._running = True
        self._factor = factor
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

    def idle(self, time: int) -> float:
        """Time until the block that ends at a simulation time [ns] is to be computed [s].

        That is 10 ms before its deadline or a whole block, whichever is less. With another schedule
        it is at the deadline: that time may stand still just then, and requests would wait with it.
        """
        lead = min(LEAD, 1.0 / (self._rate * self._factor)) if self.ahead else 0.0
        return self.remaining(time) - lead

    def wait(self, time: int) -> None:
        """Sleep until the deadline of a block that was computed ahead of it.

        Without effect with another schedule: its blocks are computed at their deadlines, and it may
        have gone back meanwhile.
        """
        if self.ahead and (early := self.remaining(time)) > 0.0:
            self._sleep(early)

    def delay_since(self, time: int) -> int:
        """Return how long ago a simulation time [ns] was due [ns]."""
        return self._schedule() - self._due(time)

    def finish(self, time: int) -> None:
        """Note that the block up to a simulation time [ns] is finished: all of it is published."""
        self._blocks += 1
        self._time = time
        if not self.paces:
            return
        due = max(self._due(time), self._begun) if self._in_steps else self._due(time)
        late = self._schedule() - due
        self._all.add(late)
        self._lateness = late / SECOND
        self._lateness_max = max(self._lateness_max, self._lateness)
        if self._lateness * self._rate * self._factor > 1.0:
            self._missed += 1

    def read(self) -> Fields:
        """Return the timing so far by name [s], and begin an interval for its rate and maximum.

        ``lag`` is how far simulation time is behind its schedule, in whole periods. Quantiles of
        the lateness, from deadline to end of a block, are of all blocks since the start.
        """
        now = self._clock()
        elapsed = now - self._read_at
        behind = 0.0
        if self.paces:
            scheduled = (self._schedule() - self._start) * self._factor
            behind = max(0.0, scheduled - (self._time - self._start_time)) / SECOND
        timing = {
            "blocks": self._blocks,
            "deadlines_missed": self._missed,  # blocks that were later than one period
            "lateness": self._lateness,  # of the last block
            "lateness_max": self._lateness_max,  # of the interval
            "lateness_p50": self._all.quantile(0.5),
            "lateness_p99": self._all.quantile(0.99),
            "lateness_p99.9": self._all.quantile(0.999),
            "lag": math.floor(behind * self._rate) / self._rate,
            # simulated over elapsed time in the interval
            "real_time_factor": (self._time - self._read_time) / elapsed if elapsed > 0 else 1.0,
        }
        self._read_at, self._read_time = now, self._time
        self._lateness_max = 0.0
        return timing

    def _due(self, time: int) -> int:
        return self._start + round((time - self._start_time) / self._factor)
