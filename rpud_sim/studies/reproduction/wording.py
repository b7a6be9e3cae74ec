"""Numbers, quantities and counterparts as text."""

from __future__ import annotations

import numpy as np

from rpud_sim.studies.reproduction.paper_numbers import Number
from rpud_sim.studies.reproduction.scores import Value

Row = tuple[str, ...]


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


def show_value(value: Value, number: Number) -> str:
    """Return mean, 95 % interval of the mean, and range of 95 % of single runs as text."""
    mean = show(value.mean, number.unit)
    if value.low == value.high:
        return mean
    runs = f"{show(value.low, number.unit)} to {show(value.high, number.unit)}"
    return f"{mean} ± {show(1.96 * value.standard_error, number.unit)} (runs: {runs})"


def show_ratio(value: Value, number: Number) -> str:
    """Return model over paper with two decimals, three digits from ten on."""
    ratio = value.over(number)
    return f"{ratio:.2f}" if ratio < 10.0 else plain(ratio)
