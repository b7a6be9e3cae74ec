"""Plots of single runs: the paper's figures 3-5 and 8-14, with initial phase zero as in eq. (1).

Each figure shows the presets, the best reading, and the paper's number or range, in the paper's
units. Where the forces of the presets leave the paper's axis, a second panel has all of them.
"""

from __future__ import annotations

import dataclasses

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.sampling import Samples, Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.studies.reproduction.choices import ENERGIES, TOOLS, Reading, energy_share
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED, NUMBERS
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import FORCE_RANGE, LONG, SHORT

DRILL_COLORS = ("tab:blue", "tab:orange")  # of the presets and of the best reading
PAPER_COLOR = "tab:red"
_BODY_COLORS = {"actuator": "tab:blue", "free mass": "tab:orange", "drill tool": "tab:green"}
_ZOOM = 0.3, 0.305  # [s]
_PAPER_FORCES = 3000.0  # end of the axis on which the paper's forces lie [N]
_PAPER = {number.key: number.paper for number in NUMBERS}


@dataclasses.dataclass(frozen=True)
class Shown:
    """Reading that the figures show, with one run of it in each regime.

    Args:
        label: in the legends.
        color: of its lines.
        reading: the choices.
        free: the run before drilling.
        drilling: the run in the rock.
    """

    label: str
    color: str
    reading: Reading
    free: Block
    drilling: Block


def new_figure(columns: int = 1, rows: int = 1) -> tuple[Figure, np.ndarray]:
    """Return a figure and its axes, shape (rows, columns)."""
    figure = Figure(figsize=(8.0 if columns == 1 else 10.0, 3.2 * rows), layout="constrained")
    axes = figure.subplots(rows, columns, squeeze=False)
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    return figure, axes


def run_figures(presets: Reading, best: Reading) -> dict[str, Figure]:
    """Return figures 3-5 and 8-14 by name."""
    shown = [
        _show(label, color, reading)
        for label, color, reading in zip(
            ("presets", f"best: {best.name}"), DRILL_COLORS, (presets, best), strict=True
        )
    ]
    return {
        "figure_03": _positions(shown, "free", 0.0, SHORT, 40_000),
        "figure_04": _positions(shown, "free", *_ZOOM, 1_000_000),
        "figure_05": _reacting_force(shown, "free"),
        "figure_08": _positions(shown, "drilling", 0.0, SHORT, 40_000),
        "figure_09": _positions(shown, "drilling", *_ZOOM, 1_000_000),
        "figure_10": _contact_forces(shown),
        "figure_11": _distribution(shown),
        "figure_12": _single_contact(shown),
        "figure_13": _kinetic_energy(shown),
        "figure_14": _reacting_force(shown, "drilling"),
    }


def _show(label: str, color: str, reading: Reading) -> Shown:
    return Shown(
        label,
        color,
        reading,
        _run(reading.parameters("free")),
        _run(reading.parameters("drilling")),
    )


def _run(parameters: Parameters) -> Block:
    return Simulation(parameters).advance_to(round(LONG * SECOND))


def _sample(block: Block, start: float, end: float, rate: int) -> tuple[np.ndarray, Samples]:
    first, count = round(start * rate), round((end - start) * rate)
    return np.arange(first, first + count) / rate, block.sample(Times.from_grid(first, count, rate))


def _positions(shown: list[Shown], regime: str, start: float, end: float, rate: int) -> Figure:
    figure, axes = new_figure(rows=len(shown))
    paper = round(SHORT * _PAPER[f"{regime}_impact_rate"])
    for axis, item in zip(axes.flat, shown, strict=True):
        block = getattr(item, regime)
        time, samples = _sample(block, start, end, rate)
        bodies = {
            "actuator": samples.actuator_position,
            "free mass": samples.free_mass_position,
            "drill tool": samples.drill_tool_displacement,
        }
        for name, position in bodies.items():
            axis.plot(time, 1e3 * position, color=_BODY_COLORS[name], linewidth=0.7, label=name)
        impacts = len(_impacts(block)[0])
        axis.set_title(f"{item.label}: {impacts} impacts in 0.6 s; paper: {paper}", fontsize=9)
        axis.set(xlabel="time [s]", ylabel="position [mm], toward the rock")
        axis.legend(loc="best", fontsize="small")
    return figure


def _reacting_force(shown: list[Shown], regime: str) -> Figure:
    figure, axes = new_figure()
    axis = axes[0, 0]
    for item in shown:
        time, samples = _sample(getattr(item, regime), 0.0, LONG, 10_000)
        mean = samples.reacting_force.mean()
        axis.plot(time, samples.reacting_force, linewidth=0.4, color=item.color, alpha=0.6)
        axis.axhline(
            mean, color=item.color, linestyle="--", label=f"{item.label}: mean {mean:.1f} N"
        )
    paper = _PAPER[f"{regime}_reacting_force_mean"]
    axis.axhline(paper, color=PAPER_COLOR, linestyle=":", label=f"paper: mean {paper:g} N")
    axis.set(xlabel="time [s]", ylabel="reacting force [N]")
    axis.legend(loc="upper right", fontsize="small")
    return figure


