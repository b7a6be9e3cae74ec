"""Descriptions of plots: layers with their data, axes, and the scales of these.

Data are NumPy arrays of one length; NaN is a gap, which no line crosses.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np

from rpud_sim.pages.quantities import number_text

_GREATEST = 1e150
_MARGIN = 0.05  # of the range of the data


@dataclass(frozen=True)
class Axis:
    """Axis of a plot."""

    label: str = ""  # name of the quantity; not of a y axis, whose name is the title of the plot
    unit: str = ""  # of its values; empty for none
    log: bool = False  # whether it is logarithmic; values that are not positive are left out
    low: float | None = None  # low, high: its ends; from the data if None
    high: float | None = None
    categories: tuple[str, ...] = ()  # names at 0, 1, 2 ..., which take the place of numbers
    flipped: bool = False  # whether it grows downward
    # Texts beside the categories, on the right: heading and texts of each column.
    columns: tuple[tuple[str, tuple[str, ...]], ...] = ()


@dataclass(frozen=True)
class Line:
    """Line through points."""

    name: str
    x: np.ndarray  # x, y: its points, shape (n,)
    y: np.ndarray
    steps: bool = False  # whether each value holds until the next one
    color: int | str = 0  # number of its colour, or the name of one in ``page.css``


@dataclass(frozen=True)
class Points:
    """Points, with intervals if they have any."""

    name: str
    x: np.ndarray  # x, y: shape (n,)
    y: np.ndarray
    # low, high: ends of the interval of each point, shape (n,), or None.
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    across: bool = False  # whether intervals are along x, not along y
    size: float = 6.0  # of a point [pixels]
    color: int | str = 0  # number of its colour, or the name of one in ``page.css``
    joined: bool = False  # whether a line joins them
    titles: tuple[str, ...] = ()  # of the points, under the pointer; from their values if empty


@dataclass(frozen=True)
class Rule:
    """Upright line through the whole plot, such as a limit."""

    name: str  # in the legend; empty for none
    value: float  # of x
    color: int | str = "text"  # number of its colour, or the name of one in ``page.css``


@dataclass(frozen=True)
class Zone:
    """Coloured range of x through the whole plot, such as a tolerance."""

    name: str  # in the legend; empty for none
    low: float
    high: float
    color: int | str = "muted"  # number of its colour, or the name of one in ``page.css``


Layer: TypeAlias = Line | Points | Rule | Zone


@dataclass(frozen=True)
class Plot:
    """Plot of layers over a pair of axes."""

    title: str  # name of what it shows, without the unit
    layers: tuple[Layer, ...]  # from back to front
    alt: str = ""  # sentence that says what is seen, for those who do not see it
    y: Axis = Axis()  # the axis upward; its unit stands beside the title
    x: Axis = Axis()  # the other axis
    height: int = 170  # of the plot without its text [pixels]
    width: int = 480  # of the plot with its text [pixels]

    @property
    def heading(self) -> str:
        """Title with the unit of y."""
        return f"{self.title} [{self.y.unit}]" if self.y.unit else self.title


@dataclass(frozen=True)
class Scale:
    """Map from values to pixels along one side of a plot."""

    axis: Axis
    low: float  # low, high: values at the ends
    high: float
    begin: float  # begin, end: pixels of the least and of the greatest value
    end: float

    def __call__(self, values: Any) -> np.ndarray:
        low, high, found = self.low, self.high, np.asarray(values, float)
        found = np.where(usable(found, self.axis), found, np.nan)
        if self.axis.log:
            low, high, found = math.log(low), math.log(high), np.log(found)
        # A browser has no use for the digits of what is far outside.
        found = np.clip((found - low) / (high - low), -9.0, 10.0)
        return self.begin + found * (self.end - self.begin)

    def ticks(self, apart: float) -> list[tuple[float, str]]:
        """Return values and texts of ticks that are about so many pixels apart."""
        if self.axis.categories:
            return [(float(n), str(text)) for n, text in enumerate(self.axis.categories)]
        most = max(2.0, abs(self.end - self.begin) / apart)
        if self.axis.log:
            found = _log_ticks(self.low, self.high, most)
            if len(found) > 1:
                return [(value, number_text(value)) for value in found]
        step = _step((self.high - self.low) / most)
        first, last = math.ceil(self.low / step - 1e-9), math.floor(self.high / step + 1e-9)
        places = max(0, -math.floor(math.log10(step) + 1e-9))
        greatest = max(abs(self.low), abs(self.high))
        form = f".{places}f"
        if greatest >= 1e7 or places > 6:
            form = f".{math.floor(math.log10(greatest / step)) + 2}g"
        return [
            (n * step, f"{n * step:{form}}".replace("-", "−", 1)) for n in range(first, last + 1)
        ]


def usable(values: np.ndarray, axis: Axis) -> np.ndarray:
    """Return which values can be drawn: numbers whose squares are numbers too."""
    found: np.ndarray = np.abs(values) < _GREATEST
    return found & (values > 1.0 / _GREATEST) if axis.log else found


def scale_of(plot: Plot, side: str, begin: float, end: float) -> Scale:
    """Return the scale of an axis, ``x`` or ``y``, between two places [pixels]."""
    axis: Axis = getattr(plot, side)
    if axis.flipped:
        begin, end = end, begin
    return Scale(axis, *axis_ends(plot, side), begin, end)


def axis_ends(plot: Plot, side: str) -> tuple[float, float]:
    """Return the ends of an axis that hold all data and all intervals, with a margin."""
    axis: Axis = getattr(plot, side)
    if axis.categories:
        return -0.6, len(axis.categories) - 0.4
    parts = [np.asarray(v, float).ravel() for each in plot.layers for v in _held(each, side)]
    found = np.concatenate([np.empty(0), *parts])
    found = found[usable(found, axis)]
    low, high = (float(found.min()), float(found.max())) if len(found) else (1.0, 1.0)
    wide = high - low > 1e-9 * max(abs(low), abs(high))
    if axis.log:
        more = (high / low) ** _MARGIN if wide else 2.0
        low, high = low / more, high * more
    else:
        more = _MARGIN * (high - low) if wide else 0.5 * abs(high) or 0.5
        low, high = low - more, high + more
    low = low if axis.low is None else axis.low
    high = high if axis.high is None else axis.high
    return low, high if high > low else low + 1.0


def _held(layer: Layer, side: str) -> Iterator[Any]:
    """Yield the values of a layer that an axis has to hold."""
    if isinstance(layer, Line | Points):
        yield getattr(layer, side)
        if isinstance(layer, Points) and layer.across == (side == "x") and layer.low is not None:
            yield from (layer.low, layer.high)
    elif side == "x":
        yield from (layer.value,) if isinstance(layer, Rule) else (layer.low, layer.high)


def _step(least: float) -> float:
    power = 10.0 ** math.floor(math.log10(least))
    return next(step for m in (1, 2, 5, 10) if (step := m * power) >= least * (1.0 - 1e-9))


def _log_ticks(low: float, high: float, most: float) -> list[float]:
    first, last = math.floor(math.log10(low)), math.ceil(math.log10(high))
    for parts in ((1.0, 2.0, 3.0, 5.0), (1.0, 2.0, 5.0), (1.0, 3.0), (1.0,)):
        found = [part * 10.0**n for n in range(first, last + 1) for part in parts]
        found = [value for value in found if low <= value * (1 + 1e-9) <= high * (1 + 2e-9)]
        if len(found) <= most:
            return found
    return found[:: math.ceil(len(found) / most)]
