"""Pictures of a report. Names from a bag are drawn as text, never as formulas."""

from __future__ import annotations

import base64
import warnings
from collections.abc import Callable, Mapping, Sequence

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from rpud_sim.foundation.terminal import printable
from rpud_sim.inspection.report.drill_topics import CHANNELS, Fault, Impacts, Waveform
from rpud_sim.inspection.report.running_statistics import Distribution, Envelope, Intervals
from rpud_sim.inspection.report.topic_survey import Series, TopicSurvey
from rpud_sim.pages.frame import to_png

_WIDTH = 10.0  # inches
_RESOLUTION = 100  # dots per inch
_CLASSES = 80
_NAME = 40  # characters

# Okabe and Ito's colours: distinct with every kind of colour vision.
LINE, BAND, MARK, OTHER = "#0072B2", "#9ECBE8", "#D55E00", "#009E73"


def encode(draw: Callable[..., Figure], *arguments: object) -> str:
    """Return a drawn picture as base64 of a PNG file.

    Args:
        draw: one of the functions below.
        arguments: of that function.
    """
    # Names and units come from any program: `$` begins no formula, and no font has all letters.
    with matplotlib.rc_context({"text.parse_math": False}), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with np.errstate(all="ignore"):
            png = to_png(draw(*arguments), _RESOLUTION)
    return base64.b64encode(png).decode("ascii")


def series(shown: Sequence[Series], span: float) -> Figure:
    """Draw columns over time: the mean, and the band from least to greatest value."""
    figure, axes = _panels(len(shown), 1.35)
    for axis, item in zip(axes, shown, strict=True):
        _draw_envelope(axis, item.envelope)
        unit = f"\n[{item.column.unit}]" if item.column.unit else ""
        name = item.column.name.replace("_", " ")
        name = printable(f"{name:.{_NAME}}")
        axis.set_ylabel(f"{name}{unit}", fontsize="small", rotation=0, ha="right")
    _share_time(axes, span)
    return figure


def closer(waveform: Waveform) -> Figure:
    """Draw consecutive samples of the three bodies and of the reacting force."""
    figure, (positions, force) = _panels(2, 2.4)
    found = waveform.closer
    times = 1e3 * (found["times"] - found["times"][0])
    steps = np.diff(times, prepend=times[0])
    times = np.where(steps > 1.5 * np.median(steps), np.nan, times)  # no line across a gap
    for name, colour, label in (
        ("actuator_position", LINE, "actuator tip"),
        ("free_mass_position", MARK, "free mass"),
        ("drill_tool_displacement", "black", "drill tool"),
    ):
        positions.plot(times, 1e3 * found[name], color=colour, linewidth=1.2, label=label)
    positions.invert_yaxis()  # the rock is below
    positions.set_ylabel("position [mm], rock below")
    positions.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, frameon=False)
    force.plot(times, found["reacting_force"], color=LINE, linewidth=1.2)
    force.set_ylabel("reacting force [N]")
    force.set_xlabel(f"time after {found['times'][0]:.3f} s [ms]")
    for axis in (positions, force):
        axis.margins(x=0.0)
    return figure


def distributions(impacts: Impacts, topic: TopicSurvey) -> Figure:
    """Draw the distributions of force, velocity, energy and interval of the impacts."""
    figure = Figure(figsize=(_WIDTH, 5.2), layout="constrained")
    panels = figure.subplots(2, 2).ravel()
    for axis, values, scale, label in (
        (panels[0], topic.find("peak_force"), 1e-3, "peak contact force [kN]"),
        (panels[1], topic.find("impact_velocity"), 1.0, "impact velocity [m/s]"),
        (panels[2], topic.find("energy"), 1e3, "energy of the arriving free mass [mJ]"),
        (panels[3], impacts.intervals, 1e3, "interval between impacts [ms]"),
    ):
        _draw_distribution(axis, values, scale)
        axis.set_xlabel(label)
        axis.set_ylabel("impacts")
    return figure


def impacts_over_time(impacts: Impacts, topic: TopicSurvey, span: float) -> Figure:
    """Draw peak forces, the rate of impacts, and their power."""
    figure, (force, rate, power) = _panels(3, 1.8)
    peaks = next(item for item in topic.series if item.column.name == "peak_force").envelope
    used = np.flatnonzero(peaks.count)
    force.vlines(peaks.times[used], 0.0, peaks.greatest[used] / 1e3, color=LINE, linewidth=0.8)
    force.set_ylim(bottom=0.0)
    force.set_ylabel("greatest peak\nforce [kN]")
    coarse = _coarser(impacts.power, span)
    rate.stairs(coarse[1], coarse[0], color=LINE, fill=True)
    rate.set_ylabel("impacts\n[1/s]")
    power.stairs(coarse[2], coarse[0], color=OTHER, fill=True)
    power.set_ylabel("power of\nimpacts [W]")
    _share_time((force, rate, power), span)
    return figure