def _impacts(block: Block) -> tuple[np.ndarray, np.ndarray]:
    time = block.impacts["seconds"] + block.impacts["fraction"]
    return time[time < SHORT], block.impacts[time < SHORT]


def _contact_forces(shown: list[Shown]) -> Figure:
    figure, axes = new_figure(columns=2)
    for axis in axes.flat:
        for item in shown:
            time, impacts = _impacts(item.drilling)
            force = impacts["peak_force"]
            axis.plot(time, force, ".", markersize=3, color=item.color, label=item.label)
        axis.axhline(2600.0, color=PAPER_COLOR, linestyle=":", label="paper: up to 2600 N")
        axis.set(xlabel="time [s]", ylabel="greatest force of the contact [N]")
    axes[0, 0].set(ylim=(0.0, _PAPER_FORCES), title="the paper's forces")
    axes[0, 1].set(yscale="log", title="all forces")
    axes[0, 1].legend(fontsize="small")
    return figure


def _distribution(shown: list[Shown]) -> Figure:
    figure, axes = new_figure(columns=2)
    bins = (np.linspace(0.0, _PAPER_FORCES, 31), np.geomspace(100.0, 1e5, 60))
    for axis, edges in zip(axes.flat, bins, strict=True):
        for item in shown:
            forces = _impacts(item.drilling)[1]["peak_force"]
            axis.hist(
                forces, bins=edges, histtype="stepfilled", alpha=0.5, color=item.color,
                label=item.label,
            )  # fmt: skip
        axis.axvspan(*FORCE_RANGE, color=PAPER_COLOR, alpha=0.12, label="paper: 400 to 2200 N")
        axis.set(xlabel="greatest force of the contact [N]", ylabel="impacts in 0.6 s")
    axes[0, 0].set(title="the paper's forces")
    axes[0, 1].set(xscale="log", title="all forces")
    axes[0, 1].legend(fontsize="small")
    return figure


def _kinetic_energy(shown: list[Shown]) -> Figure:
    figure, axes = new_figure()
    axis = axes[0, 0]
    for item in shown:
        time, impacts = _impacts(item.drilling)
        arriving = np.cumsum(impacts["energy"])
        rock = item.reading.rock
        axis.step(
            time, rock.energy_share() * arriving, where="post", color=item.color,
            label=f"{item.label} ({rock.energy})",
        )  # fmt: skip
    # The other meanings of the energy, for the last one shown: the best reading.
    tool = single_contact(rock.parameters(), CONTACT_SPEED).tool_mass
    for name, style in zip(ENERGIES, ("-", "--", "-.", ":"), strict=True):
        if name != rock.energy:
            share = energy_share(name, rock.parameters().free_mass, tool)
            axis.step(time, share * arriving, style, where="post", color="gray", linewidth=0.8,
                      label=f"best, {name}")  # fmt: skip
    paper = _PAPER["drilling_kinetic_energy"]
    axis.plot(
        [0.0, SHORT], [0.0, paper], ":", color=PAPER_COLOR, label=f"paper: {paper:g} J in 0.6 s"
    )
    axis.set(xlabel="time [s]", ylabel="kinetic energy to the drill tool [J]")
    axis.legend(fontsize="small")
    return figure


def _single_contact(shown: list[Shown]) -> Figure:
    figure, axes = new_figure(columns=2)
    for item in shown:
        label = f"{item.label}, tool: {item.reading.rock.tool}"
        _draw_contact(axes, item.reading.rock.parameters(), "-", item.color, label)
    others = [name for name in ("rayleigh", "mode_shape", "shape mass, series") if name in TOOLS]
    for name, color in zip(others, ("tab:green", "tab:purple", "tab:brown"), strict=True):
        drill = preset("drilling").replace(**TOOLS[name].changes)
        _draw_contact(axes, drill, "--", color, f"tool: {name}")
    for axis, key, scale, unit in (
        (axes[0, 0], "contact_peak_displacement", 1e6, "µm"),
        (axes[0, 1], "contact_peak_force", 1.0, "N"),
    ):
        paper = scale * _PAPER[key]
        axis.axhline(paper, color=PAPER_COLOR, linestyle=":", label=f"paper: {paper:g} {unit}")
        axis.set_ylim(bottom=0.0)
    axes[0, 0].set(xlabel="time [µs]", ylabel="displacement [µm]")
    axes[0, 1].set(xlabel="time [µs]", ylabel="contact force [N]")
    axes[0, 1].legend(fontsize="x-small")
    return figure


def _draw_contact(axes: np.ndarray, drill: Parameters, style: str, color: str, label: str) -> None:
    duration = single_contact(drill, CONTACT_SPEED).duration
    time = np.linspace(0.0, duration, 200)
    displacement, force = contact_history(drill, CONTACT_SPEED, time)
    width = 1.6 if style == "-" else 0.9
    for axis, values in zip(axes.flat, (1e6 * displacement, force), strict=True):
        drawn: Axes = axis
        drawn.plot(1e6 * time, values, style, color=color, label=label, linewidth=width)
