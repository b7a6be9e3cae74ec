"""Times of messages since the beginning of a bag, from the stamps of their clock."""

from __future__ import annotations

import numpy as np

from rpud_sim.foundation.time import SECOND

_BACK = SECOND  # step back of a clock that lateness does not explain [ns]
_AHEAD = 60 * SECOND  # step ahead of a clock that passed time does not explain [ns]
_OLDEST = 86_400 * SECOND  # greatest age of a latched message; older ones have another clock [ns]


class Timeline:
    """Conversion of stamps to times since the bag began, also if their clock is set meanwhile.

    ``begin`` is the log time at which the bag begins [ns]. ``zero`` is the stamp at that time, if
    another topic of the same clock shows it [ns]. With ``latched`` the first messages may be older
    than the bag.
    """

    def __init__(self, begin: int, zero: int | None = None, *, latched: bool = False) -> None:
        self._begin = begin
        self._zero = zero
        self._latched = latched
        self._offset: int | None = None
        self._stamp = 0
        self._log_time = 0
        self.jumps = 0  # how often the clock was set, for example by a reset

    def elapsed(self, stamps: np.ndarray, log_times: np.ndarray) -> np.ndarray:
        """Return times since the bag began [s], of stamps and log times in order [ns]; all (n,)."""
        if not len(stamps):
            return np.empty(0)
        if self._offset is None:
            old = self._old(stamps)
            if old:
                rest = self.elapsed(stamps[old:], log_times[old:])
                return np.append((stamps[:old] - self._zero) / SECOND, rest)
            self._stamp, self._log_time = int(stamps[0]), int(log_times[0])
            self._offset = zero_stamp(stamps, log_times, self._begin)
            # A stamp far from the others is of another clock, or of one that was set before it.
            if self._zero is not None and -_AHEAD < self._zero - self._offset < _BACK:
                self._offset = self._zero
        steps = np.diff(stamps, prepend=self._stamp)
        passed = np.maximum(np.diff(log_times, prepend=self._log_time), 0)
        jumped = clock_jumps(steps, passed)
        offsets = self._offset + np.cumsum(np.where(jumped, steps - passed, 0))
        self._stamp, self._log_time = int(stamps[-1]), int(log_times[-1])
        self._offset = int(offsets[-1])
        self.jumps += int(np.count_nonzero(jumped))
        return (stamps - offsets) / SECOND

    def _old(self, stamps: np.ndarray) -> int:
        """Return the number of a latched topic's first stamps that are older than the bag."""
        if self._zero is None or not self._latched:
            return 0
        older = (stamps < self._zero) & (self._zero - stamps < _OLDEST)
        return len(stamps) if older.all() else int(np.argmin(older))


def clock_jumps(steps: np.ndarray, passed: np.ndarray) -> np.ndarray:
    """Return which steps between stamps are jumps of their clock, shape (n,).

    ``steps`` are from each stamp to the next one, ``passed`` is the time meanwhile; shapes (n,)
    [ns].
    """
    return (steps < -_BACK) | (steps - passed > _AHEAD)


def zero_stamp(stamps: np.ndarray, log_times: np.ndarray, begin: int) -> int:
    """Return the stamp of a clock at the bag's beginning [ns], from a topic's first message.

    ``stamps`` and ``log_times`` have the shape (n,) [ns]; ``begin`` is a log time [ns].
    """
    others = np.flatnonzero(log_times != log_times[0])
    last = int(others[0]) - 1 if len(others) else -1  # a block is logged after its last row
    return int(stamps[last]) - (int(log_times[0]) - begin)
