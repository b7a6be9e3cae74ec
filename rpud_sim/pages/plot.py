"""Descriptions of plots: layers with their data, axes, marks, and columns over one time axis.

They need no library for drawing: ``figures`` makes Bokeh figures of them, ``embedding`` puts them
into pages. Data are NumPy arrays of one length; NaN is a gap, which no line crosses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, TypeAlias

import numpy as np

COMMAND, FAULT, GAP = "command", "fault", "gap"
"""Kinds of marks."""


@dataclass(frozen=True)
class Axis:
    """Axis of a plot.

    Args:
        label: name of the quantity; not of a y axis, whose name is the title of the plot.
        unit: of its values; empty for none.
        log: whether it is logarithmic; values that are not positive are left out.
        low, high: its ends; from the data if None.
        categories: names at 0, 1, 2 ..., which take the place of numbers.
        flipped: whether it grows downward, or to the left.
    """

    label: str = ""
    unit: str = ""
    log: bool = False
    low: float | None = None
    high: float | None = None
    categories: tuple[str, ...] = ()
    flipped: bool = False


@dataclass(frozen=True)
class Line:
    """Line through points; with ``steps`` each value holds until the next one.

    Args:
        x, y: its points, shape (n,).
        steps: whether it is drawn as steps.
        color: number of its colour, or the name of one in ``theme``.
        width: of the line [pixels].
        marker: whether a dot is on each point.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    steps: bool = False
    color: int | str = 0
    dash: Literal["solid", "dashed", "dotted", "dotdash"] = "solid"
    width: float = 1.4
    marker: bool = False


@dataclass(frozen=True)
class Envelope:
    """Mean of values in parts of the time, and the band from least to greatest.

    Args:
        x: beginning of each part, shape (n,). A part ends where the next one begins; the last one
            is only an end.
        low, y, high: least, mean and greatest value of each part, shape (n,).
        color: number of its colour, or the name of one in ``theme``.
    """

    name: str
    x: np.ndarray
    low: np.ndarray
    y: np.ndarray
    high: np.ndarray
    color: int | str = 0


@dataclass(frozen=True)
class Points:
    """Points, with intervals if they have any.

    Args:
        x, y: shape (n,).
        low, high: ends of the interval of each point, shape (n,), or None.
        across: whether intervals are along x, not along y.
        values: that colour the points, shape (n,), or None.
        values_label: what they are, with their unit.
        values_ends: of the scale of colours; from the values if None.
        marker: a marker of Bokeh, such as circle, x or square.
        size: of a point [pixels].
        color: number of its colour, or the name of one in ``theme``.
        joined: whether a line joins them.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    low: np.ndarray | None = None
    high: np.ndarray | None = None
    across: bool = False
    values: np.ndarray | None = None
    values_label: str = ""
    marker: str = "circle"
    size: float = 6.0
    color: int | str = 0
    joined: bool = False
    values_ends: tuple[float, float] | None = None


@dataclass(frozen=True)
class Bars:
    """Bars side by side, such as a histogram or a rate over time."""

    name: str  # in the legend
    edges: np.ndarray  # shape (n + 1,)
    y: np.ndarray  # height of each bar, shape (n,)
    color: int | str = 0  # number of its colour, or the name of one in ``theme``


@dataclass(frozen=True)
class Stems:
    """Vertical lines from zero, such as single impacts.

    Args:
        x, y: ends of the lines, shape (n,).
        color: number of its colour, or the name of one in ``theme``.
    """

    name: str
    x: np.ndarray
    y: np.ndarray
    color: int | str = 0


@dataclass(frozen=True)
class Rule:
    """Straight line through the whole plot, such as the number of a paper."""

    name: str  # in the legend; with its value
    value: float  # where it is
    across: bool = True  # whether it is horizontal
    color: int | str = "text"  # number of its colour, or the name of one in ``theme``
    dash: Literal["solid", "dashed", "dotted", "dotdash"] = "dashed"  # of the line


@dataclass(frozen=True)
class Zone:
    """Coloured range through the whole plot, such as a tolerance.

    Args:
        across: whether it lies between two values of y, not of x.
        color: number of its colour, or the name of one in ``theme``.
    """

    name: str
    low: float
    high: float
    across: bool = True
    color: int | str = "muted"


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

    Args:
        begin, end: of the time [s].
        name: of the group of plots that zoom together.
        label: of the time axis, without its unit.
    """

    plots: tuple[Plot, ...]
    begin: float
    end: float
    marks: Sequence[Mark] = ()
    name: str = "time"
    label: str = "time"
    unit: str = "s"
