"""Lines on a screen: no peak is lost, and no line crosses a gap."""

from __future__ import annotations

import numpy as np

from rpud_sim.viewer.impacts import part_length

GAP = 3.0  # distance of two points, in usual ones, from which on there is a gap between them

Layer = dict[str, np.ndarray]  # ``t`` and ``mean``, or with ``low`` and ``high``, of equal shape


def usual(steps: np.ndarray) -> float:
    """Return the usual distance between points: nine of ten are not longer."""
    return float(np.quantile(steps, 0.9, method="lower")) if len(steps) else 0.0


def with_gaps(layer: Layer, width: float = 0.0, known: float = np.inf) -> Layer:
    """Return a layer without its NaN, and with NaN between points that are far apart.

    ``width`` is that of the parts that the points stand for [s]. After ``known`` [s] values may be
    missing: no line joins parts there that do not touch each other.
    """
    valid = np.isfinite(layer["mean"])
    if not valid.all():
        layer = {name: values[valid] for name, values in layer.items()}
    times = layer["t"]
    if len(times) < 2:
        return layer
    steps = np.diff(times)
    early = times[1:] <= known
    longest = GAP * max(usual(steps[early]), width, 1e-9)
    places = np.flatnonzero(steps > np.where(early, longest, 1.5 * width)) + 1
    if not len(places):
        return layer
    middles = 0.5 * (times[places - 1] + times[places])
    return {
        name: np.insert(values, places, middles if name == "t" else np.nan)
        for name, values in layer.items()
    }


def thinned(times: np.ndarray, values: np.ndarray, most: int) -> Layer:
    """Return the least and the greatest value of equal parts of the points, at their own times.

    So no peak is lost, and every point is one of those given. ``times`` ascend [s] and ``values``
    have no NaN, both of shape (n,). The result has at most ``most`` points.
    """
    if len(times) <= most:
        return {"t": times, "mean": values}
    edges = np.linspace(0, len(times), max(1, most // 2) + 1).astype(np.intp)
    width = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    parts = values[places]
    rows = np.arange(len(places))
    both = np.column_stack([places[rows, parts.argmin(1)], places[rows, parts.argmax(1)]])
    kept = np.unique(np.concatenate([[0], both.ravel(), [len(times) - 1]]))
    return {"t": times[kept], "mean": values[kept]}


def binned(times: np.ndarray, values: np.ndarray, start: float, end: float, parts: int) -> Layer:
    """Return least, mean and greatest value in about so many parts of a range of time [s].

    ``times`` ascend [s] and ``values`` have no NaN, both of shape (n,).
    """
    width = part_length(start, end, parts)
    part = np.floor(times / width)
    firsts = np.flatnonzero(np.diff(part, prepend=np.nan) != 0.0)
    counts = np.diff(np.append(firsts, len(times)))
    return {
        "t": (part[firsts] + 0.5) * width,
        "mean": np.add.reduceat(values, firsts) / counts,
        "low": np.minimum.reduceat(values, firsts),
        "high": np.maximum.reduceat(values, firsts),
    }
