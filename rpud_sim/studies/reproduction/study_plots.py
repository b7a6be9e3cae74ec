"""Plots of studies: figures 15-18 and 23 with intervals, the readings, and the elastic bar."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation import preset
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.studies.reproduction.bar_study import BarStudy
from rpud_sim.studies.reproduction.elastic_bar import impedance
from rpud_sim.studies.reproduction.paper_numbers import NUMBERS
from rpud_sim.studies.reproduction.parameter_studies import OUTPUTS, Study
from rpud_sim.studies.reproduction.readings import Fit
from rpud_sim.studies.reproduction.run_plots import new_figure
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact

STUDY_FIGURES = {
    "actuator_restitution": "figure_15",
    "free_mass": "figure_16",
    "rpud_damping_ratio": "figure_17",
    "weight_on_bit": "figure_18",
}
_COLORS = ("tab:blue", "tab:orange")  # of the presets and of the best reading


def plot_studies(studies: dict[str, list[Study]]) -> dict[str, Figure]:
    """Return figures 15-18 and 23 by name.

    Args:
        studies: the four studies about each drill, by the drill's name.
    """
    figures = {}
    for parameter, name in STUDY_FIGURES.items():
        figure, axes = new_figure(columns=2, rows=2)
        for axis, output in zip(axes.flat, OUTPUTS, strict=True):
            axis.set(xlabel=_label(parameter), title=f"{output} [{FIGURES[output]}]")
            # Each drill has its own scale, since only the trends are compared.
            sides = (axis, axis.twinx())
            for side, color, (drill, group) in zip(sides, _COLORS, studies.items(), strict=True):
                _draw(side, _find(group, parameter), output, drill, color)
                side.set_ylim(0.0, 1.2 * _find(group, parameter).mean(output).max())
                side.set_ylabel(drill, color=color)
                side.tick_params(axis="y", labelcolor=color)
        figures[name] = figure
    figure, axes = new_figure()
    for color, (drill, group) in zip(_COLORS, studies.items(), strict=True):
        _draw(axes[0, 0], _find(group, "weight_on_bit"), "reacting_force_mean", drill, color)
    weights = _find(next(iter(studies.values())), "weight_on_bit").values
    axes[0, 0].plot(weights, weights, ":", color="gray", label="reacting force = weight on bit")
    axes[0, 0].set(xlabel=_label("weight_on_bit"), ylabel="reacting_force_mean [N]")
    axes[0, 0].legend(fontsize="small")
    figures["figure_23"] = figure
    return figures


def _find(studies: list[Study], parameter: str) -> Study:
    return next(study for study in studies if study.parameter == parameter)


def _label(parameter: str) -> str:
    unit = QUANTITIES[parameter].unit
    return f"{parameter} [{unit}]" if unit else parameter


def _draw(axis: Axes, study: Study, output: str, label: str, color: str) -> None:
    axis.errorbar(
        study.values,
        study.mean(output),
        study.half_interval(output),
        marker="o",
        markersize=3,
        linewidth=1,
        capsize=2,
        label=label,
        color=color,
    )


def plot_readings(fits: dict[str, Fit]) -> Figure:
    """Return a figure with the ratio of model to paper for every number, under named readings."""
    figure, axes = new_figure()
    figure.set_size_inches(9.0, 5.5)
    axis = axes[0, 0]
    places = np.arange(len(NUMBERS))[::-1]
    axis.axvspan(0.9, 1.1, color="tab:green", alpha=0.2, label="within 10 %")
    axis.axvline(1.0, color="black", linewidth=0.8)
    for shift, (name, fit) in enumerate(fits.items()):
        values = [fit.values[number.key] for number in NUMBERS]
        paper = np.array([number.paper for number in NUMBERS])
        mean = np.array([value.mean for value in values]) / paper
        spread = np.array([[value.mean - value.low, value.high - value.mean] for value in values])
        axis.errorbar(
            mean,
            places - 0.18 * (shift - 0.5 * (len(fits) - 1)),
            xerr=np.maximum(spread.T / paper, 0.0),
            fmt="o",
            markersize=4,
            capsize=2,
            label=name,
        )
    axis.set_yticks(places, [number.key for number in NUMBERS])
    axis.set(xscale="log", xlabel="model / paper; bars: 95 % of single runs")
    axis.set_xlim(0.02, 40.0)
    axis.legend(fontsize="small", loc="upper left", bbox_to_anchor=(0.0, -0.12))
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
