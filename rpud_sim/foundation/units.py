"""Units that people read and write, each with its SI unit and the exact factor to it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple


class Unit(NamedTuple):
    """Unit: a value in it times ``up / down`` is the value in the SI unit."""

    si: str
    up: float = 1
    down: float = 1

    def to_si(self, value: float) -> float:
        return value * self.up / self.down


PREFIXES = {
    "G": (10**9, 1),
    "M": (10**6, 1),
    "k": (1000, 1),
    "": (1, 1),
    "m": (1, 1000),
    "µ": (1, 10**6),
    "u": (1, 10**6),
    "n": (1, 10**9),
}
"""Factors of prefixes, up and down."""

PREFIXED = (
    *("m", "s", "g", "N", "Hz", "V", "A", "W", "J", "K", "Pa", "ohm", "rad"),
    *("N s", "N m", "m/s", "rad/s", "J/m^3"),
)
"""Units that may have a prefix."""

UNITS: Mapping[str, Unit] = {
    **{p + unit: Unit(unit, *factor) for unit in PREFIXED for p, factor in PREFIXES.items()},
    **{f"{prefix}g": Unit("kg", up, 1000 * down) for prefix, (up, down) in PREFIXES.items()},
    "min": Unit("s", 60),
    "h": Unit("s", 3600),
    "degC": Unit("degC"),
    "°C": Unit("degC"),
    "deg": Unit("rad", math.pi, 180),
    "%": Unit("", 1, 100),
    "mm/min": Unit("m/s", 1, 60_000),
    "rpm": Unit("rad/s", math.pi, 30),
    "1/s": Unit("1/s"),
    "/s": Unit("1/s"),
    "m^3": Unit("m^3"),
    "cm^3": Unit("m^3", 1, 10**6),
    "mm^3": Unit("m^3", 1, 10**9),
    "mm³": Unit("m^3", 1, 10**9),
    "": Unit(""),
    "1": Unit(""),
}
