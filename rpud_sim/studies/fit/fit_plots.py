"""Plots of a fit: unknowns and pairs of them in the posterior, and the model beside the targets."""

from __future__ import annotations

import itertools

import numpy as np

from rpud_sim.pages.extent import readable_unit
from rpud_sim.pages.plot import Axis, Bars, Layer, Plot, Points, Rule, Zone
from rpud_sim.studies.fit.fit import Comparison, Fit
from rpud_sim.studies.fit.specification import unit_of

_MOST_DOTS = 1500
_BINS = 40
_POSTERIOR, _BEST, _HELD = 0, 1, 2  # colors
_ROW = 34  # pixels of a target


def unknown_plots(fit: Fit) -> tuple[Plot, ...]:
    """Return the posterior of every unknown, between its bounds."""
    plots = []
    for name, spread in fit.specification.unknowns.items():
        factor, unit = _unit(fit, name)
        edges = spread.at(np.linspace(0.0, 1.0, _BINS + 1))
        counts, _ = np.histogram(fit.samples[name], edges)
        interval = fit.identifiability.intervals[name]
        low, high, best = (factor * x for x in (interval.low, interval.high, fit.best[name]))
        layers: tuple[Layer, ...] = (
            Zone("90 % interval", low, high, False, "series0"),
            Bars(
                "posterior",
                factor * edges,
                counts / max(len(fit.samples[name]), 1),
                color=_POSTERIOR,
            ),
            Rule("best point", best, False, _color(_BEST), "solid"),
        )
        axis = _axis(fit, name)
        alt = (
            f"Best point {best:.4g}, 90 % interval {low:.4g} to {high:.4g}, bounds {axis.low:.4g} "
            f"to {axis.high:.4g} {unit}".rstrip()
        )
        up = Axis(low=0.0)
        plots.append(Plot(f"share of the posterior: {name}", layers, f"{alt}.", up, axis))
    return tuple(plots)


def pair_plots(fit: Fit) -> tuple[Plot, ...]:
    """Return the posterior of every pair of unknowns, between their bounds."""
    every = -(-len(fit.shares) // _MOST_DOTS)
    names = list(fit.specification.unknowns)
    plots = []
    for column, row in itertools.combinations(range(len(names)), 2):
        x, y = names[column], names[row]
        correlation = fit.identifiability.correlation[row][column]
        factors = _unit(fit, x)[0], _unit(fit, y)[0]
        best_x, best_y = np.array([[factors[0] * fit.best[x]], [factors[1] * fit.best[y]]])
        layers = (
            Points(
                "posterior",
                factors[0] * fit.samples[x][::every],
                factors[1] * fit.samples[y][::every],
                size=2.5,
                color=_POSTERIOR,
            ),
            Points("best point", best_x, best_y, marker="x", size=11, color=_BEST),
        )
        alt = f"Rank correlation {correlation:.2f}."
        plots.append(Plot(y, layers, alt, _axis(fit, y), _axis(fit, x), 220))
    return tuple(plots)


def target_plot(fit: Fit) -> Plot:
    """Return the model over each target, with the target's tolerance and what is predicted."""
    shown = [item for item in fit.comparisons if item.target.value]
    places = np.arange(len(shown), dtype=float)
    tolerance = np.array([abs(item.target.tolerance / item.target.value) for item in shown])
    layers: list[Layer] = [
        Rule("the target", 1.0, False, dash="solid"),
        Points(
            "tolerance",
            np.ones(len(shown)),
            places + 0.25,
            1.0 - tolerance,
            1.0 + tolerance,
            across=True,
            size=1.0,
            color="muted",
        ),
    ]
    for held, name, color in (
        (False, "model; bar: 5 to 95 % of the posterior", _POSTERIOR),
        (True, "held out", _HELD),
    ):
        chosen = [i for i, item in enumerate(shown) if item.target.hold_out == held]
        if chosen:
            low, high = np.sort([_predicted(shown[i]) for i in chosen], axis=1).T
            ratio = np.array([shown[i].ratio for i in chosen])
            layers.append(
                Points(name, ratio, places[chosen], low, high, across=True, size=8.0, color=color)
            )
    titles = tuple(f"{item.target.title}{' (held out)' * item.target.hold_out}" for item in shown)
    far = max(shown, key=lambda item: abs(item.deviation), default=None)
    alt = "" if far is None else f"Furthest: {far.target.title}, {far.ratio:.3f} of the target."
    across = Axis("model / target")
    height = 40 + _ROW * len(shown)
    return Plot("targets", tuple(layers), alt, Axis(categories=titles), across, height)


def _predicted(item: Comparison) -> tuple[float, float]:
    return item.low / item.target.value, item.high / item.target.value


def _axis(fit: Fit, name: str) -> Axis:
    spread, (factor, unit) = fit.specification.unknowns[name], _unit(fit, name)
    return Axis(name, unit, spread.scale == "log", factor * spread.minimum, factor * spread.maximum)


def _unit(fit: Fit, name: str) -> tuple[float, str]:
    """Return a factor from SI units and the unit in which an unknown is short to read."""
    return readable_unit(unit_of(name), fit.specification.unknowns[name].maximum)


def _color(number: int) -> str:
    return f"series{number}"
