"""Plots of a sweep: every figure over every swept parameter, with intervals.

A marker is the mean over all points with one value of the parameter, whatever the other parameters
are. In designs without repeated values it is the mean over a class of neighbouring values. The bar
is the 95 % interval of that mean by Student's t, from the spread of the points; a single point has
the spread of its ensemble.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.foundation.quantities import Quantity as ParameterQuantity
from rpud_sim.pages.plot import Axis, Layer, Plot, Points
from rpud_sim.pages.quantities import Quantity, figure_quantity, quantity_in
from rpud_sim.simulation.configuration import PARAMETERS
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.sweep.indices import independent
from rpud_sim.studies.sweep.specification import Range, SweepSpecification, Values
from rpud_sim.studies.sweep.tables import error_name

_MOST_CLASSES = 12
_CONFIDENCE = 0.95
_MOST_DOTS = 20_000  # of all plots: a dot takes a dozen bytes of the page
_MOST_PLOT_DOTS = 500
_HEIGHT, _WIDTH = 150, 344  # of a plot [pixels]
_ROW = 17  # height of a word [pixels]
_HEADLINES = (
    "drill_tool_impact_rate",
    "contact_force_mean",
    "penetration_rate",
    "energy_absorbed_rate",
    "reacting_force_mean",
)


def headline_figures(specification: SweepSpecification, most: int = 3) -> tuple[str, ...]:
    """Return the figures that the page shows first: the first that the sweep names, or ours."""
    chosen = specification.figures
    if set(FIGURES) <= set(chosen):
        chosen = tuple(name for name in _HEADLINES if name in chosen)
    return chosen[:most]


def point_plot(
    specification: SweepSpecification, points: Mapping[str, np.ndarray], name: str, figure: str
) -> Plot:
    """Return the plot of one figure over one axis."""
    points = independent(specification, points)
    plots = len(specification.axes) * len(specification.figures)
    most = max(1, min(_MOST_PLOT_DOTS, _MOST_DOTS // plots))
    spread = specification.axes[name]
    shown, along = figure_quantity(figure), axis_quantity(specification, name)
    places = _places(points[name], spread)
    choices = _is_choice(spread)
    scale = 1.0 if choices else along.scale
    layers: list[Layer] = []
    if len(specification.axes) > 1 or _in_classes(specification, name):
        every = -(-len(places) // most)
        dots = scale * places[::every], shown.scale * points[figure][::every]
        layers.append(Points("single points", *_turned(dots, choices), size=2.5, color="muted"))
    found = list(marginal_means(specification, points, name, figure))
    if found:
        at, mean, half = np.array(found).T
        ends = shown.scale * (mean - half), shown.scale * (mean + half)
        marks = _turned((scale * at, shown.scale * mean), choices)
        label = "mean with its 95 % interval"
        layers.append(Points(label, *marks, *ends, across=choices, joined=not choices))
    words = tuple(str(value) for value in spread.levels()) if choices else ()
    alt = _trend(found, shown, along, words)
    if choices:  # their words stand below each other
        axes = Axis(categories=words, flipped=True), Axis(figure, shown.unit)
        height = max(_HEIGHT, _ROW * len(words))
        return Plot(f"{figure} by {name}", tuple(layers), alt, *axes, height, _WIDTH)
    log = isinstance(spread, Range) and spread.scale == "log"
    axes = Axis(unit=shown.unit), Axis(name, along.unit, log)
    return Plot(figure, tuple(layers), alt, *axes, _HEIGHT, _WIDTH)


def _turned(pair: tuple[np.ndarray, np.ndarray], turned: bool) -> tuple[np.ndarray, np.ndarray]:
    return pair[::-1] if turned else pair


def _trend(
    found: list[tuple[float, float, float]],
    shown: Quantity,
    along: Quantity,
    words: tuple[str, ...],
) -> str:
    """Return where the mean is least and greatest, in words."""
    if not found:
        return "No point has this figure."
    low, high = (extreme(found, key=lambda mark: mark[1]) for extreme in (min, max))
    if low[1] == high[1]:
        return f"{shown.text(low[1])} everywhere."
    least, most = (
        f"{shown.text(mean)} at {words[round(at)] if words else along.text(at)}"
        for at, mean, _ in (low, high)
    )
    return f"Mean: least {least}, greatest {most}."


def share_plot(figure: str, item: Mapping[str, Any]) -> Plot:
    """Return the shares of a figure's variance that inputs cause, the greatest first."""
    causes = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
    names = (*(name for name, _ in causes), "noise")
    noise = (item["noise_share"], *item["noise_share_interval"])
    rows = np.array(
        [*((share["total"], *share["total_interval"]) for _, share in causes), noise], float
    )
    value, low, high = rows.T
    places = np.arange(len(names), dtype=float)
    alone = np.array([share["first"] for _, share in causes])
    layers = (
        Points("in all, with its 95 % interval", value, places, low, high, across=True),
        Points("alone", alone, places[:-1] + 0.25, size=5.0, color="muted"),
    )
    alt = f"Greatest share: {names[0]} with {value[0]:.2f}; noise {value[-1]:.2f}."
    axes = Axis(categories=names, flipped=True), Axis("share of the variance")
    return Plot(figure, layers, alt, *axes, _ROW * len(names), _WIDTH)


def _is_choice(spread: Range | Values) -> bool:
    return isinstance(spread, Values) and isinstance(spread.values[0], str | bool)


def unit_of(name: str) -> str:
    """Return the unit of an axis; empty without one."""
    allowed = PARAMETERS[name].allowed if name in PARAMETERS else None
    return allowed.unit if isinstance(allowed, ParameterQuantity) else ""


def axis_quantity(specification: SweepSpecification, name: str) -> Quantity:
    """Return how an axis is shown."""
    spread = specification.axes[name]
    if _is_choice(spread):
        return Quantity(name, name, "")
    ends = (spread.minimum, spread.maximum) if isinstance(spread, Range) else spread.values
    return quantity_in(unit_of(name), max(abs(float(end)) for end in ends), name)


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
