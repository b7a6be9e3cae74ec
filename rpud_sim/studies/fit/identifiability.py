"""What the targets determine: intervals of the unknowns, their correlations, and ridges."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np
from scipy import stats

LEVEL = 0.90  # of the intervals
_WIDE, _NARROW = 0.8, 0.4  # width of an interval over that between the bounds
_RIDGE = 0.6  # rank correlation from which on two unknowns form a ridge


@dataclasses.dataclass(frozen=True)
class Interval:
    """Posterior of one unknown."""

    low: float  # end of the interval of ``LEVEL``, in SI units
    median: float  # of the posterior
    high: float  # other end
    # of the interval over that of the same level between the bounds, on the prior's scale
    width: float

    @property
    def identified(self) -> str:
        """Whether the targets determine the unknown: ``yes``, ``weakly`` or ``no``."""
        if self.width > _WIDE:
            return "no"
        return "weakly" if self.width > _NARROW else "yes"


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
class Direction:
    """Principal direction of the posterior, in shares of the way between the bounds."""

    width: float  # standard deviation over that of the prior; near 1, nothing is determined
    parts: Mapping[str, float]  # of each unknown, by name; their squares add up to one


@dataclasses.dataclass(frozen=True)
class Identifiability:
    """What the targets determine."""

    intervals: Mapping[str, Interval]  # by unknown
    correlation: np.ndarray  # rank correlations, shape (unknowns, unknowns)
    ridges: tuple[Ridge, ...]  # the strongest first
    directions: tuple[Direction, ...]  # the widest first


def interval_shares(shares: np.ndarray, level: float = LEVEL) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of the central interval of equally probable points, by column."""
    low, high = np.quantile(shares, (0.5 - 0.5 * level, 0.5 + 0.5 * level), axis=0)
    return low, high


def identify(shares: np.ndarray, values: Mapping[str, np.ndarray]) -> Identifiability:
    """Return what a posterior determines.

    Args:
        shares: equally probable points, as shares of the way between the bounds.
        values: the same points in SI units, by unknown.
    """
    names = list(values)
    low, high = interval_shares(shares)
    intervals = {}
    for i, (name, column) in enumerate(values.items()):
        ends = interval_shares(column)
        width = float((high[i] - low[i]) / LEVEL)
        intervals[name] = Interval(float(ends[0]), float(np.median(column)), float(ends[1]), width)
    ranks = np.apply_along_axis(stats.rankdata, 0, shares)
    correlation = np.atleast_2d(np.corrcoef(ranks, rowvar=False))
    pairs = [
        Ridge((names[i], names[j]), float(correlation[i, j]))
        for i in range(len(names))
        for j in range(i + 1, len(names))
        if abs(correlation[i, j]) >= _RIDGE
    ]
    covariance = np.atleast_2d(np.cov(shares, rowvar=False)) * 12.0  # in units of the prior's
    variances, vectors = np.linalg.eigh(covariance)
    directions = tuple(
        Direction(
            float(np.sqrt(max(variances[i], 0.0))),
            {name: float(part) for name, part in zip(names, vectors[:, i], strict=True)},
        )
        for i in range(len(names))[::-1]
    )
    ridges = tuple(sorted(pairs, key=lambda ridge: -abs(ridge.correlation)))
    return Identifiability(intervals, correlation, ridges, directions)