def spectra(waveform: Waveform, densities: tuple[np.ndarray, np.ndarray]) -> Figure:
    """Draw power spectral densities of the waveform's channels."""
    figure = Figure(figsize=(_WIDTH, 7.0), layout="constrained")
    frequencies, found = densities
    for axis, name, density in zip(
        figure.subplots(3, 2, sharex=True).ravel(), CHANNELS, found, strict=True
    ):
        shown = (frequencies > 0.0) & (density > 0.0)
        axis.loglog(frequencies[shown], density[shown], color=LINE, linewidth=0.8)
        unit = "N²/Hz" if name.endswith("force") else "m²/Hz"
        axis.set_title(name.replace("_", " "), loc="left", fontsize="medium")
        axis.set_ylabel(unit)
        _plain_labels(axis.xaxis, axis.yaxis)
        _decorate(axis)
    for axis in figure.axes[-2:]:
        axis.set_xlabel("frequency [Hz]")
    return figure


def delays(topics: Sequence[TopicSurvey], span: float) -> Figure:
    """Draw the time from the stamps of messages to their log times."""
    figure, axes = _panels(len(topics), 1.35)
    for axis, topic in zip(axes, topics, strict=True):
        _draw_envelope(axis, topic.timing.delays, 1e3)
        name = printable(topic.name[-_NAME:])
        axis.set_ylabel(f"{name}\n[ms]", fontsize="small", rotation=0, ha="right")
    _share_time(axes, span)
    return figure


def faults(log: Mapping[tuple[int, int], Fault], span: float) -> Figure:
    """Draw the intervals in which faults were active."""
    shown = sorted(log.values(), key=lambda fault: fault.onset)[:60]
    figure = Figure(figsize=(_WIDTH, 0.9 + 0.32 * len(shown)), layout="constrained")
    axis = figure.subplots()
    for row, fault in enumerate(shown):
        end = span if fault.clear is None else fault.clear
        colour = LINE if fault.channel else MARK
        axis.barh(row, max(end - fault.onset, span / 500), left=fault.onset, color=colour)
    names = [
        printable(f"{f.number}: {f.kind:.{_NAME}} {f.channel:.{_NAME}}".strip()) for f in shown
    ]
    axis.set_yticks(range(len(shown)), names, fontsize="small")
    axis.invert_yaxis()
    _decorate(axis)
    axis.set_xlim(0.0, max(span, 1e-3))
    axis.set_xlabel("time since the bag began [s]")
    return figure


def _panels(count: int, height: float) -> tuple[Figure, list[Axes]]:
    figure = Figure(figsize=(_WIDTH, height * count + 0.4), layout="constrained")
    axes = list(figure.subplots(count, 1, squeeze=False).ravel())
    for axis in axes:
        _decorate(axis)
    return figure, axes


def _decorate(axis: Axes) -> None:
    axis.grid(alpha=0.3)
    axis.spines[["top", "right"]].set_visible(False)


def _plain_labels(*scales: Axis) -> None:
    for scale in scales:  # Matplotlib labels logarithmic axes with formulas
        scale.set_major_formatter(lambda value, _: f"{value:g}")
        scale.set_minor_formatter(NullFormatter())


def _share_time(axes: Sequence[Axes], span: float) -> None:
    for axis in axes:
        axis.set_xlim(0.0, max(span, 1e-3))
    for axis in axes[:-1]:
        axis.tick_params(labelbottom=False)
    axes[-1].set_xlabel("time since the bag began [s]")


def _draw_envelope(axis: Axes, envelope: Envelope, scale: float = 1.0) -> None:
    times, values = envelope.steps()
    least, mean, greatest = scale * values
    axis.fill_between(times, least, greatest, step="post", color=BAND, linewidth=0)
    axis.plot(times, mean, color=LINE, linewidth=0.9, drawstyle="steps-post")


def _draw_distribution(axis: Axes, values: Distribution, scale: float) -> None:
    counts, edges = values.classes(_CLASSES)
    axis.stairs(counts, scale * edges, color=LINE, fill=True)
    if isinstance(values, Intervals):
        axis.set_xscale("log")
        _plain_labels(axis.xaxis)
    if values.count:
        axis.axvline(scale * values.mean, color=MARK, linewidth=1.2, label="mean")
        axis.legend(frameon=False)
    _decorate(axis)


def _coarser(envelope: Envelope, span: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return edges of longer parts of the time [s], and counts and totals per second in each."""
    step = max(1, round(span / envelope.width / 100))
    starts = np.arange(0, len(envelope.count), step)
    width = step * envelope.width
    counts = np.add.reduceat(envelope.count, starts) / width
    totals = np.add.reduceat(envelope.total, starts) / width
    whole = max(1, int(span / width + 1e-9))  # an incomplete last part would look like a drop
    counts, totals = counts[:whole], totals[:whole]
    return np.arange(len(counts) + 1) * width, counts, totals
