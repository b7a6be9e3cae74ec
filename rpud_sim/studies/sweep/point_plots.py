"""Plots of a sweep: every figure over every swept parameter, with intervals.

A marker is the mean over all points with one value of the parameter, whatever the other parameters
are. In designs without repeated values it is the mean over a class of neighbouring values. The bar
is the 95 % interval of that mean by Student's t, from the spread of the points; a single point has
the spread of its ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping

import numpy as np
from scipy import stats

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.pages.plot import Axis, Layer, Plot, Points
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.studies.sweep.indices import independent
from rpud_sim.studies.sweep.specification import SWEEP_FIGURES, Range, SweepSpecification, Values
from rpud_sim.studies.sweep.tables import error_name

_MOST_CLASSES = 12
_CONFIDENCE = 0.95
_MOST_DOTS = 60_000  # of all plots: a dot takes 21 bytes of the page
_MOST_PLOT_DOTS = 2000


def point_plots(
    specification: SweepSpecification, points: Mapping[str, np.ndarray]
) -> dict[str, tuple[Plot, ...]]:
    """Return for each axis the plots of all figures."""
    points = independent(specification, points)
    plots = len(specification.axes) * len(specification.figures)
    most = min(_MOST_PLOT_DOTS, _MOST_DOTS // plots)
    return {
        name: tuple(
            _plot(specification, points, name, figure, most) for figure in specification.figures
        )
        for name in specification.axes
    }


def _plot(
    specification: SweepSpecification,
    points: Mapping[str, np.ndarray],
    name: str,
    figure: str,
    most: int,
) -> Plot:
    spread = specification.axes[name]
    places = _places(points[name], spread)
    choices = _is_choice(spread)
    layers: list[Layer] = []
    if len(specification.axes) > 1 or _in_classes(specification, name):
        every = -(-len(places) // most)
        dots = places[::every], points[figure][::every]
        layers.append(Points("points", *dots, size=2.5, color="muted"))
    found = list(marginal_means(specification, points, name, figure))
    if found:
        at, mean, half = np.array(found).T
        ends = mean - half, mean + half
        label = "mean with its 95 % interval"
        layers.append(Points(label, at, mean, *ends, color=0, joined=not choices))
    unit = unit_of(name)
    across = Axis(name, unit, log=isinstance(spread, Range) and spread.scale == "log")
    if choices:
        across = Axis(name, categories=tuple(str(value) for value in spread.levels()))
    return Plot(
        figure, tuple(layers), _trend(found, across), Axis(unit=SWEEP_FIGURES[figure]), across, 200
    )


def _trend(found: list[tuple[float, float, float]], across: Axis) -> str:
    """Return where the mean is least and greatest, in words."""
    if not found:
        return "No point has this figure."
    low, high = (extreme(found, key=lambda mark: mark[1]) for extreme in (min, max))
    if low[1] == high[1]:
        return f"{low[1]:.4g} everywhere."
    least, most = (f"{mean:.4g} at {_place(at, across)}" for at, mean, _ in (low, high))
    return f"Mean: least {least}, greatest {most}."


def _place(value: float, across: Axis) -> str:
    if across.categories:
        return across.categories[round(value)]
    return f"{value:.4g} {across.unit}".rstrip()


def _is_choice(spread: Range | Values) -> bool:
    return isinstance(spread, Values) and isinstance(spread.values[0], str | bool)


def unit_of(name: str) -> str:
    """Return the unit of an axis; empty without one."""
    allowed = PARAMETERS[name].allowed if name in PARAMETERS else None
    return allowed.unit if isinstance(allowed, Quantity) else ""


def _places(values: np.ndarray, spread: Range | Values) -> np.ndarray:
    """Return the positions of values on an axis: numbers as they are, choices by their index."""
    if isinstance(spread, Values) and _is_choice(spread):
        numbers = {value: number for number, value in enumerate(spread.values)}
        return np.array([numbers[value] for value in values], dtype=float)
    return values


def marginal_means(
    specification: SweepSpecification, points: Mapping[str, np.ndarray], name: str, figure: str
) -> Iterator[tuple[float, float, float]]:
    """Yield value, mean, and half its 95 % interval for each level or class of a parameter.

    The interval of a single point with a single member is NaN.
    """
    spread = specification.axes[name]
    places = _places(points[name], spread)
    valid = ~np.isnan(points[figure])
    if _in_classes(specification, name):
        order = np.argsort(places, kind="stable")
        number = min(math.isqrt(len(places)), _MOST_CLASSES)
        classes = [part[valid[part]] for part in np.array_split(order, number)]
    else:
        classes = [np.flatnonzero(valid & (places == level)) for level in np.unique(places)]
    for members in classes:
        values = points[figure][members]
        if len(values) > 1:
            error = np.std(values, ddof=1) / np.sqrt(len(values))
            freedom = len(values) - 1
        elif len(values) == 1:
            error = points[error_name(figure)][members[0]]
            freedom = points["members"][members[0]] - 1
        else:
            continue
        half = stats.t.ppf(0.5 + 0.5 * _CONFIDENCE, freedom) * error if freedom else np.nan
        yield float(places[members].mean()), float(values.mean()), float(half)


def _in_classes(specification: SweepSpecification, name: str) -> bool:
    """Whether a parameter has a different value at every point."""
    return specification.design != "grid" and isinstance(specification.axes[name], Range)
