"""Measures: figures of one run over windows of time, which a fit compares with its targets."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.contact import single_contact
from rpud_sim.model.engine import Buffers
from rpud_sim.model.segment import IMPACT, join_records
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import FIGURES, Statistics

SAMPLE_RATE = 5000  # for the greatest displacements; these motions are slower than 100 Hz [Hz]
_TORQUE_INTERVAL = SECOND // 100  # between samples of the torque [ns]

_BUFFERS = Buffers()

# Values of single impacts, with the field of their record and unit, for a statistic over them.
IMPACT_VALUES = {
    "contact_force": ("peak_force", "N"),
    "contact_duration": ("contact_duration", "s"),
    "impact_velocity": ("impact_velocity", "m/s"),
    "impact_energy": ("energy", "J"),
    "impulse": ("impulse", "N s"),
}
# Figures of one collision in the rock, for which nothing is simulated.
CONTACT_FIGURES = {
    "contact_peak_force": ("peak_force", "N"),
    "contact_peak_displacement": ("peak_displacement", "m"),
}
# Greatest displacements in a window, which are sampled, with their channels.
_CHANNELS = {
    "nodal_plane_displacement": "nodal_plane_position",
    "drill_tool_displacement": "drill_tool_displacement",
}
# Figures of rock, rotor and actuator, as topics name them: means over a window.
DRILLING_FIGURES = {
    "penetration_rate": "m/s",
    "torque": "N m",  # of rock and cuttings against the rotation
    "electrical_power": "W",
    "actuator_power": "W",  # work of the vibration on the free mass
}
# Figures that may be negative.
SIGNED = ("energy_transferred_rate", "energy_absorbed_rate", "reacting_force_mean")
# Those of ``rpud simulate`` over a window, and all others.
UNITS: Mapping[str, str] = {
    **FIGURES,
    "kinetic_energy": "J",
    **dict.fromkeys(_CHANNELS, "m"),
    **DRILLING_FIGURES,
    **{name: unit for name, (_, unit) in (IMPACT_VALUES | CONTACT_FIGURES).items()},
}


@dataclasses.dataclass(frozen=True)
class Measure:
    """Figure of a run."""

    figure: str  # of ``UNITS``
    start: float  # of its window, simulation time [s]
    end: float  # of its window [s]
    quantile: float | None = None  # of values of impacts, from 0 to 1; None for their mean
    impact_velocity: float = 5.0  # of the free mass, for a figure of one collision [m/s]

    @property
    def unit(self) -> str:
        return UNITS[self.figure]

    @property
    def simulated(self) -> bool:
        return self.figure not in CONTACT_FIGURES

    def __str__(self) -> str:
        if not self.simulated:
            return f"{self.figure} at {self.impact_velocity:g} m/s"
        statistic = ", mean" if self.figure in IMPACT_VALUES else ""
        if self.quantile is not None:
            statistic = f", {100.0 * self.quantile:g} % quantile"
        return f"{self.figure}{statistic}, {self.start:g} to {self.end:g} s"


def missing_model(configuration: Configuration, figure: str) -> str:
    """Return the parameter that a drill must set to have a figure; empty if it has it."""
    rock = configuration.rock.rock_model != "none" or bool(configuration.strata.strata)
    needs = {
        "penetration_rate": (rock, "rock_model or strata"),
        "torque": (configuration.rotation.rotation_model != "none", "rotation_model"),
        "electrical_power": (
            configuration.actuator.actuator_model == "resonance",
            "actuator_model: resonance",
        ),
    }
    has, parameter = needs.get(figure, (True, ""))
    return "" if has else parameter


def measure(configuration: Configuration, phase: float, measures: Sequence[Measure]) -> list[float]:
    """Return the measures of a run from an initial phase [cycles]; NaN where it has no figure."""
    windows = {_span(item): _Window() for item in measures if item.simulated}
    if windows:
        _simulate(configuration, phase, windows, {item.figure for item in measures})
    return [
        _figure(windows[_span(item)], item) if item.simulated else _contact(configuration, item)
        for item in measures
    ]


def _span(item: Measure) -> tuple[int, int]:
    """Return start and end of a measure's window [ns]."""
    return round(item.start * SECOND), round(item.end * SECOND)


