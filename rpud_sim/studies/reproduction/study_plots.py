"""Plots of studies: figures 15-18 and 23, the readings, their search, and the elastic bar."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpud_sim.simulation import preset
from rpud_sim.studies.reproduction.bar_study import BarStudy
from rpud_sim.studies.reproduction.elastic_bar import impedance
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS
from rpud_sim.studies.reproduction.parameter_studies import OUTPUTS, Study
from rpud_sim.studies.reproduction.run_plots import DRILL_COLORS, PAPER_COLOR, new_figure
from rpud_sim.studies.reproduction.scores import CLOSE, NEAR, Fit
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import FORCE_RANGE, SHORT

STUDY_FIGURES = {
    "actuator_restitution": "figure_15",
    "free_mass": "figure_16",
    "rpud_damping_ratio": "figure_17",
    "weight_on_bit": "figure_18",
}
_PANELS = (
    "(a) average contact force [N]",
    "(b) collisions per second [1/s]",
    "(c) kinetic energy that arrives per second [W]",
    "(d) average reacting force [N]",
)
# The axes of Figs. 15 to 18: label, factor from SI units, and the tables' value, where the paper's
# numbers lie; Table 2 has no weight on bit.
_AXES = {
    "actuator_restitution": ("coefficient of restitution e_1", 1.0, 1.0),
    "free_mass": ("free mass [g]", 1e3, 5.0),
    "rpud_damping_ratio": ("damping ratio of the RPUD", 1.0, 0.5),
    "weight_on_bit": ("weight on bit [N]", 1.0, None),
}
_PAPER = {number.key: number.paper for number in NUMBERS}
_PAPER_OUTPUTS = {
    "drill_tool_impact_rate": _PAPER["drilling_impact_rate"],
    "kinetic_energy_rate": _PAPER["drilling_kinetic_energy"] / SHORT,
    "reacting_force_mean": _PAPER["drilling_reacting_force_mean"],
}


def plot_studies(studies: dict[str, list[Study]]) -> dict[str, Figure]:
    """Return figures 15-18 and 23 by name.

    Args:
        studies: the four studies about each drill, by the drill's name.
    """
    figures = {}
    for parameter, name in STUDY_FIGURES.items():
        label, scale, at = _AXES[parameter]
        figure, axes = new_figure(columns=2, rows=2)
        for axis, output, title in zip(axes.flat, OUTPUTS, _PANELS, strict=True):
            for color, (drill, group) in zip(DRILL_COLORS, studies.items(), strict=True):
                _draw(axis, _find(group, parameter), output, drill, color, scale)
            _draw_paper(axis, output, at)
            axis.set(xlabel=f"{label} (range assumed)", title=title)
            axis.set_ylim(bottom=0.0)
            axis.legend(fontsize="x-small")
        figures[name] = figure
    figure, axes = new_figure()
    for color, (drill, group) in zip(DRILL_COLORS, studies.items(), strict=True):
        _draw(axes[0, 0], _find(group, "weight_on_bit"), "reacting_force_mean", drill, color, 1.0)
    weights = _find(next(iter(studies.values())), "weight_on_bit").values
    axes[0, 0].plot(weights, weights, ":", color="gray", label="reacting force = weight on bit")
    axes[0, 0].set(xlabel="weight on bit [N] (range assumed)", ylabel="average reacting force [N]")
    axes[0, 0].legend(fontsize="small")
    figures["figure_23"] = figure
    return figures


def _find(studies: list[Study], parameter: str) -> Study:
    return next(study for study in studies if study.parameter == parameter)


def _draw(axis: Axes, study: Study, output: str, label: str, color: str, scale: float) -> None:
    axis.errorbar(
        scale * study.values,
        study.mean(output),
        study.half_interval(output),
        marker="o",
        markersize=3,
        linewidth=1,
        capsize=2,
        label=label,
        color=color,
    )


def _draw_paper(axis: Axes, output: str, at: float | None) -> None:
    """Draw the paper's number at its table's value, or as a range or line where it has none."""
    if output == "contact_force_mean":
        axis.axhspan(*FORCE_RANGE, color=PAPER_COLOR, alpha=0.12, label="paper: most, Fig. 11")
        return
    number = _PAPER_OUTPUTS[output]
    label = f"paper: {number:.3g}"
    if at is None:
        axis.axhline(number, color=PAPER_COLOR, linestyle=":", label=label)
    else:
        axis.plot([at], [number], "x", color=PAPER_COLOR, markersize=7, label=label)


def plot_readings(fits: Sequence[Fit]) -> Figure:
    """Return a figure with the ratio of model to paper for every number, under some readings."""
    figure, axes = new_figure()
    figure.set_size_inches(9.0, 6.5)
    axis = axes[0, 0]
    places = np.arange(len(NUMBERS))[::-1]
    axis.axvspan(1.0 - CLOSE, 1.0 + CLOSE, color="tab:olive", alpha=0.2, label="within 15 %")
    axis.axvspan(1.0 - NEAR, 1.0 + NEAR, color="tab:green", alpha=0.3, label="within 10 %")
    axis.axvline(1.0, color="black", linewidth=0.8)
    for shift, fit in enumerate(fits):
        values = [fit.values[number.key] for number in NUMBERS]
        paper = np.array([number.paper for number in NUMBERS])
        mean = np.array([value.mean for value in values]) / paper
        spread = np.array([[value.mean - value.low, value.high - value.mean] for value in values])
        axis.errorbar(
            mean,
            places - 0.13 * (shift - 0.5 * (len(fits) - 1)),
            xerr=np.maximum(spread.T / paper, 0.0),
            fmt="o",
            markersize=3,
            capsize=1,
            linewidth=0.8,
            label=fit.reading.name,
        )
    axis.set_yticks(places, [number.label for number in NUMBERS])
    axis.set(xscale="log", xlabel="model / paper; bars: 95 % of single runs")
    axis.set_xlim(0.1, 30.0)
    axis.legend(fontsize="small", loc="upper left", bbox_to_anchor=(0.0, -0.1), ncols=2)
    return figure


def plot_search(ridges: dict[str, tuple[np.ndarray, np.ndarray]]) -> Figure:
    """Return a figure with the search's misfit over amplitude and restitution, for each tool."""
    figure, axes = new_figure(columns=4, rows=2)
    figure.set_size_inches(12.0, 6.0)
    for axis, (tool, (points, misfits)) in zip(axes.flat, ridges.items(), strict=True):
        order = np.argsort(-misfits)
        drawn = axis.scatter(
            1e6 * points[order, 0], points[order, 2], c=np.minimum(misfits[order], 1.0), s=30,
            cmap="viridis_r", vmin=0.0, vmax=1.0,
        )  # fmt: skip
        axis.set_title(f"{tool}: least {misfits.min():.2f}", fontsize=9)
        axis.set(xlabel="A [µm]", ylabel="e_1")
    figure.colorbar(drawn, ax=list(axes.flat), label="misfit in the rock (1 and more: dark)")
    return figure


