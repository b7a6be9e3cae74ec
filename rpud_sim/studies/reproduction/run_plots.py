"""Plots of single runs: the paper's figures 3-5 and 8-14, with initial phase zero as in eq. (1).

Each figure shows the presets, the best reading, and the paper's number or range, in the paper's
units. Where the forces of the presets leave the paper's axis, a second plot has all of them.
"""

from __future__ import annotations

import dataclasses
from typing import Literal

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.pages.plot import Axis, Envelope, Layer, Line, Plot, Points, Rule, Zone
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.sampling import Samples, Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.studies.reproduction.choices import ENERGIES, TOOLS, Reading, energy_share
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED, NUMBERS
from rpud_sim.studies.reproduction.single_contact import contact_history, single_contact
from rpud_sim.studies.reproduction.windows import FORCE_RANGE, LONG, SHORT

DRILL_COLORS = (0, 1)  # of the presets and of the best reading
PAPER_COLOR = "fault"
_ACTUATOR, _FREE_MASS, _DRILL_TOOL = 0, 1, 2  # colors
_ZOOM = 0.3, 0.305  # [s]
_ZOOM_RATE = 500_000  # 30 samples for each cycle of the vibration [Hz]
_BIN = 1e-4  # the actuator's range is drawn for each of these; more than a cycle [s]
_BIN_SAMPLES = 40
_RATE = 20_000  # of the slower motions [Hz]
_FORCE_RATE = 10_000  # of the reacting force, whose mean is taken [Hz]
_FORCE_DRAWN = 2  # every second of these is drawn
_PAPER_FORCES = 3000.0  # end of the axis on which the paper's forces lie [N]
_PAPER = {number.key: number.paper for number in NUMBERS}
_TIME = Axis("time", "s")
_PEAK = "greatest force of the contact"
_DASHES: tuple[Literal["solid", "dashed", "dotdash", "dotted"], ...] = (
    "solid",
    "dashed",
    "dotdash",
    "dotted",
)


@dataclasses.dataclass(frozen=True)
class Shown:
    """Reading that the figures show, with one run of it in each regime."""

    label: str  # in the legends
    color: int  # of its lines
    reading: Reading  # the choices
    free: Block  # the run before drilling
    drilling: Block  # the run in the rock


def run_plots(presets: Reading, best: Reading) -> dict[str, tuple[Plot, ...]]:
    """Return figures 3-5 and 8-14 by name."""
    shown = [
        _show(label, color, reading)
        for label, color, reading in zip(
            ("presets", f"best: {best.name}"), DRILL_COLORS, (presets, best), strict=True
        )
    ]
    return {
        "figure_03": _positions(shown, "free"),
        "figure_04": _zoomed_positions(shown, "free"),
        "figure_05": _reacting_force(shown, "free"),
        "figure_08": _positions(shown, "drilling"),
        "figure_09": _zoomed_positions(shown, "drilling"),
        "figure_10": _contact_forces(shown),
        "figure_11": _distribution(shown),
        "figure_12": _single_contact(shown),
        "figure_13": _kinetic_energy(shown),
        "figure_14": _reacting_force(shown, "drilling"),
    }


def _show(label: str, color: int, reading: Reading) -> Shown:
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


def _line(name: str, time: np.ndarray, values: np.ndarray, color: int, width: float = 1.0) -> Line:
    """Return a line in single precision: half the bytes, and finer than a pixel at any zoom."""
    return Line(name, time.astype(np.float32), values.astype(np.float32), color=color, width=width)


def _positions(shown: list[Shown], regime: str) -> tuple[Plot, ...]:
    """Return the motions over the paper's window; the vibration as the range of each short bin."""
    plots = []
    for item in shown:
        block = getattr(item, regime)
        bins = round(SHORT / _BIN)
        fast = _sample(block, 0.0, SHORT, round(_BIN_SAMPLES / _BIN))[1]
        layers: tuple[Layer, ...] = (
            _vibration(1e3 * fast.actuator_position.reshape(bins, _BIN_SAMPLES)),
            *_slow_bodies(*_sample(block, 0.0, SHORT, _RATE)),
        )
        plots.append(_motion(item, regime, layers))
    return tuple(plots)


def _vibration(position: np.ndarray) -> Envelope:
    """Return the range of a position, shape (bins, samples), in each bin."""
    low, mean, high = (
        np.append(values, values[-1:]).astype(np.float32)
        for values in (position.min(axis=1), position.mean(axis=1), position.max(axis=1))
    )
    begin = _BIN * np.arange(len(low), dtype=np.float32)
    return Envelope("actuator, with its range within 0.1 ms", begin, low, mean, high, _ACTUATOR)


def _zoomed_positions(shown: list[Shown], regime: str) -> tuple[Plot, ...]:
    plots = []
    for item in shown:
        time, samples = _sample(getattr(item, regime), *_ZOOM, _ZOOM_RATE)
        actuator = _line("actuator", time, 1e3 * samples.actuator_position, _ACTUATOR)
        plots.append(_motion(item, regime, (actuator, *_slow_bodies(time, samples))))
    return tuple(plots)


def _slow_bodies(time: np.ndarray, samples: Samples) -> tuple[Line, ...]:
    return (
        _line("free mass", time, 1e3 * samples.free_mass_position, _FREE_MASS),
        _line("drill tool", time, 1e3 * samples.drill_tool_displacement, _DRILL_TOOL),
    )


def _motion(item: Shown, regime: str, layers: tuple[Layer, ...]) -> Plot:
    paper = round(SHORT * _PAPER[f"{regime}_impact_rate"])
    impacts = len(_impacts(getattr(item, regime))[0])
    return Plot(
        f"position, toward the rock: {item.label}",
        layers,
        f"{impacts} impacts in 0.6 s; paper: {paper}.",
        Axis(unit="mm"),
        _TIME,
        240,
    )


