"""Plots of a fit: the posterior of its unknowns, and the model beside the targets."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from rpud_sim.pages.plot import Axis, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.pages.quantities import Quantity, quantity_in
from rpud_sim.studies.fit.fit import Comparison, Fit
from rpud_sim.studies.fit.identifiability import PERCENT, Identifiability, Interval
from rpud_sim.studies.fit.specification import unit_of

_MOST_DOTS = 1500
_BINS = 40
_TAIL = 0.002  # share of the posterior beyond each end of what is shown
_MARGIN = 0.15  # of what is shown, on each side
_ROW = 26  # height of a target [pixels]


def unknown_quantity(fit: Fit, name: str) -> Quantity:
    """Return how an unknown is shown."""
    greatest = abs(fit.specification.unknowns[name].maximum)
    digits = fit.found.intervals[name].digits if fit.found else 4
    return replace(quantity_in(unit_of(name), greatest, name), digits=digits)


def corner_rows(fit: Fit, found: Identifiability) -> list[list[Plot]]:
    """Return the posterior of every unknown and pair of them, as the rows of a triangle.

    Each is shown where the posterior and the best point are, not from bound to bound.
    """
    every = -(-len(fit.shares) // _MOST_DOTS)
    axes = {name: _axis(fit, name) for name in fit.specification.unknowns}
    rows = []
    for number, y in enumerate(axes):
        row = [_pair(fit, x, y, axes, every) for x in list(axes)[:number]]
        rows.append([*row, _single(fit, y, axes[y], found.intervals[y])])
    return rows


def corner_text(fit: Fit, found: Identifiability) -> str:
    """Return the intervals and the correlations of the unknowns in words."""
    texts = []
    for name, interval in found.intervals.items():
        shown = unknown_quantity(fit, name)
        ends = f"{shown.text(interval.low, unit=False)} to {shown.text(interval.high)}"
        texts.append(f"{name}: best point {shown.text(fit.best[name])}, {PERCENT} interval {ends}.")
    return " ".join([*texts, *(f"{ridge}." for ridge in found.ridges)])


def _single(fit: Fit, name: str, axis: Axis, interval: Interval) -> Plot:
    shown = unknown_quantity(fit, name)
    low, high = axis.low or 0.0, axis.high or 0.0
    edges = np.geomspace(low, high, _BINS + 1) if axis.log else np.linspace(low, high, _BINS + 1)
    counts, _ = np.histogram(shown.scale * fit.samples[name], edges)
    layers: tuple[Layer, ...] = (
        Zone(f"{PERCENT} interval", shown.scale * interval.low, shown.scale * interval.high, False),
        Line("posterior", edges, np.append(counts, 0) / max(len(fit.samples[name]), 1), steps=True),
        Rule("best point", shown.scale * fit.best[name], False, "series1", "solid"),
    )
    return Plot(name, layers, y=Axis(low=0.0), x=axis)


def _pair(fit: Fit, x: str, y: str, axes: dict[str, Axis], every: int) -> Plot:
    scale_x, scale_y = (unknown_quantity(fit, name).scale for name in (x, y))
    dots = scale_x * fit.samples[x][::every], scale_y * fit.samples[y][::every]
    best = np.array([scale_x * fit.best[x]]), np.array([scale_y * fit.best[y]])
    layers = (
        Points("posterior", *dots, size=2.5),
        Points("best point", *best, marker="x", size=10.0, color="series1"),
    )
    return Plot(y, layers, y=axes[y], x=axes[x])


def _axis(fit: Fit, name: str) -> Axis:
    """Return the axis of an unknown: where its posterior is, within the bounds."""
    spread, shown = fit.specification.unknowns[name], unknown_quantity(fit, name)
    low, high = np.quantile(fit.samples[name], [_TAIL, 1.0 - _TAIL]).tolist()
    low, high = min(low, fit.best[name]), max(high, fit.best[name])
    log = spread.scale == "log"
    # A posterior of one point has no width.
    if log:
        factor = max((high / low) ** _MARGIN, 1.001)
        low, high = low / factor, high * factor
    else:
        more = max(_MARGIN * (high - low), 1e-3 * (spread.maximum - spread.minimum))
        low, high = low - more, high + more
    low, high = max(low, spread.minimum), min(high, spread.maximum)
    return Axis(name, shown.unit, log, shown.scale * low, shown.scale * high)


def target_plot(fit: Fit) -> Plot:
    """Return the model over each target, with the target's tolerance."""
    shown = [item for item in fit.comparisons if item.target.value]
    places = np.arange(len(shown), dtype=float)
    tolerance = np.array([abs(item.target.error(0.0) / item.target.value) for item in shown])
    layers: list[Layer] = [
        Rule("", 1.0, False, dash="solid"),
        Points(
            "tolerance of the target", np.ones(len(shown)), places + 0.25,
            1.0 - tolerance, 1.0 + tolerance, across=True, size=3.0, color="muted",
        ),
    ]  # fmt: skip
    for held, name, color in (
        (False, "model at the best point", "series0"),
        (True, "held out", "series2"),
    ):
        chosen = [i for i, item in enumerate(shown) if item.target.hold_out == held]
        if chosen:
            ratio = np.array([shown[i].ratio for i in chosen])
            titles = tuple(str(shown[i]) for i in chosen)
            layers.append(Points(name, ratio, places[chosen], size=8.0, color=color, titles=titles))
    texts = [_texts(item) for item in shown]
    columns = (
        tuple(zip(("target", "model"), zip(*texts, strict=True), strict=True)) if texts else ()
    )
    titles = tuple(
        f"{item.target.source} {item.target.title}{' (held out)' * item.target.hold_out}".strip()
        for item in shown
    )
    far = max(shown, key=lambda item: abs(item.deviation), default=None)
    alt = "" if far is None else f"Furthest: {far}."
    up = Axis(categories=titles, flipped=True, columns=columns)
    return Plot("Targets", tuple(layers), alt, up, Axis("model / target"), _ROW * len(shown), 1068)


def _texts(item: Comparison) -> tuple[str, str]:
    shown = quantity_in(item.target.measure.unit, abs(item.target.value))
    return shown.text(item.target.value), shown.text(item.mean)
