"""Plots of a report over time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from rpud_sim.inspection.report import wording
from rpud_sim.inspection.report.changes import Change
from rpud_sim.inspection.report.drill_topics import Impacts, Waveform
from rpud_sim.inspection.report.run_marks import exact_steps, series_steps
from rpud_sim.inspection.report.running_statistics import Distribution, Envelope
from rpud_sim.inspection.report.topic_survey import Series, TopicSurvey
from rpud_sim.pages.extent import readable_unit
from rpud_sim.pages.plot import FAULT, Axis, Bars, Layer, Line, Mark, Plot, Spans, Stems, TimeColumn
from rpud_sim.pages.plot import Envelope as EnvelopeLayer
from rpud_sim.pages.words import number

LABEL = "time since the bag began"

_DECADES = 100.0  # greatest over least mean, from which an axis is logarithmic
_NAME = 60  # characters
_PARTS = 200  # of the time, for rates
_MOST_FAULTS = 60


class TimePlots:
    """Maker of the plots of one run, which all show the same ``span`` of time [s] and marks."""

    def __init__(self, span: float, marks: Sequence[Mark]) -> None:
        self._span = max(span, 1e-3)
        self._marks = marks

    def column(self, plots: Sequence[Plot]) -> TimeColumn:
        """Return the column of plots; all columns of the page zoom together."""
        return TimeColumn(tuple(plots), 0.0, self._span, self._marks, "time", LABEL)

    def impacts(self, impacts: Impacts, topic: TopicSurvey) -> list[Plot]:
        """Return peak forces, and the rate and the power of impacts."""
        item = next(item for item in topic.series if item.column.name == "peak_force")
        scale = _scale("N", item.values)
        edges, counts, joules = _coarser(impacts.power, self._span)
        return [
            self._plot(
                "peak contact force", item.values, item.envelope, scale, _peaks(item, scale)
            ),
            self._bars("impact rate", "1/s", edges, counts, 0),
            self._bars("power of the arriving free mass", "W", edges, joules, 2),
        ]

    def series(self, item: Series, name: str = "") -> Plot:
        """Return a column of a topic over time; the plot's name is that of the column if empty."""
        name = name or f"{item.column.name.replace('_', ' '):.{_NAME}}"
        scale = _scale(item.column.unit, item.values)
        steps = series_steps(item, scale[0])
        layer: Layer = (
            Line("value", *steps, steps=True)
            if steps is not None
            else _envelope("mean (least … greatest)", item.envelope, scale[0])
        )
        return self._plot(name, item.values, item.envelope, scale, layer)

    def weight_on_bit(self, changes: Sequence[Change]) -> Iterator[Plot]:
        """Yield the weight on bit that was commanded, if the journal says it."""
        known = [(max(c.time, 0.0), c.weight_on_bit) for c in changes if c.time <= self._span]
        if not any(weight is not None for _, weight in known):
            return
        times = np.array([*(time for time, _ in known), self._span])
        weights = np.array([*(weight for _, weight in known), known[-1][1]], float)
        first, last = (number(float(weights[place])) for place in (0, -1))
        ends = f"{number(float(np.nanmin(weights)))} and {number(float(np.nanmax(weights)))} N"
        yield Plot(
            "weight on bit",
            (Line("commanded", times, weights, steps=True),),
            f"Weight on bit: between {ends}; {first} N at first, {last} N at last.",
            Axis(unit="N"),
            height=120,
        )

    def delay(self, topic: TopicSurvey) -> Plot:
        """Return the time from the stamps of a topic's messages to their log times."""
        timing = topic.timing
        scale = _scale("s", timing.delay)
        layer = _envelope("mean (least … greatest)", timing.delays, scale[0])
        name = f"log − stamp of {topic.name:.{_NAME}}"
        return self._plot(name, timing.delay, timing.delays, scale, layer)

    def faults(self) -> Plot:
        shown = [mark for mark in self._marks if mark.kind == FAULT][:_MOST_FAULTS]
        begin = np.array([mark.time for mark in shown])
        end = np.array([self._span if mark.end is None else mark.end for mark in shown])
        rows = np.arange(len(shown), dtype=float)
        return Plot(
            "faults",
            (Spans("active", begin, end, rows, color="fault"),),
            wording.of_faults(self._marks),
            Axis(categories=tuple(f"{mark.text:.24}" for mark in shown)),
            height=30 + 24 * len(shown),
        )

    def _plot(
        self, name: str, values: Distribution, envelope: Envelope, scale: tuple[float, str],
        layer: Layer,
    ) -> Plot:  # fmt: skip
        alt = wording.over_time(
            f"{name[:1].upper()}{name[1:]}", values, envelope, scale, self._span, self._marks
        )
        return Plot(name, (layer,), alt, Axis(unit=scale[1], log=_asks_for_log(layer)))

    def _bars(
        self, name: str, unit: str, edges: np.ndarray, heights: np.ndarray, color: int
    ) -> Plot:
        values = Distribution()
        values.add(heights)
        envelope = Envelope(self._span)
        envelope.add(0.5 * (edges[:-1] + edges[1:]), heights)
        alt = wording.over_time(
            f"{name[:1].upper()}{name[1:]}", values, envelope, (1.0, unit), self._span, self._marks
        )
        return Plot(
            name, (Bars(name, edges, heights, color=color),), alt, Axis(unit=unit), height=140
        )


