"""What plots show, in words and numbers made of their data."""

from __future__ import annotations

import dataclasses

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

_ZERO = 1e-9  # of the greatest value: what is smaller comes of rounding
_WRITTEN_OUT = 1e7  # numbers below have no exponent
_FEW = 12  # points up to which a line is described by its ends


def described(plot: Plot) -> Plot:
    """Return a plot whose text says what each layer shows, after what the text says already."""
    texts = [
        plot.alt,
        *(f"{layer.name}: {seen}." for layer in plot.layers if (seen := _seen(layer, plot))),
    ]
    return dataclasses.replace(plot, alt=" ".join(text for text in texts if text))


def _seen(layer: Layer, plot: Plot) -> str:
    """Return what is seen of a layer; empty where its name says it."""
    named = any(sign.isdigit() for sign in layer.name)
    if isinstance(layer, Rule):
        return "" if named else number(layer.value)
    if isinstance(layer, Zone):
        return "" if named else f"{number(layer.low)} to {number(layer.high)}"
    if isinstance(layer, Bars):
        return _bars(layer)
    if isinstance(layer, Envelope):
        return _extent(np.concatenate([layer.low, layer.high]), plot.y)
    if isinstance(layer, Spans):
        return f"{len(layer.begin)} from {_place(float(np.min(layer.begin)), plot.x)} on"
    if isinstance(layer, Points) and layer.values is not None:
        return _least(layer, layer.values, plot)
    return _track(layer, plot)


def _track(layer: Line | Points | Stems, plot: Plot) -> str:
    x, y = np.asarray(layer.x, float), np.asarray(layer.y, float)
    if plot.y.categories:
        return _extent(x, plot.x)
    shown = np.isfinite(x) & np.isfinite(y) & ((y > 0.0) | (not plot.y.log))
    x, y = x[shown], y[shown]
    if len(y) == 1:
        return f"{number(y[0])} at {_place(x[0], plot.x)}"
    if 1 < len(y) <= _FEW and not isinstance(layer, Stems):
        first, last = (f"{number(y[i])} at {_place(x[i], plot.x)}" for i in (0, -1))
        return f"{first}, {last}"
    return _extent(y, plot.y)


def _bars(layer: Bars) -> str:
    heights = np.asarray(layer.y, float)
    total = np.nansum(heights)
    if not total > 0.0:
        return "nothing"
    shares = np.cumsum(np.nan_to_num(heights)) / total
    first, last = (min(int(np.searchsorted(shares, end)), len(heights) - 1) for end in (0.05, 0.95))
    return f"90 % between {number(layer.edges[first])} and {number(layer.edges[last + 1])}"


def _least(layer: Points, values: np.ndarray, plot: Plot) -> str:
    values = np.asarray(values, float)
    if not np.isfinite(values).any():
        return "nothing"
    least = int(np.nanargmin(values))
    at = f"{_place(float(layer.x[least]), plot.x)}, {_place(float(layer.y[least]), plot.y)}"
    return f"least {number(values[least])} at {at}; greatest {number(float(np.nanmax(values)))}"


def _extent(values: np.ndarray, axis: Axis) -> str:
    values = np.asarray(values, float)
    values = values[np.isfinite(values) & ((values > 0.0) | (not axis.log))]
    if not len(values):
        return "nothing"
    nothing = _ZERO * np.abs(values).max()
    low, high = (number(0.0 if abs(end) < nothing else end) for end in (values.min(), values.max()))
    return low if low == high else f"{low} to {high}"


def _place(value: float, axis: Axis) -> str:
    if axis.categories:
        return axis.categories[min(max(round(value), 0), len(axis.categories) - 1)]
    return f"{number(value)} {axis.unit}".rstrip()


def number(value: float) -> str:
    """Return a number with as many digits as a reader compares."""
    text = f"{value:.4g}"
    return f"{float(text):.0f}" if "e+" in text and abs(value) < _WRITTEN_OUT else text
