"""Least, mean and greatest value of signals over a run, in bins that grow with it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpud_sim.viewer.impacts import part_length

Layer = dict[str, Any]  # ``t`` [s] and ``mean``, most with ``low`` and ``high``: equal shapes (n,)


class Bins:
    """Bins of several signals, from time 0 on.

    All bins are equally long. A time beyond the last one doubles their length, so that the number
    of bins and the memory stay; with ``newest`` it lets the older half of the bins go instead.
    """

    def __init__(
        self, signals: Sequence[str], width: float, count: int, *, newest: bool = False
    ) -> None:
        self.width = width  # of a bin [s]
        self.first = 0  # number of the oldest bin that is kept
        self._newest = newest
        self.end = 0.0  # latest time [s]
        self._place = {name: place for place, name in enumerate(signals)}
        shape = len(self._place), count
        self._least = np.full(shape, np.inf)
        self._greatest = np.full(shape, -np.inf)
        self._total = np.zeros(shape)
        self._count = np.zeros(shape, np.int64)

    def add(self, signal: str, times: np.ndarray, values: np.ndarray) -> None:
        """Add values at times [s], both of shape (n,); values that are not finite are left out."""
        valid = np.isfinite(values) & (times >= 0.0)
        if not valid.any():
            return
        times, values = times[valid], values[valid].astype(float, copy=False)
        latest = float(times.max())
        self.end = max(self.end, latest)
        while latest >= self.width * (self.first + self._least.shape[1]):
            self._grow(latest)
        place = self._place[signal]
        bins = (times / self.width).astype(np.intp) - self.first
        if bins.min() < 0:  # older than what is kept
            values, bins = values[bins >= 0], bins[bins >= 0]
        if not len(bins):
            return
        if (np.diff(bins) < 0).any():
            order = np.argsort(bins, kind="stable")
            values, bins = values[order], bins[order]
        firsts = np.flatnonzero(np.diff(bins, prepend=-1))
        places = bins[firsts]
        least, greatest = (f.reduceat(values, firsts) for f in (np.minimum, np.maximum))
        self._least[place, places] = np.minimum(self._least[place, places], least)
        self._greatest[place, places] = np.maximum(self._greatest[place, places], greatest)
        self._total[place, places] += np.add.reduceat(values, firsts)
        self._count[place, places] += np.diff(np.append(firsts, len(bins)))

    def has(self, signal: str) -> bool:
        return bool(self._count[self._place[signal]].any())

    def mean(self, signal: str, start: float, end: float) -> float:
        """Return the mean of a signal from a time to another [s], to a bin; NaN without a value."""
        place = self._place[signal]
        first, last = (round(time / self.width) for time in (start, end))
        chosen = slice(first, max(last, first + 1))
        count = self._count[place, chosen].sum()
        return float(self._total[place, chosen].sum() / count) if count else float("nan")

    def view(self, signal: str, start: float, end: float, parts: int) -> Layer:
        """Return least, mean and greatest value in about so many parts of a range of time [s].

        Parts without a value are NaN. They are whole bins, and begin at multiples of their length,
        so that they stay when the range moves.
        """
        joined = max(1, 2 ** int(np.log2(max(1.0, part_length(start, end, parts) / self.width))))
        first = max(0, int(np.floor(start / self.width)) // joined * joined - self.first)
        last = min(int(np.ceil(end / self.width)) + 1 - self.first, self._least.shape[1])
        place = self._place[signal]
        if last <= first:
            return dict.fromkeys(("t", "mean", "low", "high"), np.empty(0))
        starts = np.arange(first, last, joined) - first
        least = np.minimum.reduceat(self._least[place, first:last], starts)
        greatest = np.maximum.reduceat(self._greatest[place, first:last], starts)
        total = np.add.reduceat(self._total[place, first:last], starts)
        count = np.add.reduceat(self._count[place, first:last], starts)
        none = np.full(len(starts), np.nan)
        used = count > 0
        return {
            "t": (self.first + first + starts + 0.5 * joined) * self.width,
            "mean": np.divide(total, count, out=none.copy(), where=used),
            "low": np.where(used, least, none),
            "high": np.where(used, greatest, none),
        }

    def used(self) -> np.ndarray:
        """Return the numbers of bins in which any signal has a value."""
        return self.first + np.flatnonzero(self._count.any(axis=0))

    def _grow(self, latest: float) -> None:
        half = self._least.shape[1] // 2
        if self._newest:
            past = int(latest / self.width) - self.first - 2 * half
            gone = half * (1 + past // half)
            self.first += gone
        else:
            self.width *= 2.0
        for bins, merge, none in (
            (self._least, np.minimum, np.inf),
            (self._greatest, np.maximum, -np.inf),
            (self._total, np.add, 0.0),
            (self._count, np.add, 0),
        ):
            kept = bins[:, gone:].copy() if self._newest else merge(bins[:, ::2], bins[:, 1::2])
            bins[:, : kept.shape[1]] = kept
            bins[:, kept.shape[1] :] = none
