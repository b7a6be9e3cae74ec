"""Plots of studies: figures 15-18 and 23, the readings, their search, and the elastic bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from rpud_sim.pages.plot import Axis, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.bar_study import BarStudy
from rpud_sim.studies.reproduction.elastic_bar import impedance
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS
from rpud_sim.studies.reproduction.parameter_studies import OUTPUTS, Study
from rpud_sim.studies.reproduction.run_plots import DRILL_COLORS, PAPER_COLOR
from rpud_sim.studies.reproduction.scores import CLOSE, NEAR, Fit
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import FORCE_RANGE, SHORT

STUDY_FIGURES = {
    "actuator_restitution": "figure_15",
    "free_mass": "figure_16",
    "rpud_damping_ratio": "figure_17",
    "weight_on_bit": "figure_18",
}
_TITLES = (
    ("(a) average contact force", "N"),
    ("(b) collisions per second", "1/s"),
    ("(c) kinetic energy that arrives per second", "W"),
    ("(d) average reacting force", "N"),
)
# The axes of Figs. 15 to 18: label, unit, factor from SI units, and the tables' value, where the
# paper's numbers lie; Table 2 has no weight on bit. The paper gives no ranges.
_AXES = {
    "actuator_restitution": ("coefficient of restitution e_1 (range assumed)", "", 1.0, 1.0),
    "free_mass": ("free mass (range assumed)", "g", 1e3, 5.0),
    "rpud_damping_ratio": ("damping ratio of the RPUD (range assumed)", "", 1.0, 0.5),
    "weight_on_bit": ("weight on bit (range assumed)", "N", 1.0, None),
}
_PAPER = {number.key: number.paper for number in NUMBERS}
_PAPER_OUTPUTS = {
    "drill_tool_impact_rate": _PAPER["drilling_impact_rate"],
    "kinetic_energy_rate": _PAPER["drilling_kinetic_energy"] / SHORT,
    "reacting_force_mean": _PAPER["drilling_reacting_force_mean"],
}


def study_plots(studies: dict[str, list[Study]]) -> dict[str, tuple[Plot, ...]]:
    """Return figures 15-18 and 23 by name.

    Args:
        studies: the four studies about each drill, by the drill's name.
    """
    figures = {}
    for parameter, name in STUDY_FIGURES.items():
        label, unit, scale, at = _AXES[parameter]
        plots = []
        for output, (title, output_unit) in zip(OUTPUTS, _TITLES, strict=True):
            means = [
                _means(_find(group, parameter), output, drill, color, scale)
                for color, (drill, group) in zip(DRILL_COLORS, studies.items(), strict=True)
            ]
            axes = Axis(unit=output_unit, low=0.0), Axis(label, unit)
            plots.append(Plot(title, (_paper(output, at), *means), "", *axes, 240))
        figures[name] = tuple(plots)
    slopes = [
        _means(_find(group, "weight_on_bit"), "reacting_force_mean", drill, color, 1.0)
        for color, (drill, group) in zip(DRILL_COLORS, studies.items(), strict=True)
    ]
    weights = _find(next(iter(studies.values())), "weight_on_bit").values
    equal = Line("reacting force = weight on bit", weights, weights, color="muted", dash="dotted")
    axes = Axis(unit="N"), Axis(*_AXES["weight_on_bit"][:2])
    figures["figure_23"] = (Plot("average reacting force", (equal, *slopes), "", *axes, 280),)
    return figures


def _find(studies: list[Study], parameter: str) -> Study:
    return next(study for study in studies if study.parameter == parameter)


def _means(study: Study, output: str, label: str, color: int, scale: float) -> Points:
    mean, half = study.mean(output), study.half_interval(output)
    at = scale * study.values
    return Points(label, at, mean, mean - half, mean + half, color=color, joined=True)


def _paper(output: str, at: float | None) -> Layer:
    """Return the paper's number at its table's value, or as a range or line where it has none."""
    if output == "contact_force_mean":
        return Zone("paper: most, Fig. 11", *FORCE_RANGE, color=PAPER_COLOR)
    number = _PAPER_OUTPUTS[output]
    label = f"paper: {number:.3g}"
    if at is None:
        return Rule(label, number, color=PAPER_COLOR, dash="dotted")
    place = np.array([at]), np.array([number])
    return Points(label, *place, marker="x", size=11, color=PAPER_COLOR)


def readings_plots(fits: Sequence[Fit]) -> tuple[Plot, ...]:
    """Return the ratio of model to paper for every number, under some readings."""
    places = np.arange(len(NUMBERS))  # from the top
    paper = np.array([number.paper for number in NUMBERS])
    layers: list[Layer] = [
        Zone("within 15 %", 1.0 - CLOSE, 1.0 + CLOSE, False, "gap"),
        Zone("within 10 %", 1.0 - NEAR, 1.0 + NEAR, False, "muted"),
        Rule("the paper's number", 1.0, False, dash="solid"),
    ]
    for color, fit in enumerate(fits):
        values = [fit.values[number.key] for number in NUMBERS]
        mean = np.array([value.mean for value in values]) / paper
        # The mean of an ensemble may lie outside of what most of its runs show.
        low = np.minimum([value.low for value in values] / paper, mean)
        high = np.maximum([value.high for value in values] / paper, mean)
        shifted = places + 0.13 * (color - 0.5 * (len(fits) - 1))
        layers.append(Points(fit.reading.name, mean, shifted, low, high, True, color=color))
    return (
        Plot(
            "numbers of the paper",
            tuple(layers),
            "",
            Axis(categories=tuple(number.label for number in NUMBERS)),
            Axis("model / paper; bars: 95 % of single runs", log=True, low=0.1, high=30.0),
            560,
        ),
    )


def search_plots(ridges: dict[str, tuple[np.ndarray, np.ndarray]]) -> tuple[Plot, ...]:
    """Return the search's misfit over amplitude and restitution, for each tool."""
    plots = []
    for tool, (points, misfits) in ridges.items():
        order = np.argsort(-misfits)
        drawn = Points(
            "points of the design",
            1e6 * points[order, 0],
            points[order, 2],
            values=np.minimum(misfits[order], 1.0),
            values_label="misfit in the rock",
            values_ends=(0.0, 1.0),
            size=8,
        )
        title = f"e_1: {tool}, least {misfits.min():.2f}"
        plots.append(Plot(title, (drawn,), x=Axis("A", "µm"), height=220))
    return tuple(plots)


