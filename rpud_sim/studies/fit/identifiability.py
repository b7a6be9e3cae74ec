"""What the targets determine: intervals of the unknowns, their correlations, and ridges."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping

import numpy as np
from scipy import stats

from rpud_sim.studies.sweep.specification import Range

LEVEL = 0.95  # of the intervals
PERCENT = f"{100.0 * LEVEL:g} %"
_TAIL = 0.5 * (1.0 - LEVEL)
# Distance of the interval from a side, over its width, below which the side cuts the posterior off:
# a normal distribution has a third of its peak there.
_CUT_OFF = 0.05
_WIDE, _NARROW = 0.8, 0.4  # width of an interval over that between the bounds
_RIDGE = 0.6  # rank correlation from which on two unknowns form a ridge


@dataclasses.dataclass(frozen=True)
class Interval:
    """Posterior of one unknown."""

    low: float  # end of the interval of ``LEVEL``, in SI units
    median: float  # of the posterior
    high: float  # other end
    width: float  # of the interval over that between the bounds, on the prior's scale
    at_bound: tuple[str, ...]  # ends that a bound cuts off, ``low`` and ``high``

    @property
    def identified(self) -> str:
        """Whether the targets determine the unknown: ``yes``, ``weakly`` or ``no``."""
        if self.width > _WIDE:
            return "no"
        return "weakly" if self.width > _NARROW else "yes"

    @property
    def digits(self) -> int:
        """Digits that tell both ends from the values between them."""
        width, size = self.high - self.low, max(abs(self.low), abs(self.high))
        return max(4, 2 + math.ceil(math.log10(size / width))) if width > 0.0 else 17

    def __str__(self) -> str:
        return f"{self.low:.{self.digits}g} to {self.high:.{self.digits}g}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the interval has to know, in words."""
        cut = [f"the {end} end is the bound: the true value may be beyond" for end in self.at_bound]
        return (*cut, *([] if self.identified == "yes" else [f"identified: {self.identified}"]))


@dataclasses.dataclass(frozen=True)
class Ridge:
    """Two unknowns of which the targets determine a combination better than each."""

    names: tuple[str, str]  # of the two
    # rank correlation in the posterior; if negative, one falls as the other rises
    correlation: float

    def __str__(self) -> str:
        first, second = self.names
        moves = "rises" if self.correlation > 0.0 else "falls"
        return f"{first} {moves} as {second} rises (rank correlation {self.correlation:.2f})"


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """What the targets determine."""

    intervals: Mapping[str, Interval]  # by unknown
    ridges: tuple[Ridge, ...]  # the strongest first


def cut_off(
    shares: np.ndarray, low: np.ndarray | float = 0.0, high: np.ndarray | float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each column whether the low and the high side cut the distribution off."""
    first, last = np.quantile(shares, (_TAIL, 1.0 - _TAIL), axis=0)
    reach = _CUT_OFF * (last - first)
    return first - low < reach, high - last < reach


def interval_shares(shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of the interval of equally probable points, by column.

    It is the central one. Where a bound cuts the posterior off, the interval begins at the bound:
    the most probable value may be there.
    """
    at_low, at_high = cut_off(shares)
    central = np.quantile(shares, (_TAIL, 1.0 - _TAIL), axis=0)
    least, most = np.quantile(shares, (1.0 - LEVEL, LEVEL), axis=0)
    low = np.where(at_low, 0.0, np.where(at_high, least, central[0]))
    high = np.where(at_high, 1.0, np.where(at_low, most, central[1]))
    return low, high


def identify(shares: np.ndarray, unknowns: Mapping[str, Range]) -> Identifiability:
    """Return what a posterior determines.

    Args:
        shares: equally probable points, as shares of the way between the bounds.
        unknowns: bounds, by name, in the order of the columns.
    """
    names = list(unknowns)
    ends = np.stack([*interval_shares(shares), np.median(shares, axis=0)])
    at_bound = np.stack(cut_off(shares))
    intervals = {}
    for i, (name, bounds) in enumerate(unknowns.items()):
        low, high, median = bounds.at(ends[:, i]).tolist()
        width = min(float(ends[1, i] - ends[0, i]) / LEVEL, 1.0)
        cut = tuple(
            end for end, is_cut in zip(("low", "high"), at_bound[:, i], strict=True) if is_cut
        )
        intervals[name] = Interval(low, median, high, width, cut)
    ranks = np.apply_along_axis(stats.rankdata, 0, shares)
    correlation = np.atleast_2d(np.corrcoef(ranks, rowvar=False))
    pairs = [
        Ridge((names[i], names[j]), float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) >= _RIDGE
    ]
    ridges = tuple(sorted(pairs, key=lambda ridge: -abs(ridge.correlation)))
    return Identifiability(intervals, ridges)
