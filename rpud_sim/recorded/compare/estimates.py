"""Figures of one run with their intervals, and the differences of two runs.

Values that follow each other in a run depend on each other, so the spread of single values says too
little of the error of their mean. Means of long batches of values hardly depend on each other: the
error comes from their spread, and each batch counts as one value.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.foundation.extras import import_extra
from rpud_sim.recorded.compare.values import MEAN, MEDIAN, P95, ComparedQuantity

LEVEL = 0.95  # confidence level of all intervals

_FEWEST, _MOST = 8, 32  # number of batches in a series; between, the root of its length
_LARGEST_LOGARITHM = 700.0
_ROUNDING = 1e-9  # relative; smaller differences come from the rounding of numbers
_SHARES = {MEDIAN: 0.5, P95: 0.95}
_CLEARLY_NOT_ZERO = 3.0  # standard errors from zero that a reference of a ratio needs

# Decisions on a difference.
DIFFERS, SAME, EQUIVALENT, UNDECIDED, TOO_FEW = (
    "differs",
    "no difference found",
    "equivalent",
    "undecided",
    "too few values",
)


def mean_error(values: np.ndarray) -> tuple[float, float]:
    """Return standard error of the mean of a stationary series (n,), and the number of its batches.

    A remainder at its end is left out.
    """
    number = min(len(values), max(_FEWEST, min(_MOST, math.isqrt(len(values)))))
    size = len(values) // number
    means = np.asarray(values[: number * size], float).reshape(number, size).mean(axis=1)
    means = means - means[:1]  # equal values are equal to their mean, whatever that rounds to
    return float(means.std(ddof=1)) / math.sqrt(number), float(number)


def _student() -> Any:
    """Return the module with Student's distribution."""
    return import_extra("scipy.special", "a comparison", "'rpud_sim[web]'")


def _reach(freedom: float) -> float:
    """Return the half length of an interval, in standard errors."""
    return float(_student().stdtrit(freedom, 0.5 + 0.5 * LEVEL))


class Estimate(NamedTuple):
    """Figure of a run with its interval, in the unit of its quantity; NaN for what is unknown."""

    value: float
    low: float = math.nan  # low, high: 95 % confidence interval
    high: float = math.nan
    error: float = math.nan  # standard error
    blocks: float = 0.0  # number of batches whose means the error comes from
    number: int = 0  # of values


def estimate(values: np.ndarray, figure: str, resolution: float = 0.0) -> Estimate:
    """Return a figure of a series with its interval.

    The interval of a quantile is that of the share of values below it (Woodruff 1952): so it needs
    no density, and is never outside the values. ``values`` are finite, in their order, shape (n,).
    ``figure`` is mean, median or p95. ``resolution`` is the size of the rounding of the values, in
    their unit.
    """
    count = len(values)
    if not count:
        return Estimate(math.nan)
    share = _SHARES.get(figure, 0.0)
    value = float(values.mean() if figure == MEAN else np.quantile(values, share))
    if count < 4:
        return Estimate(value, number=count)
    error, batches = mean_error(values if figure == MEAN else values <= value)
    floor = max(_ROUNDING * abs(value), resolution)
    reach = _reach(max(batches - 1.0, 1.0))
    if figure == MEAN:
        error = math.hypot(error, floor)
        return Estimate(value, value - reach * error, value + reach * error, error, batches, count)
    spread = max(error, 1.0 / count)
    shares = share + spread * np.array([-reach, -1.0, 1.0, reach])
    low, under, over, high = np.quantile(values, np.clip(shares, 0.0, 1.0)).tolist()
    return Estimate(value, low, high, math.hypot(0.5 * (over - under), floor), batches, count)


class FigureDifference(NamedTuple):
    """Difference of one figure between a run and the reference; NaN for what is unknown."""

    quantity: str  # its name
    figure: str  # mean, median or p95
    reference: float  # reference, other: the figure in both runs, in the unit of the quantity
    other: float
    difference: float  # other minus reference, in the unit of the quantity
    low: float = math.nan  # low, high: its 95 % confidence interval
    high: float = math.nan
    # relative, relative_low, relative_high: ratio minus one, and its interval; NaN where the
    # reference may be zero.
    relative: float = math.nan
    relative_low: float = math.nan
    relative_high: float = math.nan
    # Probability of so large a difference, or excess over the tolerance, if there were none;
    # corrected for the number of comparisons by ``decided``. NaN where nothing is decided.
    p: float = math.nan
    decision: str = TOO_FEW
    window: int = 0  # number of the compared window


