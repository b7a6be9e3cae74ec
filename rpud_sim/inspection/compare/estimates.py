"""Figures of one run with their intervals, and the differences of two runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtr, stdtrit

from rpud_sim.inspection.compare.block_bootstrap import mean_error
from rpud_sim.inspection.compare.values import MEAN, MEDIAN, P95, ComparedQuantity
from rpud_sim.pages.quantities import NONE, Quantity

LEVEL = 0.95  # confidence level of all intervals

_LARGEST_LOGARITHM = 700.0
_ROUNDING = 1e-9  # relative; smaller differences come from the rounding of numbers
_SHARES = {MEDIAN: 0.5, P95: 0.95}
_CLEARLY_NOT_ZERO = 3.0  # standard errors from zero that a reference of a ratio needs

_PERCENT = Quantity("relative", "relative difference", "%", 100.0, floor=1e-5)

# Decisions on a difference.
DIFFERS, SAME, EQUIVALENT, UNDECIDED, TOO_FEW = (
    "differs",
    "no difference found",
    "equivalent",
    "undecided",
    "too few values",
)


@dataclass(frozen=True)
class Estimate:
    """Figure of a run with its interval, in the unit of its quantity."""

    value: float  # the figure; NaN if there are no values
    error: float  # standard error by the stationary bootstrap; NaN if it cannot be told
    blocks: float
    low: float  # low, high: 95 % confidence interval; NaN if it cannot be told
    high: float
    count: int


@dataclass(frozen=True)
class FigureDifference:
    """Difference of one figure between a run and the reference."""

    compared: ComparedQuantity
    figure: str  # mean, median or p95
    reference: Estimate
    other: Estimate
    value: float  # other minus reference, in the unit of the quantity
    low: float  # low, high: its 95 % confidence interval; NaN if it cannot be told
    high: float
    # relative, relative_low, relative_high: ratio minus one, and its interval; NaN where the
    # reference may be zero.
    relative: float
    relative_low: float
    relative_high: float
    # Probability of so large a difference, or excess over the tolerance, if there were none;
    # corrected for the number of comparisons. NaN where nothing is decided.
    chance: float
    decision: str

    @property
    def quantity(self) -> str:
        """Name of the quantity."""
        return self.compared.name

    @property
    def texts(self) -> tuple[str, str, str, str]:
        """Both figures, value and interval: relative, if known, or in the quantity's unit."""
        shown = self.compared.shown
        figures = shown.text(self.reference.value), shown.text(self.other.value)
        value, low, high = self.value, self.low, self.high
        if math.isfinite(self.relative):
            value, low, high = self.relative, self.relative_low, self.relative_high
            shown = _PERCENT
        interval = f"{shown.text(low, unit=False, sign=True)} to {shown.text(high, sign=True)}"
        known = math.isfinite(low) and math.isfinite(high)
        return *figures, shown.text(value, sign=True), interval if known else NONE


def estimate(values: np.ndarray, figure: str, resolution: float = 0.0) -> Estimate:
    """Return a figure of a series with its interval.

    The interval of a quantile is that of the share of values below it (Woodruff 1952): so it needs
    no density, and is never outside the values. ``values`` are finite, in their order, shape (n,).
    ``figure`` is mean, median or p95. ``resolution`` is the size of the rounding of the values, in
    their unit.
    """
    count = len(values)
    if not count:
        return Estimate(math.nan, math.nan, 0.0, math.nan, math.nan, 0)
    value = float(values.mean() if figure == MEAN else np.quantile(values, _SHARES[figure]))
    if count < 4:
        return Estimate(value, math.nan, 0.0, math.nan, math.nan, count)
    floor = max(_ROUNDING * abs(value), resolution)
    if figure == MEAN:
        found = mean_error(values)
        error = math.hypot(found.error, floor)
        reach = _reach(found.blocks) * error
        return Estimate(value, error, found.blocks, value - reach, value + reach, count)
    share = _SHARES[figure]
    found = mean_error(values <= value)
    spread = max(found.error, 1.0 / count)
    reach = _reach(found.blocks) * spread
    shares = np.clip([share - reach, share - spread, share + spread, share + reach], 0.0, 1.0)
    low, under, over, high = np.quantile(values, shares).tolist()
    error = math.hypot(0.5 * (over - under), floor)
    return Estimate(value, error, found.blocks, low, high, count)


