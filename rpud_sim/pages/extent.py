"""Extent of plots: ends of their axes, and units in which their numbers are short."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator

import numpy as np

from rpud_sim.pages.plot import (
    Axis,
    Bars,
    Envelope,
    Layer,
    Line,
    Plot,
    Points,
    Rule,
    Spans,
    Stems,
    Zone,
)
from rpud_sim.pages.theme import series_color

_MARGIN = 0.05  # of the range
_PREFIXES = {9: "G", 6: "M", 3: "k", 0: "", -3: "m", -6: "µ", -9: "n"}
_SCALED = ("m", "m/s", "N", "N s", "J", "W", "s", "V", "A", "Hz", "Pa", "C", "ohm", "F", "H")


def layer_color(layer: Layer) -> str:
    """Return the name of a layer's colour."""
    return series_color(layer.color) if isinstance(layer.color, int) else layer.color


def readable_unit(unit: str, greatest: float) -> tuple[float, str]:
    """Return a factor and a unit with a prefix, in which a quantity has one to three digits."""
    if unit not in _SCALED or not math.isfinite(greatest) or greatest <= 0.0:
        return 1.0, unit
    exponent = min(max(3 * math.floor(math.log10(greatest) / 3.0 + 1e-12), -9), 9)
    if unit == "s":
        exponent = min(exponent, 0)
    return 10.0**-exponent, _PREFIXES[exponent] + unit


def axis_ends(plot: Plot, side: str) -> tuple[float, float]:
    """Return the ends of an axis, ``x`` or ``y``, that its data need, with a margin."""
    axis: Axis = getattr(plot, side)
    parts = [values[np.isfinite(values)] for layer in plot.layers for values in _held(layer, side)]
    found = np.concatenate([np.empty(0), *parts])
    found = found[found > 0.0] if axis.log else found
    low, high = (float(found.min()), float(found.max())) if len(found) else (1.0, 1.0)
    touching = not found.size or _rests_on_zero(plot, side)
    if axis.log:
        low, high = _log_ends(low, high)
    else:
        width = high - low
        margin = _MARGIN * width if width > 1e-9 * max(abs(low), abs(high)) else 0.5 * abs(high)
        margin = margin or 0.5
        low, high = (low if touching and low == 0.0 else low - margin), high + margin
    low = axis.low if axis.low is not None else low
    high = axis.high if axis.high is not None else high
    return low, high if high > low else low + 1.0


def _log_ends(low: float, high: float) -> tuple[float, float]:
    # By logarithms: the quotient of floats may overflow.
    margin = 10.0 ** (_MARGIN * (math.log10(high) - math.log10(low))) if high > low else 2.0
    return max(low / margin, math.ulp(0.0)), min(high * margin, sys.float_info.max)


def _rests_on_zero(plot: Plot, side: str) -> bool:
    return side == "y" and any(isinstance(layer, Stems | Bars) for layer in plot.layers)


def _held(layer: Layer, side: str) -> Iterator[np.ndarray]:
    if isinstance(layer, Rule):
        if layer.across == (side == "y"):
            yield np.array([layer.value])
    elif isinstance(layer, Zone):
        if layer.across == (side == "y"):
            yield np.array([layer.low, layer.high])
    elif isinstance(layer, Bars):
        held = layer.edges if side == "x" else np.append(layer.y, 0.0)
        yield np.asarray(held, float)
    elif isinstance(layer, Envelope):
        names = ("x",) if side == "x" else ("low", "high")
        yield from (np.asarray(getattr(layer, name), float) for name in names)
    elif isinstance(layer, Spans):
        names = ("begin", "end") if side == "x" else ("row",)
        yield from (np.asarray(getattr(layer, name), float) for name in names)
    elif isinstance(layer, Points):
        yield np.asarray(getattr(layer, side), float)
        if layer.across == (side == "x"):
            yield from (np.asarray(v, float) for v in (layer.low, layer.high) if v is not None)
    elif isinstance(layer, Line | Stems):
        yield np.asarray(getattr(layer, side), float)
        if isinstance(layer, Stems) and side == "y":
            yield np.zeros(1)
