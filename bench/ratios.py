"""Ratios of two versions' times from pairs of measurements, with intervals and verdicts."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtr, stdtrit

from rpud_sim.inspection.compare.estimates import LEVEL, corrected

SLOWER, FASTER, SAME, INCOMPARABLE = "slower", "faster", "no difference seen", "cannot be compared"
"""Verdicts."""

NEGLIGIBLE = 0.02
"""Smaller differences come from the place of files and memory: copies of one version have them."""

FEWEST = 3
"""Pairs that an interval needs."""


@dataclass(frozen=True)
class Ratio:
    """Time of one version over that of another.

    Attributes:
        name: of the work.
        value: geometric mean over the pairs; NaN if it cannot be compared.
        low, high: 95 % interval by Student's t on the logarithms of the pairs' ratios.
        chance: of a ratio so far beyond ``NEGLIGIBLE`` if there were no difference; corrected for
            the number of comparisons by Holm's method.
        verdict: one of the four.
        reason: why it cannot be compared.
    """

    name: str
    value: float
    low: float
    high: float
    chance: float
    verdict: str
    reason: str = ""

    def beyond(self, threshold: float) -> bool:
        """Return whether it is slower and the whole interval is above a threshold, such as 0.1."""
        return self.verdict == SLOWER and self.low > 1.0 + threshold

    def __str__(self) -> str:
        """Return the verdict in one line."""
        if self.verdict == INCOMPARABLE:
            return f"{self.name}: {self.verdict}: {self.reason}"
        interval = f"{self.low:.3f} to {self.high:.3f}"
        return f"{self.name}: {self.verdict}: {self.value:.3f} times the time ({interval})"


def judge(
    pairs: Mapping[str, Sequence[tuple[float, float]]], reasons: Mapping[str, str] | None = None
) -> list[Ratio]:
    """Return the ratio of the second to the first time for each work.

    Args:
        pairs: times of both versions of each work, one after the other [s].
        reasons: why works cannot be compared, for those that cannot.
    """
    found = {name: _estimate(np.asarray(values, dtype=float)) for name, values in pairs.items()}
    chances = corrected([chance for *_, chance in found.values()])
    ratios = []
    for (name, (value, low, high, _)), chance in zip(found.items(), chances, strict=True):
        verdict = SAME
        if math.isnan(value):
            verdict = INCOMPARABLE
        elif chance < 1.0 - LEVEL:
            verdict = SLOWER if value > 1.0 else FASTER
        reason = f"fewer than {FEWEST} pairs of times" if verdict == INCOMPARABLE else ""
        ratios.append(Ratio(name, value, low, high, chance, verdict, reason))
    nothing = (math.nan,) * 4
    return ratios + [
        Ratio(name, *nothing, INCOMPARABLE, reason) for name, reason in (reasons or {}).items()
    ]


def _estimate(pairs: np.ndarray) -> tuple[float, float, float, float]:
    """Return the ratio, its interval and its chance; NaN if there are too few pairs."""
    if len(pairs) < FEWEST or not (np.isfinite(pairs) & (pairs > 0.0)).all():
        return (math.nan,) * 4
    logarithms = np.log(pairs[:, 1] / pairs[:, 0])
    mean = float(logarithms.mean())
    error = float(logarithms.std(ddof=1)) / math.sqrt(len(pairs))
    freedom = len(pairs) - 1
    reach = float(stdtrit(freedom, 0.5 + 0.5 * LEVEL)) * error
    excess = abs(mean) - math.log1p(NEGLIGIBLE)
    if error > 0.0:
        chance = min(1.0, 2.0 * float(stdtr(freedom, -excess / error)))
    else:
        chance = 0.0 if excess > 0.0 else 1.0
    return math.exp(mean), math.exp(mean - reach), math.exp(mean + reach), chance