def closer(waveform: Waveform, name: str) -> TimeColumn:
    """Return consecutive samples of the three bodies and of the forces as a named column."""
    found = waveform.closer
    begin = float(found["times"][0])
    times = 1e3 * (found["times"] - begin)
    steps = np.diff(times)
    gaps = np.flatnonzero(steps > 1.5 * np.median(steps)) + 1 if len(steps) else np.arange(0)

    def line(title: str, column: str, factor: float, color: int | str) -> Line:
        values = factor * found[column]
        x = np.insert(times, gaps, np.nan)  # no line across a gap
        return Line(title, x, np.insert(values, gaps, np.nan), color=color)

    bodies: tuple[tuple[str, str, int | str], ...] = (
        ("actuator tip", "actuator_position", 0),
        ("free mass", "free_mass_position", 1),
        ("drill tool", "drill_tool_displacement", "text"),
    )
    length, length_unit = _prefix("m", *(found[body] for _, body, _ in bodies))
    pictures = [("positions, the rock is below", bodies, length, length_unit)]
    for title, column in (("contact force", "contact_force"), ("reacting force", "reacting_force")):
        pictures.append((title, ((title, column, 0),), *_prefix("N", found[column])))
    plots = []
    for title, columns, factor, unit in pictures:
        lines = tuple(line(text, column, factor, color) for text, column, color in columns)
        alt = wording.of_lines(lines, unit)
        flipped = columns is bodies
        height = 260 if flipped else 170
        plots.append(Plot(title, lines, alt, Axis(unit=unit, flipped=flipped), height=height))
    label = f"time after {begin:.6g} s"
    end = float(times[-1]) if len(times) > 1 else 1.0
    return TimeColumn(tuple(plots), 0.0, end, (), name, label, "ms")


def _asks_for_log(layer: Layer) -> bool:
    """Whether the values or means that are drawn span decades; then all have to be positive."""
    if not isinstance(layer, Line | EnvelopeLayer):
        return False
    values = layer.y[np.isfinite(layer.y)]
    low = layer.low[np.isfinite(layer.low)] if isinstance(layer, EnvelopeLayer) else values
    return bool(len(values) and low.min() > 0.0 and values.max() > _DECADES * values.min())


def _peaks(item: Series, scale: tuple[float, str]) -> Layer:
    """Return single peaks if they are few, and otherwise their envelope."""
    steps = exact_steps(item.changing, item.envelope, scale[0])
    if steps is not None and item.values.count < len(steps[0]):
        return Stems("peak", *steps)
    return _envelope("mean (least … greatest)", item.envelope, scale[0])


def _envelope(name: str, envelope: Envelope, factor: float) -> EnvelopeLayer:
    times, values = envelope.steps()
    low, mean, high = (factor * values).astype(np.float32)
    return EnvelopeLayer(name, times.astype(np.float32), low, mean, high)


def _scale(unit: str, values: Distribution) -> tuple[float, str]:
    return readable_unit(unit, max(abs(values.least), abs(values.greatest)))


def _prefix(unit: str, *columns: np.ndarray) -> tuple[float, str]:
    sizes = np.abs(np.concatenate(columns))
    sizes = sizes[np.isfinite(sizes)]
    return readable_unit(unit, float(sizes.max()) if len(sizes) else 0.0)


def _coarser(envelope: Envelope, span: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return edges of longer parts of the time [s], and counts and totals per second in each."""
    step = max(1, round(span / envelope.width / _PARTS))
    starts = np.arange(0, len(envelope.count), step)
    width = step * envelope.width
    counts = np.add.reduceat(envelope.count, starts) / width
    totals = np.add.reduceat(envelope.total, starts) / width
    whole = max(1, int(span / width + 1e-9))  # an incomplete last part would look like a drop
    counts, totals = counts[:whole], totals[:whole]
    return np.arange(len(counts) + 1) * width, counts, totals