def plot_bar_study(study: BarStudy) -> dict[str, Figure]:
    """Return the elastic bar's figures by name: one blow over time, and all blows."""
    return {"bar_contact": _bar_contact(study), "bar_trends": _bar_trends(study)}


def _bar_contact(study: BarStudy) -> Figure:
    figure, axes = new_figure(columns=2)
    drill = preset("drilling")
    blow = next(item for item in study.by_mass if item.free_mass == drill.free_mass)
    shown = blow.bar.time <= 1.2 * blow.bar.duration
    axes[0, 0].plot(1e6 * blow.bar.time[shown], 1e6 * blow.bar.displacement[shown], label="bar")
    axes[0, 1].plot(1e6 * blow.bar.time[shown], blow.bar.force[shown], label="bar")
    for model in blow.contacts:
        chosen = drill.replace(contact_model=model)
        contact = single_contact(chosen, blow.impact_velocity)
        time = np.linspace(0.0, contact.duration, 200)
        histories = contact_history(chosen, blow.impact_velocity, time)
        axes[0, 0].plot(1e6 * time, 1e6 * histories[0], label=model)
        axes[0, 1].plot(1e6 * time, histories[1], label=model)
    axes[0, 0].set(xlabel="time [µs]", ylabel="displacement of the upper end [µm]")
    axes[0, 1].set(xlabel="time [µs]", ylabel="contact force [N]", yscale="symlog")
    for axis in axes.flat:
        axis.legend()
    return figure


def _bar_trends(study: BarStudy) -> Figure:
    figure, axes = new_figure(columns=3, rows=2)
    figure.set_size_inches(12.0, 6.4)
    for row, group, key, scale, label in (
        (axes[0], study.by_mass, "free_mass", 1e3, "free mass [g], 5 m/s"),
        (axes[1], study.by_speed, "impact_velocity", 1.0, "impact velocity [m/s], 5 g"),
    ):
        at = [scale * getattr(item, key) for item in group]
        for axis, name, unit, factor in zip(
            row,
            ("peak_force", "duration", "restitution"),
            ("[N]", "[µs]", ""),
            (1.0, 1e6, 1.0),
            strict=True,
        ):
            axis.plot(at, [factor * getattr(item.bar, name) for item in group], "ko-", label="bar")
            for model in group[0].contacts:
                values = [factor * getattr(item.contacts[model], name) for item in group]
                axis.plot(at, values, "s--", label=model)
            axis.set(xlabel=label, ylabel=f"{name} {unit}".rstrip(), xscale="log")
            if name == "peak_force":
                first = [impedance(preset("drilling")) * item.impact_velocity for item in group]
                axis.plot(at, first, ":", color="gray", label="bar's first wave")
                axis.set_yscale("log")
    axes[0, 0].legend(fontsize="small")
    return figure