def bar_plots(study: BarStudy) -> dict[str, tuple[Plot, ...]]:
    """Return the elastic bar's figures by name: one blow over time, and all blows."""
    return {"bar_contact": _bar_contact(study), "bar_trends": _bar_trends(study)}


def _bar_contact(study: BarStudy) -> tuple[Plot, ...]:
    drill = preset("drilling")
    blow = next(item for item in study.by_mass if item.free_mass == drill.free_mass)
    shown = blow.bar.time <= 1.2 * blow.bar.duration
    time = 1e6 * blow.bar.time[shown]
    displacements = [Line("bar", time, 1e6 * blow.bar.displacement[shown], color="text")]
    forces = [Line("bar", time, blow.bar.force[shown], color="text")]
    for color, model in enumerate(blow.contacts):
        chosen = drill.replace(contact_model=model)
        contact = single_contact(chosen, blow.impact_velocity)
        time = np.linspace(0.0, contact.duration, 200)
        histories = contact_history(chosen, blow.impact_velocity, time)
        displacements.append(Line(model, 1e6 * time, 1e6 * histories[0], color=color))
        forces.append(Line(model, 1e6 * time, histories[1], color=color))
    across = Axis("time", "µs")
    title = "displacement of the upper end"
    return (
        Plot(title, tuple(displacements), y=Axis(unit="µm"), x=across, height=240),
        Plot(
            "contact force",
            tuple(forces),
            y=Axis(unit="N", log=True, low=10.0),
            x=across,
            height=240,
        ),
    )


def _bar_trends(study: BarStudy) -> tuple[Plot, ...]:
    plots = []
    for group, key, scale, label, unit in (
        (study.by_mass, "free_mass", 1e3, "free mass at 5 m/s", "g"),
        (study.by_speed, "impact_velocity", 1.0, "impact velocity of 5 g", "m/s"),
    ):
        at = np.array([scale * getattr(item, key) for item in group])
        for name, title, factor, output_unit in (
            ("peak_force", "peak force", 1.0, "N"),
            ("duration", "duration", 1e6, "µs"),
            ("restitution", "restitution", 1.0, ""),
        ):
            bar = np.array([factor * getattr(item.bar, name) for item in group])
            layers: list[Layer] = [Points("bar", at, bar, color="text", joined=True)]
            for color, model in enumerate(group[0].contacts):
                values = np.array([factor * getattr(item.contacts[model], name) for item in group])
                layers.append(Points(model, at, values, marker="square", color=color, joined=True))
            if name == "peak_force":
                wave = impedance(preset("drilling"))
                first = np.array([wave * item.impact_velocity for item in group])
                layers.append(Line("bar's first wave", at, first, color="muted", dash="dotted"))
            up = Axis(unit=output_unit, log=name == "peak_force")
            across = Axis(label, unit, log=True)
            plots.append(Plot(title, tuple(layers), y=up, x=across, height=220))
    return tuple(plots)
