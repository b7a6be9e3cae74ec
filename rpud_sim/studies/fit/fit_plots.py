"""Pictures of a fit: pairs of unknowns in the posterior, and the model beside the targets."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpud_sim.studies.fit.fit import Fit
from rpud_sim.studies.fit.specification import unit_of

_MOST_DOTS = 1500
_DARK, _LIGHT, _BEST, _HELD = "#0072B2", "#9bbfd8", "#D55E00", "#009E73"


def plot_pairs(fit: Fit) -> Figure:
    """Return the posterior of every unknown and of every pair of them, between their bounds."""
    names = list(fit.specification.unknowns)
    count = len(names)
    size = max(2.3 * count, 4.5)
    figure = Figure(figsize=(size, size), layout="constrained")
    axes = figure.subplots(count, count, squeeze=False)
    every = -(-len(fit.shares) // _MOST_DOTS)
    for i, row in enumerate(names):
        for j, column in enumerate(names):
            axis = axes[i, j]
            if j > i:
                axis.set_axis_off()
                continue
            _scale(axis, fit, column, "x")
            if i == j:
                _histogram(axis, fit, column)
            else:
                _scale(axis, fit, row, "y")
                axis.plot(
                    fit.samples[column][::every],
                    fit.samples[row][::every],
                    ".",
                    color=_DARK,
                    markersize=2,
                    alpha=0.3,
                )
                axis.plot(fit.best[column], fit.best[row], "x", color=_BEST, markersize=8)
            axis.tick_params(labelsize="x-small")
            if i == count - 1:
                axis.set_xlabel(_label(column), fontsize="x-small")
            if j == 0 and i > 0:
                axis.set_ylabel(_label(row), fontsize="x-small")
    return figure


def plot_targets(fit: Fit) -> Figure:
    """Return the model over each target, with the target's tolerance and what is predicted."""
    shown = [item for item in fit.comparisons if item.target.value]
    figure = Figure(figsize=(9.0, 1.2 + 0.5 * len(shown)), layout="constrained")
    axis = figure.subplots()
    for place, item in enumerate(reversed(shown)):
        value = item.target.value
        tolerance = abs(item.target.tolerance / value)
        color = _HELD if item.target.hold_out else _DARK
        axis.barh(place, 2 * tolerance, left=1 - tolerance, height=0.6, color="#dde3e9")
        ends = sorted((item.low / value, item.high / value))
        axis.plot(ends, (place, place), color=color, linewidth=3, alpha=0.4)
        axis.plot(item.ratio, place, "o", color=color)
    axis.axvline(1.0, color="black", linewidth=0.8)
    labels = [f"{item.target.title}{' (held out)' * item.target.hold_out}" for item in shown]
    axis.set_yticks(range(len(shown)), reversed(labels), fontsize="small")
    axis.set_xlabel("model / target (grey: tolerance; line: 5 to 95 % of the posterior)")
    axis.grid(axis="x", alpha=0.3)
    return figure


def _histogram(axis: Axes, fit: Fit, name: str) -> None:
    spread = fit.specification.unknowns[name]
    edges = spread.at(np.linspace(0.0, 1.0, 41)).tolist()
    interval = fit.identifiability.intervals[name]
    axis.hist(fit.samples[name], bins=edges, color=_LIGHT)
    axis.axvspan(interval.low, interval.high, color=_DARK, alpha=0.12)
    axis.axvline(fit.best[name], color=_BEST)
    axis.set_yticks([])


def _scale(axis: Axes, fit: Fit, name: str, side: str) -> None:
    """Set scale, limits and ticks of an unknown: its bounds and the middle between them."""
    spread = fit.specification.unknowns[name]
    ticks = spread.at(np.array([0.0, 0.5, 1.0])).tolist()
    labels = [f"{tick:.2g}" for tick in ticks]
    if side == "x":
        axis.set_xscale(spread.scale)
        axis.set_xlim(spread.minimum, spread.maximum)
        axis.set_xticks(ticks, labels)
        axis.set_xticks([], minor=True)
    else:
        axis.set_yscale(spread.scale)
        axis.set_ylim(spread.minimum, spread.maximum)
        axis.set_yticks(ticks, labels)
        axis.set_yticks([], minor=True)


def _label(name: str) -> str:
    unit = unit_of(name)
    return f"{name} [{unit}]" if unit else name
