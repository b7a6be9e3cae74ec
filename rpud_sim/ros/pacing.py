"""Pacing: block by block against absolute deadlines, with every lateness counted."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable

NANOSECONDS = 1_000_000_000


@dataclasses.dataclass(frozen=True)
class Timing:
    """How well the schedule was kept.

    Args:
        blocks: blocks finished since the start.
        deadlines_missed: of them, those finished later than one period after their deadline.
        lateness: of the last block, from its deadline to its end [s].
        lateness_max: since the last call of ``Pacer.take`` [s].
        lag: how far simulation time is behind its schedule [s].
        real_time_factor: simulated time over elapsed time since the last call of ``Pacer.take``.
    """

    blocks: int
    deadlines_missed: int
    lateness: float
    lateness_max: float
    lag: float
    real_time_factor: float


class Pacer:
    """Deadlines of blocks of equal length.

    Block n, from 1, is due at the start plus n periods, whatever happened before: simulation time
    never drifts. A block that is late is made up for by the ones after it, without a pause.

    Args:
        rate: blocks per second, a whole number [Hz].
        clock: monotonic time [ns].
        sleep: waits for some seconds.
    """

    def __init__(
        self,
        rate: int,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rate = rate
        self._clock = clock
        self._sleep = sleep
        self._start = clock()
        self._blocks = 0
        self._missed = 0
        self._lateness = 0.0
        self._lateness_max = 0.0
        self._taken_at = self._start
        self._taken_blocks = 0

    def block_end(self) -> int:
        """Simulation time at which the block in progress ends [ns], exact for any rate."""
        return (self._blocks + 1) * NANOSECONDS // self._rate

    def wait(self) -> None:
        """Sleep until the block in progress is due; return at once if it already is."""
        remaining = self._start + self.block_end() - self._clock()
        if remaining > 0:
            self._sleep(remaining / NANOSECONDS)

    def finish(self) -> None:
        """Note that the block in progress is finished; the next one begins."""
        lateness = (self._clock() - self._start - self.block_end()) / NANOSECONDS
        self._blocks += 1
        self._lateness = lateness
        self._lateness_max = max(self._lateness_max, lateness)
        if lateness * self._rate > 1.0:
            self._missed += 1

    def take(self) -> Timing:
        """Return the timing so far, and begin a new interval for its rates and maxima."""
        now = self._clock()
        elapsed = now - self._taken_at
        simulated = (self._blocks - self._taken_blocks) * NANOSECONDS / self._rate
        due = (now - self._start) * self._rate // NANOSECONDS
        timing = Timing(
            blocks=self._blocks,
            deadlines_missed=self._missed,
            lateness=self._lateness,
            lateness_max=self._lateness_max,
            lag=max(0, due - self._blocks) / self._rate,
            real_time_factor=simulated / elapsed if elapsed > 0 else 1.0,
        )
        self._taken_at = now
        self._taken_blocks = self._blocks
        self._lateness_max = 0.0
        return timing
