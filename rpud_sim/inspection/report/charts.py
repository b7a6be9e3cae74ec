"""Plots of a report that are not over time: distributions, spectra and the flow of power."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from markupsafe import Markup

from rpud_sim.inspection.report import wording
from rpud_sim.inspection.report.drill_topics import CHANNELS, Impacts
from rpud_sim.inspection.report.power_flow import flows
from rpud_sim.inspection.report.running_statistics import Intervals
from rpud_sim.inspection.report.topic_survey import TopicSurvey
from rpud_sim.pages.extent import readable_unit
from rpud_sim.pages.flow import flow_picture
from rpud_sim.pages.plot import Axis, Bars, Line, Plot, Rule

_CLASSES = 80
_POINTS = 1500  # of a spectrum


def distributions(impacts: Impacts, topic: TopicSurvey) -> list[Plot]:
    """Return the distributions of force, velocity, energy and interval of the impacts."""
    plots = []
    for name, values, unit in (
        ("peak contact force", topic.find("peak_force"), "N"),
        ("impact velocity", topic.find("impact_velocity"), "m/s"),
        ("energy of the arriving free mass", topic.find("energy"), "J"),
        ("interval between impacts", impacts.intervals, "s"),
    ):
        # Of intervals, one that is far longer than the others would set the unit.
        greatest = values.mean if isinstance(values, Intervals) else values.greatest
        scale = readable_unit(unit, max(abs(values.least), abs(greatest)))
        counts, edges = values.classes(_CLASSES)
        edges = scale[0] * edges
        mean = scale[0] * values.mean
        plots.append(
            Plot(
                f"distribution of the {name}",
                (
                    Bars("impacts", edges, counts.astype(np.float32)),
                    *((Rule(f"mean {mean:.4g} {scale[1]}", mean, across=False, color=1),)
                      if values.count else ()),
                ),
                wording.of_distribution(f"{name[:1].upper()}{name[1:]}", values, scale),
                Axis(unit="impacts"),
                Axis(name, scale[1], log=isinstance(values, Intervals)),
            )
        )  # fmt: skip
    return plots


def spectra(densities: tuple[np.ndarray, np.ndarray]) -> list[Plot]:
    """Return the waveform's power spectra: frequencies (n,) [Hz], densities (channels, n)."""
    frequencies, found = densities
    plots = []
    for name, density in zip(CHANNELS, found, strict=True):
        shown = (frequencies > 0.0) & (density > 0.0)
        title = name.replace("_", " ")
        alt = wording.of_spectrum(title[:1].upper() + title[1:], frequencies[shown], density[shown])
        plots.append(
            Plot(
                f"{title}: power spectral density",
                (Line("density", *_thinned(frequencies[shown], density[shown]), width=1.0),),
                alt,
                Axis(unit="N²/Hz" if name.endswith("force") else "m²/Hz", log=True),
                Axis("frequency", "Hz", log=True),
            )
        )
    return plots


def power_flow(powers: Mapping[str, float]) -> Markup:
    """Return the picture of the flow of mean powers; see ``flows``."""
    into, out = flows(powers)
    return flow_picture(into, out, "W", wording.of_flow(into, out))


def _thinned(frequencies: np.ndarray, density: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the greatest density in each narrow range of frequencies: peaks stay."""
    if len(frequencies) <= _POINTS:
        return frequencies.astype(np.float32), density
    edges = np.geomspace(frequencies[0], frequencies[-1], _POINTS)
    starts = np.unique(np.searchsorted(frequencies, edges))
    greatest = [
        first + int(np.argmax(density[first:last]))
        for first, last in zip(starts, [*starts[1:], len(density)], strict=True)
    ]
    return frequencies[greatest].astype(np.float32), density[greatest]
