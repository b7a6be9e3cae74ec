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
    """One measured figure.

    Attributes:
        name: what was measured.
        values: of each turn, in their order; at least one.
        unit: of the values; empty for a ratio or a number.
        goal: bound of the median; None for none.
    """

    name: str
    values: tuple[float, ...]
    unit: str = ""
    goal: Goal | None = None

    @property
    def median(self) -> float:
        """Median of the values."""
        return statistics.median(self.values)

    @property
    def least(self) -> float:
        """Least value."""
        return min(self.values)

    @property
    def greatest(self) -> float:
        """Greatest value."""
        return max(self.values)

    @property
    def missed(self) -> bool:
        """Whether there is a goal and the median does not keep it."""
        return self.goal is not None and not self.goal.met(self.median)


def row(name: str, values: Sequence[float], unit: str = "", goal: Goal | None = None) -> Row:
    """Return the row for repeated measurements of one figure."""
    return Row(name, tuple(map(float, values)), unit, goal)
