"""Ensembles of runs over initial vibration phases, as fast as the machine allows."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
import time
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np

from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.compile import compilation_reported
from rpud_sim.model.elementary import CALLED_BY_PYTHON
from rpud_sim.model.engine import Buffers, EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.changes import Change
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration, whole_configuration
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Figures, RecentEnergy, Statistics

# Simulated time between two reports of progress, and between two looks at Ctrl-C [ns]: a cache
# holds the motion of a stretch.
_STRETCH = 2 * SECOND
_TASK = 10 * SECOND  # simulated time of a thread's task, at least [ns]


@dataclasses.dataclass(frozen=True)
class Member:
    """Result of one member of an ensemble."""

    figures: Figures  # of the whole run; empty if it failed
    account: EnergyAccount | None = None  # of energy; None if it failed
    failure: EngineError | None = None  # why it failed; None if it did not
    feed: FeedAccount | None = None  # energies of feed and mount; None without a feed
    rotation: RotorWork | None = None  # energies of the rotor; None without rotation


class _StoppedError(Exception):
    """The other members are not wanted any more."""


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Runs of one drill from several initial phases."""

    members: tuple[Member, ...]  # at least one; all have the same figures
    real_time_factor: float  # simulated seconds over wall seconds, over all members

    def mean(self) -> Figures:
        """Return the mean of each figure; None where no member has it."""
        return {
            name: float(np.mean(column)) if len(column) > 1 else next(iter(column), None)
            for name, column in self._columns().items()
        }

    def standard_error(self) -> Figures:
        """Return the standard error of each mean; None for fewer than two members."""
        return {
            name: float(np.std(column, ddof=1)) / math.sqrt(len(column)) if column[1:] else None
            for name, column in self._columns().items()
            if name != "duration"
        }

    def _columns(self) -> dict[str, list[float]]:
        return {
            name: [each for m in self.members if (each := m.figures[name]) is not None]
            for name in self.members[0].figures
        }


def compile_kernels(
    configuration: Configuration | Parameters,
    report: Callable[[str], object] = lambda text: None,
    messages: bool = False,
) -> None:
    """Compile every kernel, or load it from the cache, before anything is timed.

    ``report`` is called in another thread with a line that says so, if it takes long; ``messages``:
    also the kernels that make messages in batches.
    """
    with compilation_reported(report):
        for function, arguments in CALLED_BY_PYTHON:
            function(*arguments)
        simulation = Simulation(configuration)
        block = simulation.advance_to(1000)
        statistics = Statistics()
        statistics.add(block)
        statistics.figures()
        block.sample(Times.from_nanoseconds(0))
        if not simulation.configuration.has_feed:  # whose steps change the weight on bit
            simulation.apply(WeightOnBit(0.5 * simulation.applied.weight_on_bit.force + 1.0))
        simulation.advance_to(2000)  # the engine gets changes when time goes on
        if messages:
            energy = RecentEnergy()
            energy.add(simulation.advance_through(np.array([3000, 4000])))
            energy.powers()


def run_members(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], object] = lambda simulated: None,
    planned: Sequence[Change] = (),
    threads: int = 1,
) -> Generator[Member, None, None]:
    """Yield the result of one simulation per initial phase [cycles], failed ones as well.

    Each lasts a duration [s], with the ``planned`` commands and faults. ``report`` is called now
    and then with the simulated seconds since the last call, in any thread. The compiled code needs
    no GIL, so members run on ``threads``.
    """
    configuration = whole_configuration(configuration)
    end = round(duration * SECOND)
    size = max(_TASK // max(end, 1), 1)
    batches = [phases[i : i + size] for i in range(0, len(phases), size)]
    lock, stopped, buffers = threading.Lock(), threading.Event(), Buffers()

    def tell(simulated: float) -> None:
        if stopped.is_set():
            raise _StoppedError
        with lock:
            report(simulated)

    def run(batch: Sequence[float]) -> list[Member]:
        runs = (Simulation(configuration, phase, planned, None, buffers) for phase in batch)
        return [_run(each, end, tell) for each in runs]

    if threads == 1 or len(batches) == 1:
        for batch in batches:
            yield from run(batch)
        return
    with ThreadPoolExecutor(threads) as pool:
        try:
            for future in [pool.submit(run, batch) for batch in batches]:
                yield from future.result()
        finally:
            # Or the pool would finish all other members, after a failure or Ctrl-C, before it ends.
            stopped.set()
            pool.shutdown(cancel_futures=True)


def _run(
    simulation: Simulation,
    end: int,
    report: Callable[[float], object],
) -> Member:
    """Run a member stretch by stretch."""
    statistics = Statistics()
    try:
        for begin in range(0, end, _STRETCH):
            time = min(begin + _STRETCH, end)
            statistics.add(simulation.advance_to(time))
            report((time - begin) / SECOND)
    except EngineError as error:
        return Member({}, failure=error)
    figures = statistics.figures()
    if math.isfinite(simulation.depth):
        figures["depth"] = simulation.depth
        figures["penetration_rate"] = simulation.depth / statistics.duration
    return Member(figures, statistics.account, feed=statistics.feed, rotation=statistics.rotation)


def run_ensemble(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], object] = lambda simulated: None,
    planned: Sequence[Change] = (),
    threads: int = 1,
) -> Ensemble:
    """Run one simulation per initial phase; arguments as for ``run_members``.

    With a rock model the figures have the depth at the end [m] and the mean penetration rate [m/s].
    """
    configuration = whole_configuration(configuration)
    compile_kernels(configuration)
    started = time.perf_counter()
    found = run_members(configuration, duration, phases, report, planned, threads)
    members: list[Member] = []
    with contextlib.closing(found):
        for member in found:
            if member.failure is not None:
                raise member.failure
            members.append(member)
    wall = time.perf_counter() - started
    simulated = round(duration * SECOND) / SECOND * len(members)
    return Ensemble(tuple(members), simulated / wall if wall > 0.0 else math.inf)
