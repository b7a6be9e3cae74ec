"""Plots of single runs: the paper's figures 3-5 and 8-14, with initial phase zero as in eq. (1)."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Parameters
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.sampling import Samples, Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import LONG, SHORT

_COLORS = {"actuator": "tab:blue", "free mass": "tab:orange", "drill tool": "tab:green"}
_ZOOM = 0.3, 0.305  # [s]


def new_figure(columns: int = 1, rows: int = 1) -> tuple[Figure, np.ndarray]:
    """Return a figure and its axes, shape (rows, columns)."""
    figure = Figure(figsize=(8.0 if columns == 1 else 10.0, 3.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    return figure, axes


def run_figures(free: Parameters, drilling: Parameters) -> dict[str, Figure]:
    """Return figures 3-5 and 8-14 by name.

    Args:
        free: the drill before drilling.
        drilling: the drill in the rock.
    """
    before = _run(free)
    during = _run(drilling)
    return {
        "figure_03": _positions(before, 0.0, SHORT, 40_000),
        "figure_04": _positions(before, *_ZOOM, 1_000_000),
        "figure_05": _reacting_force(before),
        "figure_08": _positions(during, 0.0, SHORT, 40_000),
        "figure_09": _positions(during, *_ZOOM, 1_000_000),
        "figure_10": _contact_forces(during),
        "figure_11": _distribution(during),
        "figure_12": _single_contact(drilling),
        "figure_13": _kinetic_energy(during),
        "figure_14": _reacting_force(during),
    }


def _run(parameters: Parameters) -> Block:
    return Simulation(parameters).advance_to(round(LONG * SECOND))


def _sample(block: Block, start: float, end: float, rate: int) -> tuple[np.ndarray, Samples]:
    first, count = round(start * rate), round((end - start) * rate)
    return np.arange(first, first + count) / rate, block.sample(Times.from_grid(first, count, rate))


def _positions(block: Block, start: float, end: float, rate: int) -> Figure:
    figure, axes = new_figure()
    axis: Axes = axes[0, 0]
    time, samples = _sample(block, start, end, rate)
    bodies = {
        "actuator": samples.actuator_position,
        "free mass": samples.free_mass_position,
        "drill tool": samples.drill_tool_displacement,
    }
    for name, position in bodies.items():
        axis.plot(time, 1e3 * position, color=_COLORS[name], linewidth=0.7, label=name)
    axis.set(xlabel="time [s]", ylabel="position [mm], toward the rock")
    axis.legend(loc="best")
    return figure


def _reacting_force(block: Block) -> Figure:
    figure, axes = new_figure()
    time, samples = _sample(block, 0.0, LONG, 10_000)
    mean = samples.reacting_force.mean()
    axes[0, 0].plot(time, samples.reacting_force, linewidth=0.4)
    axes[0, 0].axhline(mean, color="black", linestyle="--", label=f"mean of this run {mean:.1f} N")
    axes[0, 0].set(xlabel="time [s]", ylabel="reacting force [N]")
    axes[0, 0].legend(loc="upper right")
    return figure


def _impacts(block: Block) -> tuple[np.ndarray, np.ndarray]:
    time = block.impacts["seconds"] + block.impacts["fraction"]
    return time[time < SHORT], block.impacts[time < SHORT]


def _contact_forces(block: Block) -> Figure:
    figure, axes = new_figure()
    time, impacts = _impacts(block)
    axes[0, 0].plot(time, impacts["peak_force"], ".", markersize=3, label="model")
    axes[0, 0].axhline(2600.0, color="red", linestyle=":", label="paper: up to 2600 N")
    axes[0, 0].legend()
    axes[0, 0].set(xlabel="time [s]", ylabel="greatest force of the contact [N]", yscale="log")
    return figure


def _distribution(block: Block) -> Figure:
    figure, axes = new_figure()
    _, impacts = _impacts(block)
    axes[0, 0].hist(impacts["peak_force"], bins=np.geomspace(100.0, 1e5, 60))
    axes[0, 0].axvspan(400.0, 2200.0, color="tab:red", alpha=0.15, label="paper: 400 to 2200 N")
    axes[0, 0].set(
        xlabel="greatest force of the contact [N]", ylabel="impacts in 0.6 s", xscale="log"
    )
    axes[0, 0].legend()
    return figure


def _kinetic_energy(block: Block) -> Figure:
    figure, axes = new_figure()
    time, impacts = _impacts(block)
    axes[0, 0].step(time, np.cumsum(impacts["energy"]), where="post", label="model")
    axes[0, 0].plot([0.0, SHORT], [0.0, 12.4], "r--", label="paper: 12.4 J in 0.6 s")
    axes[0, 0].set(xlabel="time [s]", ylabel="kinetic energy to the drill tool [J]")
    axes[0, 0].legend()
    return figure


def _single_contact(drilling: Parameters) -> Figure:
    figure, axes = new_figure(columns=2)
    for model, modulus, style in (
        ("printed", 1.96e11, "-"),
        ("printed", 1.96e9, "--"),
        ("rayleigh", 1.96e11, "-"),
        ("rayleigh", 1.96e9, "--"),
    ):
        drill = drilling.replace(contact_model=model, elastic_modulus=modulus)
        duration = single_contact(drill, CONTACT_SPEED).duration
        time = np.linspace(0.0, duration, 200)
        displacement, force = contact_history(drill, CONTACT_SPEED, time)
        color = "tab:blue" if model == "printed" else "tab:orange"
        label = f"{model}, {modulus:g} Pa"
        for axis, values in zip(axes.flat, (1e6 * displacement, force), strict=True):
            axis.plot(1e6 * time, values, style, color=color, label=label)
    axes[0, 0].axhline(42.0, color="red", linestyle=":", label="paper: 42 µm")
    axes[0, 1].axhline(1650.0, color="red", linestyle=":", label="paper: 1650 N")
    axes[0, 0].set(xlabel="time [µs]", ylabel="displacement [µm]", xscale="log")
    axes[0, 1].set(xlabel="time [µs]", ylabel="contact force [N]", xscale="log")
    axes[0, 1].set_ylim(bottom=0.0)
    for axis in axes.flat:
        axis.legend(fontsize="small")
    return figure
