"""Ensembles of runs over initial vibration phases, as fast as the machine allows."""

from __future__ import annotations

import dataclasses
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numba.core import event

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.compile import compilation_notice
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.energy_account import EnergyAccount, RecentEnergy
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

# Simulated time between two reports of progress [ns].
_STRIDE = 10 * SECOND

_LONG = 1.0  # time of compiling after which it is reported [s]

Figures = dict[str, float | int | None]


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Figures of the members of an ensemble.

    Args:
        phases: initial phase of each member [cycles].
        members: the figures of each member, at least one; all have the same names.
        accounts: the energy account of each member.
        real_time_factor: simulated seconds over wall seconds in the engine, over all members.
    """

    phases: tuple[float, ...]
    members: tuple[Figures, ...]
    accounts: tuple[EnergyAccount, ...]
    real_time_factor: float

    def mean(self) -> Figures:
        """Return the mean of each figure over the members; None where no member has it."""
        return {name: _mean(self._column(name)) for name in self.members[0]}

    def standard_error(self) -> Figures:
        """Return the standard error of each mean; None for fewer than two members."""
        names = [name for name in self.members[0] if name != "duration"]
        return {name: _standard_error(self._column(name)) for name in names}

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


def compile_kernels(
    configuration: Configuration | Parameters,
    report: Callable[[str], object] = lambda text: None,
    messages: bool = False,
) -> None:
    """Compile every kernel, or load it from the cache, before anything is timed.

    Args:
        configuration: of the drill, or its parameters alone.
        report: called in another thread with a line that says so, if compiling takes long.
        messages: also those that make a run's messages many at once.
    """
    with _notice(report):
        simulation = Simulation(configuration)
        block = simulation.advance_to(1000)
        Statistics().add(block)
        block.sample(Times.from_nanoseconds(0))
        simulation.apply(WeightOnBit(0.5 * simulation.applied.weight_on_bit.force + 1.0))
        simulation.advance_to(2000)  # the engine gets changes when time goes on
        if messages:
            energy = RecentEnergy()
            energy.add_span(simulation.advance_through(np.array([3000, 4000])))
            energy.powers()


class _CompilationListener(event.Listener):
    """Listener of Numba that starts a timer when the first kernel is compiled, not loaded."""

    def __init__(self, notice: threading.Timer) -> None:
        self._notice = notice

    def on_start(self, event: event.Event) -> None:
        """Numba begins to compile."""
        if self._notice.ident is None:
            self._notice.start()

    def on_end(self, event: event.Event) -> None:
        """Numba has compiled."""


@contextmanager
def _notice(report: Callable[[str], object]) -> Iterator[None]:
    notice = threading.Timer(_LONG, lambda: report(compilation_notice()))
    try:
        with event.install_listener("numba:compile", _CompilationListener(notice)):
            yield
    finally:
        notice.cancel()


def run_ensemble(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], None] = lambda simulated: None,
    scenario: Scenario | None = None,
) -> Ensemble:
    """Run one simulation per initial phase.

    Args:
        configuration: of the drill, or its parameters alone.
        duration: of each run [s].
        phases: initial phase of each run [cycles].
        report: called now and then with the simulated seconds since the last call.
        scenario: faults that begin by themselves, in each run at the same times.

    Returns:
        The ``Ensemble``. With a rock model its members have the depth at the end [m] and the mean
        penetration rate [m/s] as well.

    Raises:
        FaultError: if a fault of the scenario cannot be honoured.
    """
    compile_kernels(configuration)
    end = round(duration * SECOND)
    members: list[Figures] = []
    accounts: list[EnergyAccount] = []
    wall = 0.0
    for phase in phases:
        simulation = Simulation(configuration, phase, scenario)
        statistics = Statistics()
        while simulation.time < end:
            before = simulation.time
            started = time.perf_counter()
            block = simulation.advance_to(min(before + _STRIDE, end))
            wall += time.perf_counter() - started
            statistics.add(block)
            report((block.end - before) / SECOND)
        figures = statistics.figures()
        if simulation.configuration.rock.rock_model != "none":
            figures["depth"] = simulation.depth
            figures["penetration_rate"] = simulation.depth / statistics.duration
        members.append(figures)
        accounts.append(statistics.account)
    simulated = end / SECOND * len(members)
    speed = simulated / wall if wall > 0.0 else math.inf
    return Ensemble(tuple(phases), tuple(members), tuple(accounts), speed)
