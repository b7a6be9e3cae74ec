"""Traces: points of a line on a screen, with NaN where a gap is."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAP = 3.0  # distance of two points, in usual ones, from which on there is a gap between them


@dataclass(frozen=True)
class Trace:
    """Points of a line."""

    x: np.ndarray  # times since the bag began, in ascending order, shape (n,) [s]
    y: np.ndarray  # values, shape (n,); NaN is a gap


EMPTY = Trace(np.empty(0), np.empty(0))


def with_gaps(times: np.ndarray, values: np.ndarray) -> Trace:
    """Return points in ascending order of time, with NaN between those that are far apart."""
    if len(times) < 3:
        return Trace(times, values)
    steps = np.diff(times)
    places = np.flatnonzero(steps > GAP * max(usual(steps), 1e-9)) + 1
    middles = 0.5 * (times[places - 1] + times[places])
    return Trace(np.insert(times, places, middles), np.insert(values, places, np.nan))


def held(times: np.ndarray, values: np.ndarray, end: float) -> Trace:
    """Return steps: each value holds until the next one, the last one until ``end`` [s].

    A gap breaks the line; before it the value holds for the usual time.
    """
    if not len(times):
        return EMPTY
    steps = np.diff(times)
    longest = GAP * usual(steps) if len(steps) else np.inf
    ends = np.append(times[1:], max(end, times[-1]))
    over = ends - times > longest
    until = np.where(over, times + (usual(steps) if len(steps) else 0.0), ends)
    x = np.column_stack([times, until, until])
    y = np.column_stack([values, values, np.where(over, np.nan, values)])
    return Trace(x.ravel(), y.ravel())


def usual(steps: np.ndarray) -> float:
    """Return the usual distance between points: nine of ten are not longer."""
    return float(np.quantile(steps, 0.9, method="lower")) if len(steps) else 0.0


def thinned(times: np.ndarray, values: np.ndarray, most: int) -> Trace:
    """Return the least and the greatest value of equal parts of the points, at their own times.

    So no peak is lost, and every point is one of those given. ``times`` ascend [s] and ``values``
    have no NaN, both of shape (n,). The result has at most ``most`` points.
    """
    if len(times) <= most:
        return Trace(times, values)
    edges = np.linspace(0, len(times), max(1, most // 2) + 1).astype(np.intp)
    width = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    parts = values[places]
    rows = np.arange(len(places))
    both = np.column_stack([places[rows, parts.argmin(1)], places[rows, parts.argmax(1)]])
    kept = np.unique(np.concatenate([[0], both.ravel(), [len(times) - 1]]))
    return Trace(times[kept], values[kept])


def envelope(
    times: np.ndarray,
    least: np.ndarray,
    greatest: np.ndarray,
    width: float,
    known: float = np.inf,
) -> Trace:
    """Return a line through the least and the greatest value of parts of the time.

    ``times`` are the beginnings of the parts that hold values [s], ``width`` is that of a part [s];
    arrays have the shape (n,). After ``known`` [s] values may be missing: no line joins parts there
    that do not touch each other.
    """
    if not len(times):
        return EMPTY
    steps = np.diff(times)
    early = times[1:] <= known
    longest = GAP * max(usual(steps[early]), width)
    places = np.flatnonzero(steps > np.where(early, longest, 1.5 * width)) + 1
    x = np.column_stack([times, times + width]).ravel()
    y = np.column_stack([least, greatest]).ravel()
    between = 0.5 * (times[places - 1] + width + times[places])
    return Trace(np.insert(x, 2 * places, between), np.insert(y, 2 * places, np.nan))
