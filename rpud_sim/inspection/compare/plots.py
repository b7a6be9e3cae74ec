"""Plots of a comparison: intervals of the differences, distributions, and series over time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np

from rpud_sim.inspection.compare.estimates import (
    DIFFERS,
    EQUIVALENT,
    SAME,
    TOO_FEW,
    UNDECIDED,
    FigureDifference,
)
from rpud_sim.inspection.compare.results import Comparison, QuantityComparison, WindowComparison
from rpud_sim.inspection.compare.values import (
    FIGURES,
    QUANTITIES,
    STATUS,
    ComparedQuantity,
    RecordedValues,
    series_of,
)
from rpud_sim.pages.plot import Axis, Layer, Line, Plot, Points, Rule, Zone

_CLASSES = 60
_TAIL = 0.002  # share of values beyond each end of a histogram
_DECADES = 30.0  # greatest over least, above which classes are equal in the logarithm
_APART = 0.5  # between the outer runs, in rows of the differences
_ROW = 19  # height of a row of the differences [pixels]
_BINS = 200  # of a series over time
_MOST_COMMANDS = 60  # that are drawn; more would be a solid surface
_COLORS = {
    DIFFERS: "series1",
    SAME: "muted",
    EQUIVALENT: "series2",
    UNDECIDED: "series4",
    TOO_FEW: "muted",
}
# Quantities over time; others are on the page as distributions.
_OVER_TIME = ("impact_rate", "peak_force", "reacting_force", "nodal_plane_position")


def difference_plot(found: Comparison, window: WindowComparison) -> Plot | None:
    """Return the relative differences with their intervals; None without any."""
    rows = [
        (quantity, [run[place] if len(run) > place else None for run in quantity.differences])
        for quantity in window.quantities
        for place in range(max(map(len, quantity.differences), default=0))
    ]
    if not any(each and math.isfinite(each.relative) for _, runs in rows for each in runs):
        return None
    layers: list[Layer] = [Rule("", 0.0, across=False, color="text", dash="solid")]
    if found.tolerance:
        edge = 100.0 * found.tolerance
        layers.insert(0, Zone("tolerance", -edge, edge, across=False))
    layers += _difference_points(found, rows)
    names = tuple(_row_name(rows, row) for row in range(len(rows)))
    one = len(found.names) == 2
    count = sum(each.decision == DIFFERS for _, runs in rows for each in runs if each)
    return Plot(
        "Differences from A, with 95 % intervals",
        tuple(layers),
        f"{count} of {len(rows) * (len(found.names) - 1)} figures differ from A.",
        y=Axis(categories=names, flipped=True, columns=_columns(rows) if one else ()),
        x=Axis("difference", "%"),
        height=(_ROW + 7 * (len(found.names) - 2)) * len(rows),
        width=1068,
    )


_Rows = Sequence[tuple[QuantityComparison, Sequence[FigureDifference | None]]]


def _difference_points(found: Comparison, rows: _Rows) -> Iterator[Points]:
    """Yield a layer for each run; if there is one alone, for each decision."""
    runs = len(found.names) - 1
    points: dict[tuple[str, str | int], list[tuple[float, float, float, float, str]]] = {}
    for row, (_, differences) in enumerate(rows):
        for number, each in enumerate(differences):
            if each is None or not math.isfinite(each.relative):
                continue
            key: tuple[str, str | int] = (each.decision, _COLORS[each.decision])
            if runs > 1:
                key = (f"{label(found, number + 1)} against A", number + 1)
            shift = (number - 0.5 * (runs - 1)) * _APART / max(runs - 1, 1)
            value, low, high = each.relative, each.relative_low, each.relative_high
            point = (row + shift, 100.0 * value, 100.0 * low, 100.0 * high, _told(each))
            points.setdefault(key, []).append(point)
    for (name, color), group in points.items():
        y, middle, low, high = np.array([point[:4] for point in group], float).T
        texts = tuple(point[4] for point in group)
        yield Points(name, middle, y, low, high, True, size=7.0, color=color, titles=texts)


def _told(each: FigureDifference) -> str:
    one, other, value, interval = each.texts
    figure = f"{each.compared.shown.label}, {FIGURES[each.figure]}"
    return f"{figure}: {one} and {other}, {value} ({interval}): {each.decision}"


def _row_name(rows: _Rows, row: int) -> str:
    quantity, runs = rows[row]
    figure = next(FIGURES[each.figure] for each in runs if each)
    if row and rows[row - 1][0] is quantity:
        return figure
    return f"{quantity.compared.shown.label}, {figure}"


def _columns(rows: _Rows) -> tuple[tuple[str, tuple[str, ...]], ...]:
    """Return values and difference beside each row of two runs."""
    cells = zip(*(each.texts if each else [""] * 4 for _, (each, *_) in rows), strict=True)
    return tuple(zip(("A", "B", "difference", "95 % interval"), cells, strict=True))


def label(found: Comparison, number: int) -> str:
    """Return letter and name of a run."""
    return f"{found.letters[number]} {found.names[number]:.60}"


def distribution_plots(found: Comparison, window: WindowComparison) -> Iterator[Plot]:
    """Yield a histogram of each quantity of all runs.

    There is none of a constant, and of a quantity that is averaged over the time.
    """
    for quantity in window.quantities:
        if quantity.compared.averaged:
            continue
        series = []
        for number, run in enumerate(found.values):
            span = window.begins[number], window.ends[number]
            values = series_of(run, quantity.compared, *span)
            series.append(np.empty(0) if values is None else values[np.isfinite(values)])
        if plot := _distribution(found, quantity, series):
            yield plot


def _distribution(
    found: Comparison, quantity: QuantityComparison, series: Sequence[np.ndarray]
) -> Plot | None:
    together = np.concatenate(series)
    if not len(together) or not float(together.max()) > float(together.min()):
        return None
    low, high = np.quantile(together, [_TAIL, 1.0 - _TAIL])
    if not high > low * (1.0 + 1e-6):
        low, high = float(together.min()), float(together.max())
    log = low > 0.0 and high > low * _DECADES
    edges = np.geomspace(low, high, _CLASSES + 1) if log else np.linspace(low, high, _CLASSES + 1)
    if not (np.diff(edges) > 0.0).all():
        return None
    shown = quantity.compared.shown
    layers = []
    for number, values in enumerate(series):
        if len(values):
            shares = 100.0 * np.histogram(values, edges)[0] / len(values)
            y = np.concatenate([shares, shares[-1:], [0.0]])
            x = np.append(edges, edges[-1]) * shown.scale
            layers.append(Line(label(found, number), x, y, steps=True, color=number))
    medians = ", ".join(
        f"{found.letters[number]} {shown.text(float(np.median(values)))}"
        for number, values in enumerate(series)
        if len(values)
    )
    axis = Axis("", shown.unit, log=log, low=low * shown.scale, high=high * shown.scale)
    return Plot(
        f"{shown.label} [{shown.unit}]", tuple(layers), f"Medians: {medians}.",
        Axis(low=0.0), axis, 130, 340,
    )  # fmt: skip


def time_plots(found: Comparison) -> list[Plot]:
    """Return the series of all runs over one time axis."""
    begin = min((run.begin for run in found.values if math.isfinite(run.begin)), default=0.0)
    end = max((run.end for run in found.values if math.isfinite(run.end)), default=0.0)
    if not end > begin:
        return []
    wanted = [q for q in QUANTITIES if q.name in _OVER_TIME or q.topic == STATUS]
    marks = tuple(_marks(found, end))
    plots = (_over_time(found, quantity, begin, end, marks) for quantity in wanted)
    return [plot for plot in plots if plot is not None]


def _over_time(
    found: Comparison,
    quantity: ComparedQuantity,
    begin: float,
    end: float,
    marks: tuple[Layer, ...],
) -> Plot | None:
    shown = quantity.shown
    layers: list[Layer] = [*marks]
    means = []
    for number, run in enumerate(found.values):
        points = _points(run, quantity)
        if points is None:
            continue
        times, values = points
        name = label(found, number)
        means.append(f"{found.letters[number]} {shown.text(float(values.mean()))}")
        values = values * shown.scale
        if quantity.topic == STATUS or quantity.name == "impact_rate":
            layers.append(Line(name, times, values, steps=True, color=number))
        else:
            layers.append(_envelope(name, times, values, number))
    if not means:
        return None
    alt = f"Means: {', '.join(means)}."
    x = Axis("simulation time", "s", low=begin, high=end)
    return Plot(shown.label, tuple(layers), alt, Axis(unit=shown.unit), x, 130, 520)


def _points(
    run: RecordedValues, quantity: ComparedQuantity
) -> tuple[np.ndarray, np.ndarray] | None:
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


def _envelope(name: str, times: np.ndarray, values: np.ndarray, color: int) -> Line:
    """Return least, mean and greatest value of equal parts of the time that have any."""
    width = (times[-1] - times[0]) / _BINS or 1.0
    place = ((times - times[0]) / width).astype(int)
    firsts = np.flatnonzero(np.diff(place, prepend=-1))
    counts = np.diff(np.append(firsts, len(place)))
    low, total, high = (part.reduceat(values, firsts) for part in (np.minimum, np.add, np.maximum))
    middle = times[0] + (place[firsts] + 0.5) * width
    return Line(name, middle, total / counts, color=color, low=low, high=high)


def _marks(found: Comparison, end: float) -> Iterator[Layer]:
    """Yield faults, and commands if there are not too many."""
    for event in found.faults:
        for begin, clear in dict.fromkeys(zip(event.times, event.ends, strict=True)):
            if begin is not None:
                until = end if clear is None else clear
                yield Zone("", begin, until, False, "fault", event.text)
    for event in () if hidden_commands(found) else found.commands:
        for time in dict.fromkeys(event.times):
            if time is not None:
                yield Rule("", time, False, "command", "dotted", event.text)


def hidden_commands(found: Comparison) -> int:
    """Return the number of commands, if they are too many to be drawn; otherwise 0."""
    return len(found.commands) if len(found.commands) > _MOST_COMMANDS else 0
