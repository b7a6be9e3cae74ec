"""Pictures of a sweep: every figure over every swept parameter, with intervals.

A marker is the mean over all points with one value of the parameter, whatever the other parameters
are. In designs without repeated values it is the mean over a class of neighbouring values. The bar
is the 95 % interval of that mean by Student's t, from the spread of the points; a single point has
the spread of its ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from scipy import stats

from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.sweep.specification import Range, Specification, Values
from rpud_sim.studies.sweep.tables import error_name

_MOST_CLASSES = 12
_CONFIDENCE = 0.95
_PER_PICTURE = 6  # parameters side by side
_MOST_DOTS = 2000


def plot_points(
    specification: Specification, points: Mapping[str, np.ndarray]
) -> dict[str, Figure]:
    """Return the pictures by name, each with a row for each figure and a column for each parameter.

    Args:
        specification: of the sweep.
        points: the table of points, by column.
    """
    names = list(specification.swept)
    groups = [names[i : i + _PER_PICTURE] for i in range(0, len(names), _PER_PICTURE)]
    return {
        f"figures_{number}" if len(groups) > 1 else "figures": _matrix(specification, points, group)
        for number, group in enumerate(groups, 1)
    }


def _matrix(
    specification: Specification, points: Mapping[str, np.ndarray], names: list[str]
) -> Figure:
    size = (max(3.2 * len(names), 5.0), 2.0 * len(FIGURES))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(len(FIGURES), len(names), squeeze=False, sharex="col", sharey="row")
    for row, (output, unit) in zip(axes, FIGURES.items(), strict=True):
        for axis, name in zip(row, names, strict=True):
            _draw(axis, specification, points, name, output)
            axis.grid(alpha=0.3)
        row[0].set_ylabel(_label(output, unit), fontsize="small")
    for axis, name in zip(axes[-1], names, strict=True):
        unit = QUANTITIES[name].unit if name in QUANTITIES else ""
        axis.set_xlabel(_label(name, unit), fontsize="small")
    return figure


def _draw(
    axis: Axes,
    specification: Specification,
    points: Mapping[str, np.ndarray],
    name: str,
    output: str,
) -> None:
    spread = specification.swept[name]
    places = _places(points[name], spread)
    choices = places is not points[name]
    if len(specification.swept) > 1 or _in_classes(specification, name):
        # The points behind each marker.
        every = -(-len(places) // _MOST_DOTS)
        axis.plot(
            places[::every], points[output][::every], ".", color="tab:gray", markersize=1, alpha=0.5
        )
    found = list(marginal_means(specification, points, name, output))
    if found:
        at, mean, half = np.array(found).T
        line = "none" if choices else "-"
        axis.errorbar(
            at, mean, half, marker="o", markersize=3, linewidth=1, capsize=2, linestyle=line
        )
    if isinstance(spread, Range) and spread.scale == "log":
        axis.set_xscale("log")
    if choices:
        axis.set_xticks(range(len(spread.levels())), [str(value) for value in spread.levels()])
        axis.margins(x=0.3)


def _places(values: np.ndarray, spread: Range | Values) -> np.ndarray:
    """Return the positions of values on an axis: numbers as they are, choices by their index."""
    if isinstance(spread, Values) and isinstance(spread.values[0], str):
        numbers = {value: number for number, value in enumerate(spread.values)}
        return np.array([numbers[value] for value in values], dtype=float)
    return values


def marginal_means(
    specification: Specification, points: Mapping[str, np.ndarray], name: str, output: str
) -> Iterator[tuple[float, float, float]]:
    """Yield value, mean, and half its 95 % interval for each level or class of a parameter.

    The interval of a single point with a single member is NaN.
    """
    spread = specification.swept[name]
    places = _places(points[name], spread)
    valid = ~np.isnan(points[output])
    if _in_classes(specification, name):
        order = np.argsort(places, kind="stable")
        number = min(math.isqrt(len(places)), _MOST_CLASSES)
        classes = [part[valid[part]] for part in np.array_split(order, number)]
    else:
        classes = [np.flatnonzero(valid & (places == level)) for level in np.unique(places)]
    for members in classes:
        values = points[output][members]
        if len(values) > 1:
            error = np.std(values, ddof=1) / np.sqrt(len(values))
            freedom = len(values) - 1
        elif len(values) == 1:
            error = points[error_name(output)][members[0]]
            freedom = points["members"][members[0]] - 1
        else:
            continue
        half = stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, freedom) * error if freedom else np.nan
        yield float(places[members].mean()), float(values.mean()), float(half)


def _in_classes(specification: Specification, name: str) -> bool:
    """Whether a parameter has a different value at every point."""
    return specification.design != "grid" and isinstance(specification.swept[name], Range)


def _label(name: str, unit: str) -> str:
    return f"{name}\n[{unit}]" if unit else name
