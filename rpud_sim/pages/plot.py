"""Descriptions of plots: layers with their data, and axes.

Data are NumPy arrays of one length; NaN is a gap, which no line crosses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np


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
    """Line through points; with ``steps`` each value holds until the next one."""

    name: str
    x: np.ndarray  # x, y: its points, shape (n,)
    y: np.ndarray
    steps: bool = False  # whether it is drawn as steps
    color: int | str = 0  # number of its colour, or the name of one in ``page.css``


@dataclass(frozen=True)
class Envelope:
    """Mean of values in parts of the time, and the band from least to greatest."""

    name: str
    x: np.ndarray  # middle of each part, shape (n,)
    low: np.ndarray  # low, y, high: least, mean and greatest value of each part, shape (n,)
    y: np.ndarray
    high: np.ndarray
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
    marker: Literal["circle", "x"] = "circle"
    size: float = 6.0  # of a point [pixels]
    color: int | str = 0  # number of its colour, or the name of one in ``page.css``
    joined: bool = False  # whether a line joins them
    titles: tuple[str, ...] = ()  # of the points, under the pointer; from their values if empty


@dataclass(frozen=True)
class Bars:
    """Bars side by side, such as a histogram."""

    name: str
    edges: np.ndarray  # shape (n + 1,)
    y: np.ndarray  # height of each bar, shape (n,)
    color: int | str = 0  # number of its colour, or the name of one in ``page.css``


@dataclass(frozen=True)
class Rule:
    """Straight line through the whole plot, such as a limit."""

    name: str  # in the legend; empty for none
    value: float  # where it is
    across: bool = True  # whether it is horizontal
    color: int | str = "text"  # number of its colour, or the name of one in ``page.css``
    dash: Literal["solid", "dashed", "dotted"] = "dashed"  # of the line
    text: str = ""  # under the pointer


@dataclass(frozen=True)
class Zone:
    """Coloured range through the whole plot, such as a tolerance."""

    name: str  # in the legend; empty for none
    low: float
    high: float
    across: bool = True  # whether it lies between two values of y, not of x
    color: int | str = "muted"  # number of its colour, or the name of one in ``page.css``
    text: str = ""  # under the pointer


Layer: TypeAlias = Line | Envelope | Points | Bars | Rule | Zone


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
