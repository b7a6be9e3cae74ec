"""Plots of a comparison: intervals of the differences, distributions, and series over time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal

import numpy as np

from rpud_sim.inspection.compare.comparison import (
    Comparison,
    QuantityComparison,
    WindowComparison,
)
from rpud_sim.inspection.compare.estimates import DIFFERS
from rpud_sim.inspection.compare.quantities import QUANTITIES, STATUS, Quantity
from rpud_sim.inspection.compare.recorded_values import RecordedValues, series_of
from rpud_sim.inspection.report.running_statistics import Envelope as RunningEnvelope
from rpud_sim.pages.extent import readable_unit
from rpud_sim.pages.plot import (
    COMMAND,
    FAULT,
    Axis,
    Envelope,
    Layer,
    Line,
    Mark,
    Plot,
    Points,
    Rule,
    TimeColumn,
    Zone,
)

_CLASSES = 60
_STEPS = 200  # of a cumulative distribution
_TAIL = 0.002  # share of values beyond each end of a histogram
_DECADES = 30.0  # greatest over least, above which classes are equal in the logarithm
_DASHES: tuple[Literal["solid", "dashed", "dotted", "dotdash"], ...] = (
    "solid",
    "dashed",
    "dotted",
    "dotdash",
)
_APART = 0.5  # between the outer runs, in rows of an interval chart

# Quantities over time; others are on the page as distributions.
_OVER_TIME = ("impact_rate", "peak_force", "reacting_force", "nodal_plane_position")


def interval_plot(found: Comparison, window: WindowComparison) -> Plot | None:
    """Return the chart of the relative differences with their intervals; None without any."""
    rows = [
        (f"{quantity.title}, {figure}", place)
        for quantity in window.quantities
        for place, figure in enumerate(_tested(quantity))
        if any(
            len(run) > place and math.isfinite(run[place].relative) for run in quantity.differences
        )
    ]
    if not rows:
        return None
    by_title = {q.title: q for q in window.quantities}
    layers: list[Layer] = [Rule("no difference", 0.0, across=False, color="muted", dash="solid")]
    if found.tolerance:
        edge = 100.0 * found.tolerance
        layers.insert(0, Zone("tolerance", -edge, edge, across=False))
    runs = len(found.names) - 1
    differing = 0
    reached: list[np.ndarray] = [np.empty(0)]
    for number in range(runs):
        shift = (number - 0.5 * (runs - 1)) * _APART / max(runs - 1, 1) if runs > 1 else 0.0
        points = []
        for row, (text, place) in enumerate(rows):
            run = by_title[text.rpartition(", ")[0]].differences[number]
            if len(run) > place:
                each = run[place]
                points.append((row + shift, each.relative, each.relative_low, each.relative_high))
                differing += each.decision == DIFFERS
        y, middle, low, high = np.array(points, float).reshape(-1, 4).T
        reached += [100.0 * low, 100.0 * high]
        layers.append(
            Points(
                f"{label(found, number + 1)} against A",
                100.0 * middle,
                y,
                100.0 * low,
                100.0 * high,
                across=True, color=number + 1, size=7.0,
            )
        )  # fmt: skip
    ends = np.concatenate(reached)
    ends = ends[np.isfinite(ends)]
    reach = float(np.quantile(np.abs(ends), 0.9)) * 1.5 if len(ends) else 1.0
    reach = max(reach, 150.0 * found.tolerance, 1e-6)
    return Plot(
        "relative differences from A, with 95 % intervals",
        tuple(layers),
        f"{differing} of {len(rows) * runs} figures differ from A. An interval that does not "
        "cross zero may still be chance: the table has decisions corrected for their number.",
        y=Axis(categories=tuple(text for text, _ in rows), flipped=True),
        x=Axis("difference", "%", low=-reach, high=reach),
        height=max(160, (18 + 7 * (runs - 1)) * len(rows)),
    )


def _tested(quantity: QuantityComparison) -> tuple[str, ...]:
    return next(known.tested for known in QUANTITIES if known.name == quantity.quantity)


def label(found: Comparison, number: int) -> str:
    """Return letter and name of a run."""
    return f"{chr(ord('A') + number)} {found.names[number]:.60}"


def distribution_plots(
    found: Comparison, window: WindowComparison, quantity: QuantityComparison
) -> list[Plot]:
    """Return histogram and cumulative distribution of a quantity of all runs; none if constant."""
    series = []
    for number, run in enumerate(found.values):
        span = window.window.begins[number], window.window.ends[number]
        values = series_of(run, quantity.quantity, *span)
        series.append(np.empty(0) if values is None else values[np.isfinite(values)])
    together = np.concatenate(series)
    if not len(together) or not float(together.max()) > float(together.min()):
        return []
    low, high = np.quantile(together, [_TAIL, 1.0 - _TAIL])
    if not high > low * (1.0 + 1e-6):
        low, high = float(together.min()), float(together.max())
    log = low > 0.0 and high / low > _DECADES
    factor, unit = readable_unit(quantity.unit, float(max(abs(low), abs(high))))
    edges = np.geomspace(low, high, _CLASSES + 1) if log else np.linspace(low, high, _CLASSES + 1)
    if not (np.diff(edges) > 0.0).all():
        return []
    axis = Axis(quantity.title, unit, log=log, low=low * factor, high=high * factor)
    histogram: list[Layer] = []
    cumulative: list[Layer] = []
    shares = np.linspace(0.0, 1.0, _STEPS + 1)
    for number, values in enumerate(series):
        if not len(values):
            continue
        counts = 100.0 * np.histogram(values, edges)[0] / len(values)
        dash = _DASHES[number % len(_DASHES)]
        name = label(found, number)
        x = np.append(edges, edges[-1]) * factor
        y = np.concatenate([counts, counts[-1:], [0.0]])
        histogram.append(Line(name, x, y, steps=True, color=number, dash=dash))
        cumulative.append(
            Line(
                name, np.quantile(values, shares) * factor, 100.0 * shares, color=number, dash=dash
            )
        )
    text = "; ".join(
        f"{chr(ord('A') + n)}: median {np.median(v) * factor:.4g} {unit}, "
        f"95 % below {np.quantile(v, 0.95) * factor:.4g} {unit}"
        for n, v in enumerate(series) if len(v)
    )  # fmt: skip
    return [
        Plot(f"{quantity.title}: share of values in each of {_CLASSES} classes", tuple(histogram),
             f"{text}.", Axis(unit="%", low=0.0), axis, 150),
        Plot(f"{quantity.title}: share of values below", tuple(cumulative), "",
             Axis(unit="%", low=0.0, high=100.0), axis, 150),
    ]  # fmt: skip


def time_column(found: Comparison) -> TimeColumn | None:
    """Return the series of all runs over one time axis; None without any."""
    begin = min((run.begin for run in found.values if math.isfinite(run.begin)), default=0.0)
    end = max((run.end for run in found.values if math.isfinite(run.end)), default=0.0)
    if not end > begin:
        return None
    wanted = [q for q in QUANTITIES if q.name in _OVER_TIME or q.topic == STATUS]
    plots = [plot for q in wanted if (plot := _over_time(found, q, begin, end)) is not None]
    return (
        TimeColumn(tuple(plots), begin, end, _marks(found), label="simulation time")
        if plots
        else None
    )


def _over_time(found: Comparison, quantity: Quantity, begin: float, end: float) -> Plot | None:
    columns = [
        (number, *series)
        for number, run in enumerate(found.values)
        if (series := _points(run, quantity)) is not None
    ]
    if not columns:
        return None
    greatest = max(float(np.abs(values).max()) for _, _, values in columns)
    factor, unit = readable_unit(quantity.unit, greatest)
    layers: list[Layer] = []
    means = []
    for number, times, values in columns:
        name = label(found, number)
        means.append(f"{chr(ord('A') + number)} {values.mean() * factor:.4g} {unit}".rstrip())
        if quantity.topic == STATUS or quantity.name == "impact_rate":
            layers.append(Line(name, times, values * factor, steps=True, color=number))
            continue
        envelope = RunningEnvelope(end - begin)
        envelope.add(times - begin, values * factor)
        x, (least, mean, most) = envelope.steps()
        layers.append(Envelope(name, x + begin, least, mean, most, color=number))
    return Plot(quantity.title, tuple(layers), f"Means: {', '.join(means)}.", Axis(unit=unit))


def _points(run: RecordedValues, quantity: Quantity) -> tuple[np.ndarray, np.ndarray] | None:
    arrays = run.topics.get(quantity.topic)
    if arrays is None or len(arrays["time"]) < 2:
        return None
    if quantity.name == "impact_rate":
        times = arrays["time"]
        edges = np.linspace(run.begin, run.end, 201)
        counts = np.histogram(times, edges)[0] / np.diff(edges)
        return edges, np.append(counts, counts[-1])
    if quantity.column not in arrays:
        return None
    values = arrays[quantity.column]
    known = np.isfinite(values)
    return (arrays["time"][known], values[known]) if known.any() else None


def _marks(found: Comparison) -> Sequence[Mark]:
    """Return commands and faults; what all runs have at one time is one mark."""
    marks = []
    for kind, events in ((COMMAND, found.commands), (FAULT, found.faults)):
        for event in events:
            at: dict[tuple[float, float | None], list[str]] = {}
            for number, (time, end) in enumerate(zip(event.times, event.ends, strict=True)):
                if time is not None:
                    at.setdefault((round(time, 6), end), []).append(chr(ord("A") + number))
            for (time, end), letters in at.items():
                whose = "" if len(letters) == len(found.names) else f" ({', '.join(letters)})"
                marks.append(Mark(kind, time, f"{event.text}{whose}", end))
    return marks
