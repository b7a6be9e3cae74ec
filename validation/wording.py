"""Numbers and quantities as text."""

from __future__ import annotations

import numpy as np


def plain(value: float, digits: int = 3) -> str:
    """Return a number with so many significant digits, without an exponent if it is moderate."""
    if value != 0.0 and not 1e-4 <= abs(value) < 1e6:
        return f"{value:.{digits - 1}e}"
    return np.format_float_positional(value, digits, fractional=False, trim="-")


def show(value: float, unit: str) -> str:
    """Return a quantity in a fitting unit, such as 42 µm for 4.2e-5 m."""
    if unit == "m":
        return f"{plain(1e6 * value)} µm" if value < 1e-3 else f"{plain(1e3 * value)} mm"
    if unit == "s":
        return f"{plain(1e6 * value)} µs"
    return f"{plain(value)} {unit}".rstrip()
