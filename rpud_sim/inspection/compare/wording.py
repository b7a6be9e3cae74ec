"""Results of a comparison in words and numbers, for the terminal and for the page."""

from __future__ import annotations

import math

from rpud_sim.inspection.compare.estimates import DIFFERS, Difference
from rpud_sim.inspection.compare.results import Comparison
from rpud_sim.inspection.compare.values import MEAN, MEDIAN, P95
from rpud_sim.pages.quantities import NONE, Quantity

FIGURES = {MEAN: "mean", MEDIAN: "median", P95: "95 % quantile"}


_PERCENT = Quantity("relative", "relative difference", "%", 100.0, floor=1e-5)


def difference_texts(shown: Quantity, each: Difference) -> tuple[str, str]:
    """Return a difference and its interval: relative ones, else in the quantity's unit."""
    values = (each.value, each.low, each.high)
    if math.isfinite(each.relative):
        shown, values = _PERCENT, (each.relative, each.relative_low, each.relative_high)
    value, low, high = values
    interval = f"{shown.text(low, unit=False, sign=True)} to {shown.text(high, sign=True)}"
    known = math.isfinite(low) and math.isfinite(high)
    return shown.text(value, sign=True), interval if known else NONE


def sentence(found: Comparison) -> str:
    """Return the result, and the greatest of the differences."""
    text = f"{found.verdict[0].upper()}{found.verdict[1:]}"
    differing = [
        (quantity.shown, each, window.window.name)
        for window in found.windows
        for quantity in window.quantities
        for run in quantity.differences
        for each in run
        if each.decision == DIFFERS and math.isfinite(each.relative)
    ]
    if not differing:
        return f"{text}."
    shown, most, where = max(differing, key=lambda pair: abs(math.log1p(pair[1].relative)))
    difference, interval = difference_texts(shown, most)
    figure = "" if most.figure == MEAN else f" ({FIGURES[most.figure]})"
    segment = f" {where}" if len(found.windows) > 1 else ""
    return f"{text}, most of all {shown.label}{figure}{segment}: {difference}, from {interval}."
