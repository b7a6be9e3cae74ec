"""Descriptions of plots: layers with their data, axes, marks, and columns over one time axis.

They need no library for drawing: ``figures`` makes Bokeh figures of them, ``embedding`` puts them
into pages. Data are NumPy arrays of one length; NaN is a gap, which no line crosses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

COMMAND, FAULT, GAP = "command", "fault", "gap"  # kinds of marks


@dataclass(frozen=True)
class Axis:
    """Axis of a plot."""

    label: str = ""  # name of the quantity; not of a y axis, whose name is the title of the plot
    unit: str = ""  # of its values; empty for none
    log: bool = False  # whether it is logarithmic; values that are not positive are left out
    low: float | None = None  # low, high: its ends; from the data if None
    high: float | None = None
    categories: tuple[str, ...] = ()  # names at 0, 1, 2 ..., which take the place of numbers
    flipped: bool = False  # whether it grows downward, or to the left
    # Texts beside the categories, on the right: heading and texts of each column.
    columns: tuple[tuple[str, tuple[str, ...]], ...] = ()


@dataclass(frozen=True)
class Line:
    """Line through points; with ``steps`` each value holds until the next one."""

    name: str
    x: np.ndarray  # x, y: its points, shape (n,)
    y: np.ndarray
    steps: bool = False  # whether it is drawn as steps
    color: int | str = 0  # number of its colour, or the name of one in ``theme``
    dash: Literal["solid", "dashed", "dotted", "dotdash"] = "solid"
    width: float = 1.4  # of the line [pixels]
    marker: bool = False  # whether a dot is on each point


@dataclass(frozen=True)
class Envelope:
    """Mean of values in parts of the time, and the band from least to greatest."""

    name: str
    # Beginning of each part, shape (n,). A part ends where the next one begins; the last one is
    # only an end.
    x: np.ndarray
    low: np.ndarray  # low, y, high: least, mean and greatest value of each part, shape (n,)
    y: np.ndarray
    high: np.ndarray
    color: int | str = 0  # number of its colour, or the name of one in ``theme``


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
    values: np.ndarray | None = None  # that colour the points, shape (n,), or None
    values_label: str = ""  # what they are, with their unit
    marker: str = "circle"  # a marker of Bokeh, such as circle, x or square
    size: float = 6.0  # of a point [pixels]
    color: int | str = 0  # number of its colour, or the name of one in ``theme``
    joined: bool = False  # whether a line joins them
    # Of the scale of colours; from the values if None.
    values_ends: tuple[float, float] | None = None
    titles: tuple[str, ...] = ()  # of the points, under the pointer; from their values if empty


@dataclass(frozen=True)
class Bars:
    """Bars side by side, such as a histogram or a rate over time."""

    name: str  # in the legend
    edges: np.ndarray  # shape (n + 1,)
    y: np.ndarray  # height of each bar, shape (n,)
    color: int | str = 0  # number of its colour, or the name of one in ``theme``


@dataclass(frozen=True)
class Stems:
    """Vertical lines from zero, such as single impacts."""

    name: str
    x: np.ndarray  # x, y: ends of the lines, shape (n,)
    y: np.ndarray
    color: int | str = 0  # number of its colour, or the name of one in ``theme``


@dataclass(frozen=True)
class Rule:
    """Straight line through the whole plot, such as the number of a paper."""

    name: str  # in the legend; with its value
    value: float  # where it is
    across: bool = True  # whether it is horizontal
    color: int | str = "text"  # number of its colour, or the name of one in ``theme``
    dash: Literal["solid", "dashed", "dotted", "dotdash"] = "dashed"  # of the line
    text: str = ""  # under the pointer


@dataclass(frozen=True)
class Zone:
    """Coloured range through the whole plot, such as a tolerance."""

    name: str
    low: float
    high: float
    across: bool = True  # whether it lies between two values of y, not of x
    color: int | str = "muted"  # number of its colour, or the name of one in ``theme``
    text: str = ""  # under the pointer


@dataclass(frozen=True)
class Spans:
    """Horizontal bars from a beginning to an end, each in a row, such as faults over time."""

    name: str  # in the legend
    begin: np.ndarray  # left end of each bar, shape (n,)
    end: np.ndarray  # right end of each bar, shape (n,)
    row: np.ndarray  # place of each bar along y, the number of a category, shape (n,)
    color: int | str = 0  # number of its colour, or the name of one in ``theme``


Layer: TypeAlias = Line | Envelope | Points | Bars | Stems | Spans | Rule | Zone


@dataclass(frozen=True)
class Plot:
    """Plot of layers over a pair of axes."""

    title: str  # name of what it shows, without the unit
    layers: tuple[Layer, ...]  # from back to front
    alt: str = ""  # sentence that says what is seen, for all readers; empty for none
    y: Axis = Axis()  # the axis upward; its unit stands beside the title
    x: Axis = Axis()  # the other axis; ignored in a column, which has one for all
    height: int = 170  # of the plot without its text [pixels]
    width: int = 480  # of the plot with its text [pixels]
    square: bool = False  # whether x and y have one scale

    @property
    def heading(self) -> str:
        """Title with the unit of y."""
        return f"{self.title} [{self.y.unit}]" if self.y.unit else self.title


@dataclass(frozen=True)
class Mark:
    """Mark in time on every plot of a column: a command, a fault, a gap."""

    kind: str  # ``COMMAND``, ``FAULT`` or ``GAP``
    time: float  # of it, or of its beginning [s]
    text: str  # what it is
    # of it [s]; None for an instant. A fault that lasts ends with the column.
    end: float | None = None


@dataclass(frozen=True)
class TimeColumn:
    """Plots below each other over one time axis, which zoom together and share one cursor.

    Columns of one page with the same name are one: they also zoom together.
    """

    plots: tuple[Plot, ...]
    begin: float  # begin, end: of the time [s]
    end: float
    marks: Sequence[Mark] = ()
    name: str = "time"  # of the group of plots that zoom together
    label: str = "time"  # of the time axis, without its unit
    unit: str = "s"
