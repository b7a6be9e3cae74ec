"""Rows of the table."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import NamedTuple


class Goal(NamedTuple):
    """Bound that the median of a figure should keep.

    Attributes:
        least: it should be at least this; None for no such bound.
        most: it should be at most this; None for no such bound.
    """

    least: float | None = None
    most: float | None = None

    def met(self, value: float) -> bool:
        """Return whether a value keeps the bound; NaN does not."""
        above = self.least is None or value >= self.least
        below = self.most is None or value <= self.most
        return above and below

    def __str__(self) -> str:
        """Return the bound, such as ``>= 3``."""
        parts = [f">= {self.least:g}"] if self.least is not None else []
        parts += [f"<= {self.most:g}"] if self.most is not None else []
        return " and ".join(parts)


class Row(NamedTuple):
    """One measured figure: its name, median, least and greatest value, unit and goal."""

    name: str
    median: float
    least: float
    greatest: float
    unit: str
    goal: Goal | None = None


def row(name: str, values: Sequence[float], unit: str = "", goal: Goal | None = None) -> Row:
    """Return the row for repeated measurements of one figure."""
    return Row(name, statistics.median(values), min(values), max(values), unit, goal)
