"""Lines on a screen: no peak is lost, and no line crosses a gap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpud_sim.viewer.impacts import part_length

GAP = 3.0  # distance of two points, in usual ones, from which on there is a gap between them

Layer = dict[str, np.ndarray]  # ``t`` and ``mean``, or with ``low`` and ``high``, of equal shape


def usual(steps: np.ndarray) -> float:
    """Return the usual distance between points: nine of ten are not longer."""
    return float(np.quantile(steps, 0.9, method="lower")) if len(steps) else 0.0


def joined(layers: Sequence[Layer]) -> Layer:
    """Return layers one after another in one."""
    return {name: np.concatenate([each[name] for each in layers]) for name in layers[0]}


def with_gaps(layer: Layer) -> Layer:
    """Return a layer without its NaN, and with NaN between points that are far apart."""
    valid = np.isfinite(layer["mean"])
    layer = {name: values[valid] for name, values in layer.items()}
    times = layer["t"]
    steps = np.diff(times)
    places = np.flatnonzero(steps > GAP * max(usual(steps), 1e-9)) + 1
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

    ``times`` ascend [s] and ``values`` have no NaN, both of shape (n,), and not empty.
    """
    width = part_length(start, end, parts)
    part = np.floor(times / width)
    firsts = np.flatnonzero(np.diff(part, prepend=np.nan) != 0.0)
    return {
        "t": (part[firsts] + 0.5) * width,
        "mean": np.add.reduceat(values, firsts) / np.diff(np.append(firsts, len(times))),
        "low": np.minimum.reduceat(values, firsts),
        "high": np.maximum.reduceat(values, firsts),
    }
