"""Series of a value that changes seldom: its exact times and values, in bounded memory."""

from __future__ import annotations

import numpy as np

_MOST = 1000  # changes


class ChangingValue:
    """Times at which a value changes, until there are too many of them.

    Such a series can be drawn as exact steps, however often its value was reported.
    """

    def __init__(self) -> None:
        self.last = 0.0  # time of the last value [s]
        self._times = np.empty(0)
        self._values = np.empty(0)
        self._exceeded = False

    def add(self, times: np.ndarray, values: np.ndarray) -> None:
        """Add usable values at times since the beginning, both of shape (n,)."""
        if self._exceeded or not len(times):
            return
        before = self._values[-1] if len(self._values) else np.nan
        changed = np.append(values[:1] != before, np.diff(values) != 0.0)
        if len(self._times) + int(np.count_nonzero(changed)) > _MOST:
            self._exceeded = True
            self._times = self._values = np.empty(0)
            return
        self._times = np.append(self._times, times[changed])
        self._values = np.append(self._values, values[changed])
        self.last = float(times[-1])

    def steps(self) -> tuple[np.ndarray, np.ndarray] | None:
        """Return times [s] and the value from each on, both of shape (n,).

        The last time repeats the last value. None if the value changed too often.
        """
        if self._exceeded or not len(self._times):
            return None
        return np.append(self._times, self.last), np.append(self._values, self._values[-1])
