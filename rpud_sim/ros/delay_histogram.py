"""Histogram of delays, in bounded memory."""

from __future__ import annotations

from bisect import bisect_left
from collections import Counter
from math import inf

_STEPS_PER_OCTAVE = 16  # bounds are 4.4 % apart
_OCTAVES = 64
# Delays below a microsecond are one step. To look up the bound is quicker than its logarithm.
_BOUNDS = [1e3 * 2 ** (step / _STEPS_PER_OCTAVE) for step in range(_OCTAVES * _STEPS_PER_OCTAVE)]
_BOUNDS.append(inf)


class DelayHistogram:
    """Histogram of delays; an early or punctual event counts as zero."""

    def __init__(self) -> None:
        self._counts: Counter[int] = Counter()
        self._greatest = 0.0

    @property
    def count(self) -> int:
        return self._counts.total()

    def add(self, nanoseconds: float) -> None:
        """Add a delay [ns]."""
        self._counts[bisect_left(_BOUNDS, nanoseconds)] += 1
        if nanoseconds > self._greatest:
            self._greatest = nanoseconds

    def quantile(self, share: float) -> float:
        """Return the delay [s] that a share of all do not exceed, up to 4.4 % or 1 us too large."""
        wanted = share * self.count
        for step in sorted(self._counts):
            wanted -= self._counts[step]
            if wanted <= 0:
                return min(_BOUNDS[step], self._greatest) / 1e9
        return self.greatest

    @property
    def greatest(self) -> float:
        """Greatest delay [s]; 0 without any."""
        return self._greatest / 1e9

    def __str__(self) -> str:
        """Return median, 99 % quantile and maximum in milliseconds."""
        return (
            f"late {1e3 * self.quantile(0.5):.3g} ms (median), "
            f"{1e3 * self.quantile(0.99):.3g} ms (99 %), {1e3 * self.greatest:.3g} ms (most)"
        )
