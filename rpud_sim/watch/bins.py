"""Rows of numbers with a bounded length: bins of time, and plain rows."""

from __future__ import annotations

import numpy as np


class Rows:
    """The last ``length`` rows of a growing table, in one array; a snapshot costs one copy."""

    def __init__(self, columns: int, length: int) -> None:
        self._length = length
        self._rows = np.full((2 * length, columns), np.nan)
        self.first = self.end = 0  # numbers of the oldest row that is kept, and of the next
        self._place = 0  # of the first row in the array

    def row(self, number: int) -> np.ndarray | None:
        """Return a row to write to, new ones with NaN; None for one that is not kept any more."""
        if number >= self.end:
            self._grow(number + 1)
        if number < self.first:
            return None
        return self._rows[self._place + number - self.first]

    def snapshot(self) -> np.ndarray:
        """Return a read-only copy of all rows."""
        rows = self._rows[self._place : self._place + self.end - self.first].copy()
        rows.flags.writeable = False
        return rows

    def _grow(self, end: int) -> None:
        if end - self.end >= self._length:  # nothing that is kept is worth keeping
            self._rows[:] = np.nan
            self.first, self.end, self._place = end - self._length, end, 0
            return
        if self.first == self.end:
            self.first = self.end = end - 1  # a table begins with its first row
        first = max(self.first, end - self._length)
        self._place += first - self.first
        self.first = first
        if self._place + end - first > len(self._rows):
            kept = self._rows[self._place : self._place + self.end - first].copy()
            self._rows[:] = np.nan
            self._rows[: len(kept)] = kept
            self._place = 0
        self.end = end