def difference(
    quantity: ComparedQuantity,
    figure: str,
    reference: Estimate,
    other: Estimate,
    tolerance: float = 0.0,
    *,
    equal: bool = False,
) -> FigureDifference:
    """Return the difference of two figures; its ``p`` is not corrected yet.

    ``tolerance`` is the relative difference that does not matter, 0 for none; it says nothing of a
    figure that may be zero, which is tested without it. ``equal`` says that all values of both are
    equal, so that there is nothing to estimate.
    """
    value = other.value - reference.value
    found = FigureDifference(quantity.name, figure, reference.value, other.value, value)
    if any(e.number < quantity.fewest or math.isnan(e.error) for e in (reference, other)):
        return found
    if equal:
        found = found._replace(low=0.0, high=0.0, p=1.0, decision=UNDECIDED)
        return found._replace(relative=0.0, relative_low=0.0, relative_high=0.0)
    error = math.hypot(reference.error, other.error)
    freedom = _freedom(reference, other)
    reach = _reach(freedom)
    ratio, ratio_error = _log_ratio(reference, other)
    excess, spread = abs(value), error
    if tolerance > 0.0 and math.isfinite(ratio):
        edge = abs(math.log1p(math.copysign(tolerance, ratio)))
        excess, spread = abs(ratio) - edge, ratio_error
    return found._replace(
        low=value - reach * error,
        high=value + reach * error,
        relative=_ratio_minus_one(ratio),
        relative_low=_ratio_minus_one(ratio - reach * ratio_error),
        relative_high=_ratio_minus_one(ratio + reach * ratio_error),
        p=min(1.0, 2.0 * float(_student().stdtr(freedom, -excess / spread)))
        if spread > 0.0
        else 1.0,
        decision=UNDECIDED,
    )


def _ratio_minus_one(logarithm: float) -> float:
    return math.expm1(logarithm) if abs(logarithm) < _LARGEST_LOGARITHM else math.nan


def _freedom(*figures: Estimate) -> float:
    """Return the degrees of freedom of a difference by Welch and Satterthwaite."""
    total = math.hypot(*(each.error for each in figures))
    if not 0.0 < total < math.inf:
        return 1.0
    # Shares first: the squares of errors might be no floats.
    return 1.0 / sum((e.error / total) ** 4 / max(e.blocks - 1.0, 1.0) for e in figures)


def _log_ratio(reference: Estimate, other: Estimate) -> tuple[float, float]:
    """Return the logarithm of the ratio of two figures, and its error; NaN if one may be zero."""
    clear = all(abs(e.value) > _CLEARLY_NOT_ZERO * e.error for e in (reference, other))
    if not clear or reference.value * other.value <= 0.0:
        return math.nan, math.nan
    error = math.hypot(reference.error / reference.value, other.error / other.value)
    return math.log(other.value / reference.value), error


def holm(chances: Sequence[float]) -> list[float]:
    """Return probabilities corrected for their number by Holm's step-down method."""
    corrected = [1.0] * len(chances)
    least = 0.0
    for rank, place in enumerate(sorted(range(len(chances)), key=chances.__getitem__)):
        least = max(least, min(1.0, (len(chances) - rank) * chances[place]))
        corrected[place] = least
    return corrected


def decided(found: Sequence[FigureDifference], tolerance: float) -> tuple[FigureDifference, ...]:
    """Return differences with decisions; ``tolerance`` is relative, 0 for none.

    The chance that any of all decisions is wrong stays below that of one.
    """
    corrected = [*found]
    tested = [place for place, each in enumerate(found) if not math.isnan(each.p)]
    for place, p in zip(tested, holm([found[place].p for place in tested]), strict=True):
        each = found[place]
        if p < 1.0 - LEVEL:
            decision = DIFFERS
        elif not tolerance > 0.0 or math.isnan(each.relative):
            decision = SAME
        else:
            within = -tolerance <= each.relative_low and each.relative_high <= tolerance
            decision = EQUIVALENT if within else UNDECIDED
        corrected[place] = each._replace(p=p, decision=decision)
    return tuple(corrected)
