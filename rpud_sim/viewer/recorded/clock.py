"""Clock of one drill in a bag: times since the bag began, from the stamps of its messages."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from rpud_sim.foundation.time import SECOND

_BACK = SECOND  # step back of a clock that lateness does not explain [ns]
_AHEAD = 60 * SECOND  # step ahead of a clock that passed time does not explain [ns]

# Stamps and log times of messages in the order of their log times, each of shape (n,) [ns].
Series = tuple[np.ndarray, np.ndarray]


@dataclass(frozen=True)
class Jump:
    """Step of a clock that passed time does not explain, for example at a reset."""

    log_time: int  # of the first message after it [ns]
    step: int  # of the stamps, less the time that passed [ns]


@dataclass(frozen=True)
class Clock:
    """Conversion of stamps to times since the bag began.

    It converts any part of a bag, in any order, because it knows the jumps.
    """

    zero: int | None  # stamp at the beginning of the bag [ns]; None where log times are used
    begin: int  # log time of the beginning [ns]
    jumps: tuple[Jump, ...] = ()  # in their order

    def offset(self, log_time: int) -> int:
        """Return the stamp at time zero, for messages that were logged at a time [ns]."""
        if self.zero is None:
            return self.begin
        return self.zero + sum(jump.step for jump in self.jumps if jump.log_time <= log_time)

    def elapsed(self, stamps: np.ndarray, log_times: np.ndarray) -> np.ndarray:
        """Return times since the bag began [s], of stamps and log times [ns]; all (n,)."""
        if self.zero is None:
            return (log_times - _number(self.begin)) / SECOND
        zero = _number(self.zero)
        if not self.jumps:
            return (stamps - zero) / SECOND
        steps = np.cumsum([0, *(jump.step for jump in self.jumps)], dtype=np.int64)
        times = np.array([jump.log_time for jump in self.jumps], np.int64)
        return (stamps - zero - steps[np.searchsorted(times, log_times, "right")]) / SECOND


def _number(time: int) -> int | float:
    """Return a time for calculations with int64: exact, unless it would not fit [ns]."""
    return time if abs(time) < 2**62 else float(time)


def find_jumps(stamps: np.ndarray, log_times: np.ndarray) -> list[Jump]:
    """Return the jumps in a series of messages, in the order of log times; shapes (n,), [ns]."""
    steps, passed = np.diff(stamps), np.maximum(np.diff(log_times), 0)
    return [
        Jump(int(log_times[place + 1]), int(steps[place] - passed[place]))
        for place in np.flatnonzero((steps < -_BACK) | (steps - passed > _AHEAD)).tolist()
    ]


def zero_stamp(stamps: np.ndarray, log_times: np.ndarray, begin: int) -> int:
    """Return the stamp of a clock at the bag's beginning [ns], from a topic's first message.

    ``stamps`` and ``log_times`` have the shape (n,) [ns]; ``begin`` is a log time [ns].
    """
    others = np.flatnonzero(log_times != log_times[0])
    last = int(others[0]) - 1 if len(others) else -1  # a block is logged after its last row
    return int(stamps[last]) - (int(log_times[0]) - begin)
