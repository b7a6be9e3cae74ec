"""How cost grows with work: curves over three decades, and the exponent of each.

A curve comes from a function ``growth`` of another file of the bench, which yields its name (what
is done, and the unit of the amount), the amount of work and the processor time [s] it took.
"""

from __future__ import annotations

import importlib
import math
import re
import sys
import traceback
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import curve_fit
from scipy.special import stdtrit

from bench.row import Goal, Row, row

SOURCES = ("bench.lengths", "bench.sizes", "bench.replay", "bench.recorder", "bench.drills")
"""Files of the bench with curves."""

GOAL = Goal(most=1.1)
"""Of exponents: n log n is not above it from a thousand on, by more than its interval."""

_LEVEL = 0.95
_RISE = 3.0  # of the cost, from the least to the greatest amount
_NAME = re.compile(r"growth of (?P<curve>.+) at (?P<amount>[0-9.e+-]+)")


class Point(NamedTuple):
    """Processor time [s] of an amount of work."""

    curve: str
    amount: float
    seconds: float


@dataclass(frozen=True)
class Exponent:
    """Power of the amount that the cost grows with, and its 95 % interval; NaN if unknown."""

    value: float
    low: float
    high: float


def growth() -> Iterator[Row]:
    """Yield the costs of every curve, then its exponent.

    Raises:
        RuntimeError: at the end, if a source failed.
        KeyboardInterrupt: at the end, if it came: what was measured until then is not lost.
    """
    points: list[Point] = []
    failed = []
    interrupt: KeyboardInterrupt | None = None
    for source in SOURCES:
        try:
            for each in importlib.import_module(source).growth():
                points.append(Point(*each))
                print(f"  {points[-1]}", file=sys.stderr, flush=True)
        except KeyboardInterrupt as error:
            interrupt = error
            break
        except Exception as error:
            traceback.print_exc()
            failed.append(f"{source}: {error}")
    yield from rows_of_points(points)
    if interrupt is not None:
        raise interrupt
    if failed:
        raise RuntimeError("; ".join(failed))


def rows_of_points(points: Iterable[Point]) -> Iterator[Row]:
    """Yield a row for each amount of each curve, and one for its exponent."""
    curves: dict[str, list[Point]] = {}
    for point in points:
        curves.setdefault(point.curve, []).append(point)
    for curve, found in curves.items():
        for amount in sorted({point.amount for point in found}):
            values = [point.seconds for point in found if point.amount == amount]
            yield row(f"growth of {curve} at {amount:g}", values, "s")
        fitted = fit(found)
        # The median of these is the exponent.
        values = [fitted.value, fitted.low, fitted.high]
        values = [each for each in values if math.isfinite(each)]
        if values:
            yield row(f"growth of {curve}: exponent", values, goal=GOAL)


def points_of_rows(rows: Iterable[Row]) -> Iterator[Point]:
    """Yield the points that rows were made of."""
    for each in rows:
        if found := _NAME.fullmatch(each.name):
            for value in each.values:
                yield Point(found["curve"], float(found["amount"]), value)


def fit(points: Sequence[Point]) -> Exponent:
    """Return the power p of cost = start + factor * amount ** p, by least squares of log cost.

    A curve that hardly rises above the cost of starting does not show its power: of it this is the
    slope of the logarithms.

    Args:
        points: of one curve, at two amounts or more; without a repeat there is no interval.
    """
    amounts = np.array([point.amount for point in points])
    costs = np.array([point.seconds for point in points])
    least, greatest = costs[amounts == amounts.min()], costs[amounts == amounts.max()]
    if amounts.min() == amounts.max() or costs.min() <= 0.0:
        return Exponent(*(math.nan,) * 3)
    across = np.log(amounts / amounts.max())
    top = float(np.median(greatest))

    def power(x: np.ndarray, start: float, height: float, exponent: float) -> np.ndarray:
        # Logarithms keep all three parameters near one.
        return np.logaddexp(start, height + exponent * x)

    def line(x: np.ndarray, height: float, exponent: float) -> np.ndarray:
        return height + exponent * x

    logs = np.log(costs / top)
    rises = top > _RISE * float(np.median(least))
    if rises and len(set(amounts.tolist())) > 3:
        first = (math.log(float(np.median(least)) / top) - 0.7, 0.0, 1.0)
        bounds = ((-30.0, -3.0, 0.0), (1.0, 3.0, 6.0))
        values, covariance = curve_fit(power, across, logs, first, bounds=bounds)
    else:
        values, covariance = curve_fit(line, across, logs, (0.0, 1.0))
    freedom = len(points) - len(values)
    value = float(values[-1])
    if freedom < 1:
        return Exponent(value, math.nan, math.nan)
    reach = float(stdtrit(freedom, 0.5 + 0.5 * _LEVEL)) * math.sqrt(float(covariance[-1, -1]))
    return Exponent(value, value - reach, value + reach)


def main() -> int:
    """Print the table of growth; return the exit code."""
    from bench.__main__ import run_measurements

    return run_measurements(["growth"], 1.0)


if __name__ == "__main__":
    sys.exit(main())
