"""Course of a quantity over the last minute, as a terminal can draw it."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np

from rpud_sim.watch.picture import Series

SPAN = 60.0
"""Simulation time that a sparkline covers [s]."""

RECENT = 1.0
"""Simulation time over which a rate or a force is given [s]."""

BLOCKS, ASCII = " ▁▂▃▄▅▆▇█", " .:-=+*#@"
"""Steps of a sparkline: for UTF-8, and for terminals that know no more than ASCII."""


def recent(series: Series, name: str, seconds: float = RECENT) -> np.ndarray:
    """Return the values of the last seconds of a series, of bins that are over."""
    return series.column(name)[:-1][-round(seconds / series.period) :]


def rate(values: np.ndarray, period: float) -> float:
    """Return the sum of bins over their time; NaN without bins.

    Args:
        values: of the bins; NaN counts as zero.
        period: of a bin [s].
    """
    return float(np.nansum(values)) / (len(values) * period) if len(values) else math.nan


def figure(value: float) -> str:
    """Return a number with four digits, or as a whole one if it has more."""
    return f"{value:.0f}" if abs(value) >= 1e3 else f"{value:.4g}"


def greatest(values: np.ndarray) -> float:
    """Return the greatest value that is a number; NaN without one."""
    known = values[np.isfinite(values)]
    return float(known.max()) if len(known) else math.nan


def sparkline(values: Iterable[float], steps: str = BLOCKS) -> str:
    """Return a character for each value, from zero to the greatest; a blank for NaN.

    Args:
        values: not negative; what is negative counts as zero.
    """
    numbers = list(values)
    top = max((value for value in numbers if math.isfinite(value)), default=0.0)

    def step(value: float) -> str:
        if not math.isfinite(value):
            return steps[0]
        share = max(0.0, value) / top if top > 0.0 else 0.0
        return steps[1 + min(len(steps) - 2, int(share * (len(steps) - 1)))]

    return "".join(map(step, numbers))


def columns_of(series: Series, name: str, count: int, total: bool) -> list[float]:
    """Return a value for each column of a sparkline over the last minute.

    A column always covers the same bins, so a line moves by whole columns and seldom changes.

    Args:
        total: whether to give the sum over time [1/s]; the greatest value otherwise.
    """
    bins = max(1, math.ceil(SPAN / count / series.period))
    values = series.column(name)[:-1]
    end = (series.first + len(values)) // bins  # columns that are complete
    result = []
    for number in range(end - count, end):
        first = number * bins - series.first
        part = values[max(0, first) : max(0, first + bins)]
        if not len(part):
            result.append(math.nan)
        else:
            result.append(rate(part, series.period) if total else greatest(part))
    return result
