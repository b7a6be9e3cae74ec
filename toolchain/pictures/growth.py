"""Picture of how cost grows with work, from the results that the page on performance shows."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from dataclasses import dataclass

from bench.growth import Point, fit, points_of_rows
from bench.page import SHOWN
from bench.results import read_parts, rows_of
from toolchain.pictures.diagrams import render

WIDTH, HEIGHT, TOP, GAP = 230.0, 190.0, 96.0, 6.0  # of a panel, above all, between [px]
COLUMNS = 2
_LEFT, _RIGHT, _UPPER, _LOWER = 50.0, 14.0, 52.0, 36.0  # margins of a panel [px]


@dataclass(frozen=True)
class Panel:
    """One curve as it is drawn [px].

    Attributes:
        work: what is done.
        amount: unit of its amount.
        exponent: power that it grows with, and the reach of its interval.
        x, y: upper left corner.
        dots: medians at each amount.
        reference: line of cost proportional to work, through the last dot.
        across, up: ticks with their labels.
    """

    work: str
    amount: str
    exponent: str
    x: float
    y: float
    dots: tuple[tuple[float, float], ...]
    reference: tuple[float, float, float, float]
    across: tuple[tuple[float, str], ...]
    up: tuple[tuple[float, str], ...]


def draw_growth() -> str:
    """Return the picture: a panel for each curve."""
    curves: dict[str, list[Point]] = {}
    for point in points_of_rows(rows_of(read_parts(SHOWN))):
        curves.setdefault(point.curve, []).append(point)
    panels = [_panel(place, points) for place, points in enumerate(curves.values())]
    rows = math.ceil(len(panels) / COLUMNS)
    said = "; ".join(f"{each.work}: {each.exponent}" for each in panels)
    return render(
        "growth.svg.jinja",
        panels=panels,
        said=said,
        width=round(COLUMNS * (WIDTH + GAP) + GAP),
        height=round(TOP + rows * (HEIGHT + GAP) + GAP),
        floor=HEIGHT - _LOWER,
        ceiling=_UPPER,
        left=_LEFT,
        right=WIDTH - _RIGHT,
        panel_width=WIDTH,
        panel_height=HEIGHT,
    )


def _panel(place: int, points: Sequence[Point]) -> Panel:
    amounts = sorted({point.amount for point in points})
    costs = [
        statistics.median(point.seconds for point in points if point.amount == amount)
        for amount in amounts
    ]
    across = _Axis(amounts, _LEFT, WIDTH - _RIGHT)
    up = _Axis(costs, HEIGHT - _LOWER, _UPPER)
    fitted = fit(points)
    reach = f" ±{fitted.high - fitted.value:.2f}" if math.isfinite(fitted.high) else ""
    work, _, amount = points[0].curve.rstrip(")").partition(" (")
    # Proportional cost through the last dot, down to the first amount or the floor.
    least = max(amounts[0], amounts[-1] * 10**up.least / costs[-1])
    line = (least, costs[-1] * least / amounts[-1], amounts[-1], costs[-1])
    return Panel(
        work,
        amount,
        f"{max(0.0, fitted.value):.2f}{reach}",
        GAP + (place % COLUMNS) * (WIDTH + GAP),
        TOP + (place // COLUMNS) * (HEIGHT + GAP),
        tuple((across.at(x), up.at(y)) for x, y in zip(amounts, costs, strict=True)),
        (across.at(line[0]), up.at(line[1]), across.at(line[2]), up.at(line[3])),
        across.ticks(),
        up.ticks(),
    )


class _Axis:
    """Logarithmic axis over whole decades, from one coordinate to another [px]."""

    def __init__(self, values: Sequence[float], begin: float, end: float) -> None:
        self.least = math.floor(math.log10(min(values)) + 1e-9)
        self._most = max(self.least + 1, math.ceil(math.log10(max(values)) - 1e-9))
        self._begin, self._end = begin, end

    def at(self, value: float) -> float:
        """Return the coordinate of a value [px]."""
        share = (math.log10(value) - self.least) / (self._most - self.least)
        return round(self._begin + share * (self._end - self._begin), 1)

    def ticks(self) -> tuple[tuple[float, str], ...]:
        """Return the coordinates of the decades with their labels."""
        return tuple((self.at(10.0**p), _power(p)) for p in range(self.least, self._most + 1))


def _power(power: int) -> str:
    """Return a power of ten, such as ``0.01``, ``100`` or ``10k``."""
    if power < 3:
        return f"{10.0**power:g}"
    return f"{10 ** (power % 3)}{'kMG'[power // 3 - 1]}"
