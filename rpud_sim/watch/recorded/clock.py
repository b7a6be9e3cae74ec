"""Clock of one drill in a bag: times since the bag began, from the stamps of its messages."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.report.timeline import clock_jumps


@dataclass(frozen=True)
class Jump:
    """Step of a clock that passed time does not explain, for example at a reset.

    Args:
        log_time: of the first message after it [ns].
        step: of the stamps, less the time that passed [ns].
    """

    log_time: int
    step: int


@dataclass(frozen=True)
class Clock:
    """Conversion of stamps to times since the bag began.

    Unlike ``Timeline`` it converts any part of a bag, in any order, because it knows the jumps.

    Args:
        zero: stamp at the beginning of the bag [ns]; None where log times are used.
        begin: log time of the beginning [ns].
        jumps: in their order.
    """

    zero: int | None
    begin: int
    jumps: tuple[Jump, ...] = ()

    def offset(self, log_time: int) -> int:
        """Return the stamp at time zero, for messages that were logged at a time [ns]."""
        if self.zero is None:
            return self.begin
        return self.zero + sum(jump.step for jump in self.jumps if jump.log_time <= log_time)

    def elapsed(self, stamps: np.ndarray, log_times: np.ndarray) -> np.ndarray:
        """Return times since the bag began [s], shape (n,).

        Args:
            stamps: shape (n,) [ns].
            log_times: of the same messages, shape (n,) [ns].
        """
        if self.zero is None:
            return (log_times - self.begin) / SECOND
        if not self.jumps:
            return (stamps - self.zero) / SECOND
        steps = np.cumsum([0, *(jump.step for jump in self.jumps)], dtype=np.int64)
        times = np.array([jump.log_time for jump in self.jumps], np.int64)
        return (stamps - self.zero - steps[np.searchsorted(times, log_times, "right")]) / SECOND

    def knows(self, jumps: Sequence[Jump]) -> bool:
        """Return whether it has all of these jumps."""
        return {jump.log_time for jump in jumps} <= {jump.log_time for jump in self.jumps}


def find_jumps(stamps: np.ndarray, log_times: np.ndarray) -> list[Jump]:
    """Return the jumps in a series of messages, in the order of their log times.

    Args:
        stamps: shape (n,) [ns].
        log_times: of the same messages, shape (n,) [ns].
    """
    steps, passed = np.diff(stamps), np.maximum(np.diff(log_times), 0)
    return [
        Jump(int(log_times[place + 1]), int(steps[place] - passed[place]))
        for place in np.flatnonzero(clock_jumps(steps, passed)).tolist()
    ]