def _reacting_force(shown: list[Shown], regime: str) -> tuple[Plot, ...]:
    lines: list[Layer] = []
    means: list[Layer] = []
    for item in shown:
        time, samples = _sample(getattr(item, regime), 0.0, LONG, _FORCE_RATE)
        mean = float(samples.reacting_force.mean())
        drawn = slice(None, None, _FORCE_DRAWN)
        force = samples.reacting_force[drawn]
        lines.append(_line(item.label, time[drawn], force, item.color, 0.7))
        means.append(Rule(f"{item.label}: mean {mean:.1f} N", mean, color=item.color))
    paper = _PAPER[f"{regime}_reacting_force_mean"]
    means.append(Rule(f"paper: mean {paper:g} N", paper, color=PAPER_COLOR, dash="dotted"))
    return (Plot("reacting force", (*lines, *means), y=Axis(unit="N"), x=_TIME, height=280),)


def _impacts(block: Block) -> tuple[np.ndarray, np.ndarray]:
    time = block.impacts["seconds"] + block.impacts["fraction"]
    return time[time < SHORT], block.impacts[time < SHORT]


def _contact_forces(shown: list[Shown]) -> tuple[Plot, ...]:
    layers: list[Layer] = []
    for item in shown:
        time, impacts = _impacts(item.drilling)
        layers.append(Points(item.label, time, impacts["peak_force"], size=4, color=item.color))
    layers.append(Rule("paper: up to 2600 N", 2600.0, color=PAPER_COLOR, dash="dotted"))
    paper = Axis(unit="N", low=0.0, high=_PAPER_FORCES)
    return (
        Plot(f"{_PEAK}: the paper's forces", tuple(layers), y=paper, x=_TIME, height=240),
        Plot(f"{_PEAK}: all", tuple(layers), y=Axis(unit="N", log=True), x=_TIME, height=240),
    )


def _distribution(shown: list[Shown]) -> tuple[Plot, ...]:
    plots = []
    for title, axis, edges in (
        ("the paper's forces", Axis(_PEAK, "N"), np.linspace(0.0, _PAPER_FORCES, 31)),
        ("all forces", Axis(_PEAK, "N", log=True), np.geomspace(100.0, 1e5, 60)),
    ):
        layers: list[Layer] = [Zone("paper: 400 to 2200 N", *FORCE_RANGE, False, PAPER_COLOR)]
        for item in shown:
            counts, _ = np.histogram(_impacts(item.drilling)[1]["peak_force"], edges)
            # Outlines: bars of one drill would hide those of the other.
            heights = np.append(counts, 0)
            layers.append(Line(item.label, edges, heights, True, item.color, width=1.8))
        title = f"impacts in 0.6 s: {title}"
        plots.append(Plot(title, tuple(layers), y=Axis(low=0.0), x=axis, height=240))
    return tuple(plots)


def _kinetic_energy(shown: list[Shown]) -> tuple[Plot, ...]:
    layers: list[Layer] = []
    for item in shown:
        time, impacts = _impacts(item.drilling)
        arriving = np.cumsum(impacts["energy"])
        rock = item.reading.rock
        label = f"{item.label} ({rock.energy})"
        layers.append(Line(label, time, rock.energy_share() * arriving, True, item.color))
    # The other meanings of the energy, for the last one shown: the best reading.
    tool = single_contact(rock.parameters(), CONTACT_SPEED).tool_mass
    for name, dash in zip(ENERGIES, _DASHES, strict=True):
        if name != rock.energy:
            share = energy_share(name, rock.parameters().free_mass, tool)
            layers.append(Line(f"best, {name}", time, share * arriving, True, "muted", dash, 1.0))
    paper = _PAPER["drilling_kinetic_energy"]
    label = f"paper: {paper:g} J in 0.6 s"
    ends = np.array([0.0, SHORT]), np.array([0.0, paper])
    layers.append(Line(label, *ends, color=PAPER_COLOR, dash="dotted"))
    up = Axis(unit="J", low=0.0)
    return (Plot("kinetic energy to the drill tool", tuple(layers), y=up, x=_TIME, height=280),)


def _single_contact(shown: list[Shown]) -> tuple[Plot, ...]:
    drawn = [
        (
            f"{item.label}, tool: {item.reading.rock.tool}",
            item.color,
            item.reading.rock.parameters(),
        )
        for item in shown
    ]
    others = [name for name in ("rayleigh", "mode_shape", "shape mass, series") if name in TOOLS]
    drawn += [
        (f"tool: {name}", color, preset("drilling").replace(**TOOLS[name].changes))
        for color, name in enumerate(others, len(shown))
    ]
    plots = []
    for number, (title, key, scale, unit) in enumerate(
        (
            ("displacement", "contact_peak_displacement", 1e6, "µm"),
            ("contact force", "contact_peak_force", 1.0, "N"),
        )
    ):
        layers: list[Layer] = []
        for label, color, drill in drawn:
            time = np.linspace(0.0, single_contact(drill, CONTACT_SPEED).duration, 200)
            values = scale * contact_history(drill, CONTACT_SPEED, time)[number]
            of_reading = color < len(shown)
            layers.append(
                Line(label, 1e6 * time, values, color=color,
                     dash="solid" if of_reading else "dashed", width=1.8 if of_reading else 1.0)
            )  # fmt: skip
        paper = scale * _PAPER[key]
        label = f"paper: {paper:g} {unit}"
        layers.append(Rule(label, paper, color=PAPER_COLOR, dash="dotted"))
        up = Axis(unit=unit, low=0.0)
        plots.append(Plot(title, tuple(layers), y=up, x=Axis("time", "µs"), height=240))
    return tuple(plots)