def _reach(blocks: float) -> float:
    """Return Student's t: the reach of an interval in standard errors."""
    return float(stdtrit(max(blocks - 1.0, 1.0), 0.5 + 0.5 * LEVEL))


def difference(
    quantity: ComparedQuantity,
    figure: str,
    reference: Estimate,
    other: Estimate,
    tolerance: float = 0.0,
    *,
    equal: bool = False,
) -> FigureDifference:
    """Return the difference of two figures; its chance is not corrected yet.

    ``figure`` is mean, median or p95. ``tolerance`` is the relative difference that does not
    matter, 0 for none; it says nothing of a figure that may be zero, which is tested without it.
    ``equal`` says that all values of both are equal, so that there is nothing to estimate.
    """
    value = other.value - reference.value
    unknown = (math.nan,) * 6
    found = FigureDifference(quantity, figure, reference, other, value, *unknown, TOO_FEW)
    if any(e.count < quantity.fewest or math.isnan(e.error) for e in (reference, other)):
        return found
    if equal:
        return replace(
            found,
            low=0.0,
            high=0.0,
            relative=0.0,
            relative_low=0.0,
            relative_high=0.0,
            chance=1.0,
            decision=UNDECIDED,
        )
    error = math.hypot(reference.error, other.error)
    freedom = _freedom((reference.error, other.error), (reference.blocks, other.blocks))
    reach = float(stdtrit(freedom, 0.5 + 0.5 * LEVEL))
    ratio, ratio_error = _log_ratio(reference, other)
    if tolerance > 0.0 and math.isfinite(ratio):
        edge = abs(math.log1p(math.copysign(tolerance, ratio)))
        excess, spread = abs(ratio) - edge, ratio_error
    else:
        excess, spread = abs(value), error
    chance = min(1.0, 2.0 * float(stdtr(freedom, -excess / spread))) if spread > 0.0 else 1.0
    return replace(
        found,
        low=value - reach * error,
        high=value + reach * error,
        relative=_ratio_minus_one(ratio),
        relative_low=_ratio_minus_one(ratio - reach * ratio_error),
        relative_high=_ratio_minus_one(ratio + reach * ratio_error),
        chance=chance,
        decision=UNDECIDED,
    )


def _ratio_minus_one(logarithm: float) -> float:
    return math.expm1(logarithm) if abs(logarithm) < _LARGEST_LOGARITHM else math.nan


def _freedom(errors: Sequence[float], blocks: Sequence[float]) -> float:
    total = math.hypot(*errors)
    if not 0.0 < total < math.inf:
        return 1.0
    shares = [(error / total) ** 2 for error in errors]  # first: their squares might be no floats
    parts = [share**2 / max(n - 1.0, 1.0) for share, n in zip(shares, blocks, strict=True)]
    return 1.0 / sum(parts)


def _log_ratio(reference: Estimate, other: Estimate) -> tuple[float, float]:
    """Return the logarithm of the ratio of two figures, and its error; NaN if one may be zero."""
    clear = all(abs(e.value) > _CLEARLY_NOT_ZERO * e.error for e in (reference, other))
    if not clear or reference.value * other.value <= 0.0:
        return math.nan, math.nan
    error = math.hypot(reference.error / reference.value, other.error / other.value)
    return math.log(other.value / reference.value), error


def corrected(chances: Sequence[float]) -> list[float]:
    """Return probabilities corrected for their number by Holm's method; NaN stay.

    So the chance that any of all decisions is wrong stays below that of one.
    """
    order = sorted((chance, place) for place, chance in enumerate(chances) if chance == chance)
    found = [math.nan] * len(chances)
    least = 0.0
    for rank, (chance, place) in enumerate(order):
        least = max(least, min(1.0, (len(order) - rank) * chance))
        found[place] = least
    return found


def decide(found: FigureDifference, chance: float, tolerance: float) -> str:
    """Return the decision on a difference; ``tolerance`` is relative, 0 for none."""
    if found.decision == TOO_FEW:
        return TOO_FEW
    if chance < 1.0 - LEVEL:
        return DIFFERS
    if not tolerance > 0.0 or math.isnan(found.relative):
        return SAME
    within = -tolerance <= found.relative_low and found.relative_high <= tolerance
    return EQUIVALENT if within else UNDECIDED
