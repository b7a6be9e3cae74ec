"""Bins of signals over time, and impacts, of a run of any length."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.values import to_float32

Layer = dict[str, Any]  # ``t`` [s] and ``mean``, most with ``low`` and ``high``: equal shapes (n,)

MOST = 4_000_000  # impacts that are kept: some two and a half hours of drilling
MOST_OUTLIERS = 200  # of one answer
GAP = 3.0  # distance of two points, in usual ones, from which on there is a gap between them

CREDIBLE = QUANTITIES["peak_force"].credible  # greatest size of a peak force [N]

_FIRST_LENGTH = 1 << 14
_LEAST_GAP = 0.1  # s
_LEAST_STEPS = 10  # fewer messages have no usual distance
_ENDS = (0.05, 0.95)  # quantiles of the band
# What a bin has: least and greatest value, sum and number of values; how two are merged, and none.
_MERGES = ((np.minimum, np.inf), (np.maximum, -np.inf), (np.add, 0.0), (np.add, 0))


class Bins:
    """Least, mean and greatest value of several signals in bins, from time 0 on.

    All bins are equally long. A time beyond the last one doubles their length, so that the number
    of bins and the memory stay; with ``newest`` it lets the older half of the bins go instead.
    """

    def __init__(
        self, signals: Sequence[str], width: float, count: int, *, newest: bool = False
    ) -> None:
        self.width = width  # of a bin [s]
        self.first = 0  # number of the oldest bin that is kept
        self.end = 0.0  # latest time [s]
        self._newest, self._length = newest, count
        self._place = {name: place for place, name in enumerate(signals)}
        self._bins = [np.full((len(self._place), count), none) for _, none in _MERGES]
        self._used: set[str] = set()

    def add(self, signal: str, times: np.ndarray, values: np.ndarray) -> None:
        """Add values at times [s], both of shape (n,); values that are not finite are left out."""
        valid = np.isfinite(values) & (times >= 0.0)
        if not valid.any():
            return
        times, values = times[valid], values[valid].astype(float, copy=False)
        latest = float(times.max())
        self.end = max(self.end, latest)
        while latest >= self.width * (self.first + self._length):
            self._grow(latest)
        bins = (times / self.width).astype(np.intp) - self.first
        if bins.min() < 0:  # older than what is kept
            values, bins = values[bins >= 0], bins[bins >= 0]
        if not len(bins):
            return
        if (bins[1:] < bins[:-1]).any():
            order = np.argsort(bins, kind="stable")
            values, bins = values[order], bins[order]
        edges = np.concatenate([[0], np.flatnonzero(bins[1:] != bins[:-1]) + 1, [len(bins)]])
        firsts = edges[:-1]
        self._used.add(signal)
        place, places = self._place[signal], bins[firsts]
        found = [merge.reduceat(values, firsts) for merge, _ in _MERGES[:3]]
        found.append(edges[1:] - firsts)
        for kept, (merge, _), new in zip(self._bins, _MERGES, found, strict=True):
            kept[place, places] = merge(kept[place, places], new)

    def has(self, signal: str) -> bool:
        """Return whether a signal has had a value."""
        return signal in self._used

    def used(self, signal: str = "") -> np.ndarray:
        """Return the numbers of bins in which a signal, or any, has a value."""
        counts = self._bins[3]
        held = counts[self._place[signal]] > 0 if signal else counts.any(axis=0)
        return self.first + np.flatnonzero(held)

    def mean(self, signal: str, start: float, end: float) -> float:
        """Return the mean of a signal from a time to another [s], to a bin; NaN without a value."""
        first, last = (round(time / self.width) for time in (start, end))
        chosen = self._place[signal], slice(first, max(last, first + 1))
        total, count = (float(bins[chosen].sum()) for bins in self._bins[2:])
        return total / count if count else float("nan")

    def latest(self, signal: str, start: float, end: float) -> float:
        """Return the mean of the last used bin from a time to another [s]; NaN without a value."""
        chosen = self._place[signal], self._between(start, end)
        total, count = (bins[chosen] for bins in self._bins[2:])
        used = np.flatnonzero(count)
        return float(total[used[-1]] / count[used[-1]]) if len(used) else float("nan")

    def view(self, signal: str, start: float, end: float, parts: int) -> Layer:
        """Return least, mean and greatest value in about so many parts of a range of time [s].

        Parts without a value are NaN. They are whole bins, and begin at multiples of their length,
        so that they stay when the range moves.
        """
        wide = 2 ** int(np.log2(max(1.0, part_length(start, end, parts) / self.width)))
        chosen = self._between(start, end, wide)
        first, place = chosen.start, self._place[signal]
        if chosen.stop == first:
            return dict.fromkeys(("t", "mean", "low", "high"), np.empty(0))
        starts = np.arange(first, chosen.stop, wide) - first
        least, greatest, total, count = (
            merge.reduceat(bins[place, chosen], starts)
            for bins, (merge, _) in zip(self._bins, _MERGES, strict=True)
        )
        none, used = np.full(len(starts), np.nan), count > 0
        return {
            "t": (self.first + first + starts + 0.5 * wide) * self.width,
            "mean": np.divide(total, count, out=none.copy(), where=used),
            "low": np.where(used, least, none),
            "high": np.where(used, greatest, none),
        }

    def _between(self, start: float, end: float, wide: int = 1) -> slice:
        """Return the places of a range of time [s], which begins at a multiple of so many bins."""
        first = max(0, int(np.floor(start / self.width)) // wide * wide - self.first)
        last = min(int(np.ceil(end / self.width)) + 1 - self.first, self._length)
        return slice(first, max(first, last))

    def _grow(self, latest: float) -> None:
        half = self._length // 2
        gone = half * (1 + (int(latest / self.width) - self.first - 2 * half) // half)
        if self._newest:
            self.first += gone
        else:
            self.width *= 2.0
        for bins, (merge, none) in zip(self._bins, _MERGES, strict=True):
            kept = bins[:, gone:].copy() if self._newest else merge(bins[:, ::2], bins[:, 1::2])
            bins[:, : kept.shape[1]] = kept
            bins[:, kept.shape[1] :] = none


class Impacts:
    """Times and peak forces of the impacts of a run, by ascending time.

    Beyond ``MOST`` every second one is forgotten: ``stride`` is how many one represents.
    """

    def __init__(self) -> None:
        self.stride = 1
        self.total = 0  # impacts that were added
        self._skip = 0
        self._count = 0
        self._times, self._peaks = np.empty(_FIRST_LENGTH), np.empty(_FIRST_LENGTH, np.float32)
        self._sorted = True

    def add(self, times: np.ndarray, peaks: np.ndarray) -> None:
        """Add impacts, shape (n,) [s] and [N]; in any order, best in order of time."""
        self.total += len(times)
        kept = slice(self._skip, None, self.stride)
        self._skip = (self._skip - len(times)) % self.stride
        with np.errstate(over="ignore"):  # a faulty channel may hold garbage
            times, peaks = times[kept], to_float32(peaks[kept])
        if not len(times):
            return
        end = self._count + len(times)
        if end > len(self._times):
            self._times = np.resize(self._times, 2 * end)
            self._peaks = np.resize(self._peaks, 2 * end)
        before = self._times[self._count - 1] if self._count else -np.inf
        self._sorted &= bool(times[0] >= before and (np.diff(times) >= 0.0).all())
        self._times[self._count : end], self._peaks[self._count : end] = times, peaks
        self._count = end
        if self._count > MOST:
            self._sort()
            half = (self._count + 1) // 2
            self._times[:half] = self._times[: self._count : 2].copy()
            self._peaks[:half] = self._peaks[: self._count : 2].copy()
            self._count, self.stride, self._skip = half, 2 * self.stride, 0

    def between(self, start: float, end: float) -> tuple[np.ndarray, np.ndarray]:
        """Return times and peak forces of the impacts from ``start`` until before ``end`` [s]."""
        self._sort()
        times = self._times[: self._count]
        first, last = np.searchsorted(times, [start, end])
        return times[first:last], self._peaks[first:last]

    def spread(self, start: float, end: float, parts: int) -> Layer:
        """Return the spread of the peak forces in about so many parts of a range of time [s].

        ``low`` and ``high`` are the ends of the band with 90 % of them; without an impact they are
        NaN, as ``mean``. ``outliers`` are above the band; ``more`` are not among these.
        ``count`` is the number of impacts in a part.
        Parts begin at multiples of their length, a power of two of milliseconds, so that they stay
        when the range moves.
        """
        edges, width = _edges(start, end, parts)
        times, peaks = self.between(float(edges[0]), float(edges[-1]))
        credible = np.abs(peaks) <= CREDIBLE  # garbage has no place among quantiles
        times, peaks = times[credible], peaks[credible]
        count = len(edges) - 1
        part = np.minimum((times / width).astype(np.intp) - round(edges[0] / width), count - 1)
        numbers = np.bincount(part, minlength=count)
        # By part, then by force: the quantiles are at known places. 16 bits are sorted by radix.
        order = np.argsort(peaks)
        order = order[np.argsort(part[order].astype(np.uint16), kind="stable")]
        ordered = peaks[order].astype(float)
        begins = np.cumsum(numbers) - numbers
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(part, peaks, count) / numbers
        low, high, used = mean.copy(), mean.copy(), numbers > 0
        for band, share in zip((low, high), _ENDS, strict=True):
            places = begins + (share * (numbers - 1)).round().astype(int)
            band[used] = ordered[places[used]]
        # An outlier is as far above the band as the band is wide, at least.
        far = np.flatnonzero(peaks > (high + (high - low))[part])
        chosen = far
        if len(far) > MOST_OUTLIERS:
            chosen = np.sort(far[np.argpartition(-peaks[far], MOST_OUTLIERS)[:MOST_OUTLIERS]])
        more = len(far) - len(chosen)
        outliers = {"t": times[chosen], "v": peaks[chosen], "more": more}
        middles = edges[:-1] + 0.5 * width
        layer = {"t": middles, "mean": mean, "low": low, "high": high, "outliers": outliers}
        return {**layer, "count": numbers.astype(np.float32)}

    def rate(self, start: float, end: float, parts: int) -> Layer:
        """Return the impacts per second in such parts as ``mean``."""
        edges, width = _edges(start, end, parts)
        times, _ = self.between(float(edges[0]), float(edges[-1]))
        counts = np.diff(np.searchsorted(times, edges)) * self.stride
        return {"t": edges[:-1] + 0.5 * width, "mean": counts / width}

    def _sort(self) -> None:
        if not self._sorted:
            order = np.argsort(self._times[: self._count], kind="stable")
            self._times[: self._count] = self._times[: self._count][order]
            self._peaks[: self._count] = self._peaks[: self._count][order]
            self._sorted = True


def part_length(start: float, end: float, parts: int) -> float:
    """Return the length of parts of a range [s]: a power of two of milliseconds."""
    wanted = max((end - start) / max(parts, 1), 1e-9)
    return float(1e-3 * 2.0 ** np.ceil(np.log2(wanted / 1e-3)))


def _edges(start: float, end: float, parts: int) -> tuple[np.ndarray, float]:
    """Return the edges of parts of a range, and the length of a part [s]."""
    width = part_length(start, end, parts)
    return np.arange(np.floor(start / width), np.ceil(end / width) + 1) * width, width


def thinned(times: np.ndarray, values: np.ndarray, most: int) -> Layer:
    """Return the least and the greatest value of equal parts of the points, at their own times.

    So no peak is lost, and every point is one of those given. ``times`` ascend [s] and ``values``
    have no NaN, both of shape (n,). The result has at most ``most`` points.
    """
    if len(times) <= most:
        return {"t": times, "mean": values}
    edges = np.linspace(0, len(times), max(1, most // 2) + 1).astype(np.intp)
    width = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    parts = values[places]
    rows = np.arange(len(places))
    both = np.column_stack([places[rows, parts.argmin(1)], places[rows, parts.argmax(1)]])
    kept = np.unique(np.concatenate([[0], both.ravel(), [len(times) - 1]]))
    return {"t": times[kept], "mean": values[kept]}


def with_gaps(layer: Layer) -> Layer:
    """Return a layer without its NaN, and with NaN between points that are far apart."""
    valid = np.isfinite(layer["mean"])
    layer = {name: values[valid] for name, values in layer.items()}
    times = layer["t"]
    steps = np.diff(times)
    places = np.flatnonzero(steps > GAP * max(usual(steps), 1e-9)) + 1
    middles = 0.5 * (times[places - 1] + times[places])
    return {
        name: np.insert(values, places, middles if name == "t" else np.nan)
        for name, values in layer.items()
    }


def gaps_of(used: np.ndarray, width: float) -> list[tuple[float, float]]:
    """Return gaps between used bins that are much longer than usual, from and to [s]."""
    steps = np.diff(used)
    if len(steps) < _LEAST_STEPS:
        return []
    longest = max(GAP * usual(steps), _LEAST_GAP / width)
    places = np.flatnonzero(steps > longest)
    return [((int(used[i]) + 1) * width, int(used[i + 1]) * width) for i in places]


def usual(steps: np.ndarray) -> float:
    """Return the usual distance between points: nine of ten are not longer."""
    return float(np.quantile(steps, 0.9, method="lower")) if len(steps) else 0.0
