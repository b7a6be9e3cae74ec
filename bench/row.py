"""Rows of the table."""

from __future__ import annotations

import statistics
from collections.abc import Sequence
from typing import NamedTuple


class Row(NamedTuple):
    """One measured figure: its name, median, least and greatest value, and unit."""

    name: str
    median: float
    least: float
    greatest: float
    unit: str


def row(name: str, values: Sequence[float], unit: str = "") -> Row:
    """Return the row for repeated measurements of one figure."""
    return Row(name, statistics.median(values), min(values), max(values), unit)
