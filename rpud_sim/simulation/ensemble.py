"""One run, or an ensemble of runs over initial vibration phases, as fast as the machine allows."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Sequence

import numpy as np

from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.sampling import NANOSECONDS, Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import FIGURES, Statistics

# Simulated time between two reports of progress [ns].
_STRIDE = 10 * NANOSECONDS

Figures = dict[str, float | int | None]


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Figures of the members of an ensemble.

    Args:
        phases: initial phase of each member [cycles].
        members: the figures of each member.
        real_time_factor: simulated seconds over wall seconds in the engine, over all members.
    """

    phases: tuple[float, ...]
    members: tuple[Figures, ...]
    real_time_factor: float

    def mean(self) -> Figures:
        """Return the mean of each figure over the members; None where no member has it."""
        return {name: _mean(self._column(name)) for name in ("duration", *FIGURES)}

    def standard_error(self) -> Figures:
        """Return the standard error of each mean; None for fewer than two members."""
        return {name: _standard_error(self._column(name)) for name in FIGURES}

    def _column(self, name: str) -> list[float]:
        return [value for member in self.members if (value := member[name]) is not None]


def _mean(values: Sequence[float]) -> float | int | None:
    if not values:
        return None
    return values[0] if len(values) == 1 else float(np.mean(values))


def _standard_error(values: Sequence[float]) -> float | None:
    if len(values) < 2:
        return None
    return float(np.std(values, ddof=1)) / math.sqrt(len(values))


def initial_phases(repeat: int, seed: int | None) -> tuple[float, ...]:
    """Return an ensemble's phases [cycles]: drawn with the seed; zero for one run without."""
    if seed is None and repeat == 1:
        return (0.0,)
    return tuple(np.random.default_rng(0 if seed is None else seed).random(repeat).tolist())


def compile_kernels(parameters: Parameters) -> None:
    """Have every kernel compiled, or loaded from the cache, before anything is timed."""
    simulation = Simulation(parameters)
    block = simulation.advance_to(1000)
    Statistics().add(block)
    block.sample(Times.from_nanoseconds(0))
    simulation.apply(WeightOnBit(0.5 * parameters.weight_on_bit + 1.0))


def run_ensemble(
    parameters: Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], None] = lambda simulated: None,
) -> Ensemble:
    """Run one simulation per initial phase.

    Args:
        parameters: of the drill.
        duration: of each run [s].
        phases: initial phase of each run [cycles].
        report: called now and then with the simulated seconds since the last call.

    Returns:
        The ``Ensemble``.
    """
    # Compiled, or loaded from the cache, before anything is timed.
    Statistics().add(Simulation(parameters).advance_to(1000))
    end = round(duration * NANOSECONDS)
    members: list[Figures] = []
    wall = 0.0
    for phase in phases:
        simulation = Simulation(parameters, phase)
        statistics = Statistics()
        while simulation.time < end:
            before = simulation.time
            started = time.perf_counter()
            block = simulation.advance_to(min(before + _STRIDE, end))
            wall += time.perf_counter() - started
            statistics.add(block)
            report((block.end - before) / NANOSECONDS)
        members.append(statistics.figures())
    simulated = end / NANOSECONDS * len(members)
    return Ensemble(tuple(phases), tuple(members), simulated / wall if wall > 0.0 else math.inf)
