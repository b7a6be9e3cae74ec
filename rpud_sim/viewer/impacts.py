"""Impacts of a run, and their spread over any range of time."""

from __future__ import annotations

from typing import Any

import numpy as np

MOST = 4_000_000  # impacts that are kept: some two and a half hours of drilling

_FIRST_LENGTH = 1 << 14
_ENDS = (0.05, 0.95)  # quantiles of the band
MOST_OUTLIERS = 200  # of one answer


class Impacts:
    """Times and peak forces of the impacts of a run, by ascending time.

    Beyond ``MOST`` every second one is forgotten: ``stride`` is how many one stands for.
    """

    def __init__(self) -> None:
        self.stride = 1
        self.total = 0  # impacts that were added
        self._skip = 0
        self._count = 0
        self._times = np.empty(_FIRST_LENGTH)
        self._peaks = np.empty(_FIRST_LENGTH, np.float32)
        self._sorted = True

    def add(self, times: np.ndarray, peaks: np.ndarray) -> None:
        """Add impacts, shape (n,) [s] and [N]; in any order, but best in that of time."""
        if not len(times):
            return
        self.total += len(times)
        kept = slice(self._skip, None, self.stride)
        self._skip = (self._skip - len(times)) % self.stride
        with np.errstate(over="ignore"):  # a faulty channel may hold garbage
            times, peaks = times[kept], peaks[kept].astype(np.float32)
        end = self._count + len(times)
        if end > len(self._times):
            for name in ("_times", "_peaks"):
                grown = np.empty(2 * end, getattr(self, name).dtype)
                grown[: self._count] = getattr(self, name)[: self._count]
                setattr(self, name, grown)
        if len(times):
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
        return times[first:last], self._peaks[: self._count][first:last]

    def spread(self, start: float, end: float, parts: int) -> dict[str, Any]:
        """Return the spread of the peak forces in about so many parts of a range of time [s].

        ``low`` and ``high`` are the ends of the band with 90 % of them; without an impact they are
        NaN, as ``mean``. ``outliers`` stand out above the band; ``more`` are not among these.
        Parts begin at multiples of their length, a power of two of milliseconds, so that they stay
        when the range moves.
        """
        width = part_length(start, end, parts)
        first, last = int(np.floor(start / width)), int(np.ceil(end / width))
        edges = np.arange(first, last + 1) * width
        times, peaks = self.between(float(edges[0]), float(edges[-1]))
        finite = np.isfinite(peaks)  # what is not has no place among quantiles
        times, peaks = times[finite], peaks[finite]
        count = last - first
        part = np.minimum((times / width).astype(np.intp) - first, count - 1)
        numbers = np.bincount(part, minlength=count)
        # Sorted within each part: the quantiles are then at known places. One key of both is much
        # faster than a sort by two.
        scale = 0.4 / max(float(np.abs(peaks).max(initial=0.0)), 1e-30)
        ordered = (np.sort(part + scale * peaks.astype(float)) - part) / scale
        ends = np.cumsum(numbers)
        with np.errstate(invalid="ignore", divide="ignore"):
            mean = np.bincount(part, peaks, count) / numbers
        low, high = mean.copy(), mean.copy()
        used = numbers > 0
        for band, share in zip((low, high), _ENDS, strict=True):
            places = (ends - numbers + (share * (numbers - 1)).round().astype(int))[used]
            band[used] = ordered[places]
        # An outlier is as far above the band as the band is wide, at least.
        far = (
            np.flatnonzero(peaks > (high + (high - low))[part]) if len(peaks) else np.empty(0, int)
        )
        chosen = far
        if len(far) > MOST_OUTLIERS:
            chosen = np.sort(far[np.argpartition(-peaks[far], MOST_OUTLIERS)[:MOST_OUTLIERS]])
        more = len(far) - len(chosen)
        outliers = {"t": times[chosen], "v": peaks[chosen], "more": more}
        middles = edges[:-1] + 0.5 * width
        return {"t": middles, "mean": mean, "low": low, "high": high, "outliers": outliers}

    def rate(self, start: float, end: float, parts: int) -> tuple[np.ndarray, np.ndarray]:
        """Return the middles of such parts [s], and the impacts per second in each; shapes (n,)."""
        width = part_length(start, end, parts)
        edges = np.arange(np.floor(start / width), np.ceil(end / width) + 1) * width
        times, _ = self.between(float(edges[0]), float(edges[-1]))
        counts = np.diff(np.searchsorted(times, edges)) * self.stride
        return edges[:-1] + 0.5 * width, counts / width

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