def _contact(configuration: Configuration, item: Measure) -> float:
    contact = single_contact(configuration.parameters, item.impact_velocity)
    return float(getattr(contact, CONTACT_FIGURES[item.figure][0]))


class _Window:
    """What a run gives between two times."""

    def __init__(self) -> None:
        self.parts: list[Statistics] = []
        self.impacts: list[np.ndarray] = []
        self.deeper: list[float] = []  # by which the hole gets deeper [m]; NaN without rock
        self.blocks: list[Block] = []  # of the motion; none if nothing of it is sampled

    def statistics(self) -> Statistics:
        if len(self.parts) == 1:  # a sum takes as long as a short run
            return self.parts[0]
        whole = Statistics()
        for part in self.parts:
            whole.merge(part)
        return whole

    def values(self, field: str) -> np.ndarray:
        return np.concatenate([impacts[field] for impacts in self.impacts])


def _simulate(
    configuration: Configuration,
    phase: float,
    windows: Mapping[tuple[int, int], _Window],
    figures: set[str],
) -> None:
    """Fill windows with a run, which is advanced from one of their edges to the next."""
    # Blocks of motion are kept only if something of it is sampled.
    buffers = _BUFFERS if figures.isdisjoint(_CHANNELS) else None
    run = Simulation(configuration, phase, buffers=buffers)
    turns = "torque" in figures and configuration.rotation.rotation_model != "none"
    for start, end in itertools.pairwise(sorted({0, *itertools.chain(*windows)})):
        depth, statistics = run.depth, Statistics()
        between = range(start + _TORQUE_INTERVAL, end, _TORQUE_INTERVAL) if turns else ()
        blocks, impacts = [], []
        for time in (*between, end):
            blocks.append(run.advance_to(time))
            statistics.add(blocks[-1])
            impacts.append(join_records([blocks[-1].impacts], IMPACT))
        for (first, last), window in windows.items():
            if first <= start and end <= last:
                window.parts.append(statistics)
                window.impacts += impacts
                window.deeper.append(run.depth - depth)
                window.blocks += blocks


def _figure(window: _Window, item: Measure) -> float:
    start, end = _span(item)
    duration = (end - start) / SECOND
    if item.figure in IMPACT_VALUES:
        return impact_statistic(window.values(IMPACT_VALUES[item.figure][0]), item)
    if item.figure in _CHANNELS:
        return max(_greatest(block, _CHANNELS[item.figure]) for block in window.blocks)
    match item.figure:
        case "kinetic_energy":
            return float(window.values("energy").sum())
        case "penetration_rate":
            return math.fsum(window.deeper) / duration
        case "torque":
            rotors = [block.process.rotation for block in window.blocks]
            torques = [rotor.torque for rotor in rotors if rotor]
            return math.fsum(torques) / len(torques) if torques else math.nan
        case "electrical_power":
            return window.statistics().account.electrical / duration
        case "actuator_power":
            return window.statistics().account.actuator_work / duration
    value = window.statistics().figures()[item.figure]
    return math.nan if value is None else float(value)


def impact_statistic(values: np.ndarray, item: Measure) -> float:
    """Return the statistic of a measure over values of impacts; NaN if there are none."""
    if not len(values):
        return math.nan
    return float(values.mean() if item.quantile is None else np.quantile(values, item.quantile))


def _greatest(block: Block, channel: str) -> float:
    numbers = block.grid(SAMPLE_RATE)
    if not numbers:
        return 0.0
    samples = block.sample(Times.from_grid(numbers.start, len(numbers), SAMPLE_RATE))
    return float(np.abs(getattr(samples, channel)).max())
