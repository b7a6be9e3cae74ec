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

from rpud_sim.drilling.rock import Progress
from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.time import SECOND, split_fraction
from rpud_sim.model.compile import compilation_reported
from rpud_sim.model.drill import derive
from rpud_sim.model.elementary import CALLED_BY_PYTHON
from rpud_sim.model.engine import EngineError, failure, initial_state
from rpud_sim.model.events import DONE
from rpud_sim.model.parameters import Parameters
from rpud_sim.model.resonator import account
from rpud_sim.model.segment import IMPACT, SEGMENT
from rpud_sim.model.tally import CLASSES, PART_ROOM, advance_members, empty_tallies
from rpud_sim.simulation.actuator import Actuator
from rpud_sim.simulation.changes import Change
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration, whole_configuration
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount
from rpud_sim.simulation.plant import rpud_constants
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import (
    Figures,
    RecentEnergy,
    Statistics,
    account_of_tally,
    figures_of,
)

_FIRST_IMPACTS = 1024  # room for impacts; it doubles when it is too small


def runs_by_itself(configuration: Configuration, planned: Sequence[Change] = ()) -> bool:
    """Return whether nothing happens in a run but the drill's own motion.

    Planned changes, a temperature, a tracking generator and the slow processes of drilling
    change a drill at their instants, and only a ``Simulation`` knows them.
    """
    actuator = configuration.actuator
    steady = not actuator.heating and actuator.generator != "tracking"
    alone = not (configuration.rotates or configuration.has_feed or configuration.layers)
    return steady and alone and not planned


@dataclasses.dataclass(frozen=True)
class Member:
    """Result of one member of an ensemble."""

    figures: Figures  # of the whole run; empty if it failed
    account: EnergyAccount | None = None  # of energy; None if it failed
    failure: EngineError | None = None  # why it failed; None if it did not
    feed: FeedAccount | None = None  # energies of feed and mount; None without a feed
    rotation: RotorWork | None = None  # energies of the rotor; None without rotation


class _Room(threading.local):
    """Arrays that all calls of the kernel in a thread share."""

    def __init__(self) -> None:
        self.impacts = np.empty(_FIRST_IMPACTS, IMPACT)
        self.segments = np.zeros(2, SEGMENT)
        self.classes = np.zeros(CLASSES, np.int64)  # empty between two calls
        self.part = np.zeros(PART_ROOM)


_room = _Room()


class EnsembleRuns:
    """Runs of one drill without commands, from time zero on, which differ in their phases."""

    def __init__(self, configuration: Configuration, phases: Sequence[float]) -> None:
        self._parameters = parameters = configuration.parameters
        drive = configuration.nominal_drive
        actuator = Actuator(configuration.actuator, parameters.vibration_amplitude, drive)
        self._drill = derive(parameters)
        self._rpud = rpud_constants(parameters, actuator.resonance)
        self._resonant = actuator.resonance is not None
        state = initial_state(parameters, 0.0, actuator.level > 0.0, actuator.resonance)
        self._states = state.repeat(len(phases))
        self._states["phase"] = [phase % 1.0 for phase in phases]
        if self._resonant:
            self._states["drive_phase"] = self._states["phase"]
        self._segments = np.zeros(len(phases), SEGMENT)
        self._impacts = np.zeros(len(phases), IMPACT)
        self._statuses = np.full(len(phases), DONE)
        self._quantiles = np.full(len(phases), -1)
        self._drawn = [0.0] * len(phases)
        self._progress = Progress(configuration.rock, parameters.tool_length)
        self._begun = False
        self.time = 0  # simulation time [ns], read-only

    @property
    def depth(self) -> float:
        return self._progress.depth

    def run(self, end: int) -> list[Member]:
        """Run all from time zero to an end [ns]."""
        tallies = empty_tallies(len(self._states))
        self._advance(end, tallies, _room.classes, (True, True, True))
        found = []
        for number, tally in enumerate(tallies):
            if (error := self._error(number)) is not None:
                found.append(Member({}, failure=error))
                continue
            figures = figures_of(tally, end / SECOND, int(self._quantiles[number]))
            energies = account_of_tally(tally, self._electrical(number))
            found.append(Member(figures, energies))
        return found

    def advance_to(self, time: int, statistics: Statistics) -> np.ndarray:
        """Advance a single run to a time [ns], and return its impacts since the last call.

        The next call of any run in this thread overwrites them.
        """
        [_] = self._states
        begin = self.time
        counts = begin == 0 and not statistics.begun
        count = self._advance(time, *statistics.sums, (not self._begun, False, counts))
        if (error := self._error(0)) is not None:
            raise error
        statistics.note_part(begin, time, self._electrical(0))
        found = _room.impacts[:count]
        if self._drill.in_rock:
            self._progress.add(found)
        return found

    def _advance(
        self, time: int, tallies: np.ndarray, classes: np.ndarray, options: tuple[bool, ...]
    ) -> int:
        """Advance all runs; return how many impacts the last one had."""
        runs = (self._states, self._segments, self._impacts)
        members = (*runs, tallies, self._statuses, self._quantiles)
        times = (split_fraction(self.time), split_fraction(time))
        progress = np.array([0, -1, 0])
        while True:
            rooms = (_room.impacts, _room.segments, classes, _room.part)
            if advance_members(self._drill, self._rpud, members, *times, options, rooms, progress):
                break
            _room.impacts = np.concatenate([_room.impacts, np.empty_like(_room.impacts)])
        self._begun = True
        self.time = time
        return int(progress[2])

    def _error(self, number: int) -> EngineError | None:
        status = int(self._statuses[number])
        if status == DONE:
            return None
        return failure(status, self._parameters, self._drill, self._states[number : number + 1])

    def _electrical(self, number: int) -> float:
        """Return the electrical energy since the last call [J]; NaN without a resonance."""
        if not self._resonant:
            return math.nan
        state = self._states[number]
        seconds, fraction = split_fraction(self.time)
        ahead = float(seconds - state["seconds"]) + (fraction - state["fraction"])
        drawn = float(account(state, self._segments[number], ahead).drawn)
        before, self._drawn[number] = self._drawn[number], drawn
        return drawn - before


# Simulated time between two reports of progress, and between two looks at Ctrl-C [ns].
_STRETCH = 10 * SECOND


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
    also what makes messages many at once.
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


def compile_members(
    configuration: Configuration | Parameters, report: Callable[[str], object] = lambda text: None
) -> None:
    """Compile, or load from the cache, what runs members of ensembles."""
    configuration = whole_configuration(configuration)
    if not runs_by_itself(configuration):
        compile_kernels(configuration, report)
        return
    with compilation_reported(report):
        EnsembleRuns(configuration, (0.0,)).advance_to(1000, Statistics())


def run_members(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], object] = lambda simulated: None,
    planned: Sequence[Change] = (),
    threads: int = 1,
) -> Generator[Member, None, None]:
    """Yield the result of one simulation per initial phase [cycles], failed ones as well.

    Each lasts a duration [s], with the ``planned`` commands and faults. ``report`` is called now and then with the simulated
    seconds since the last call, in any thread. The compiled code needs no GIL, so members run on
    ``threads``.
    """
    configuration = whole_configuration(configuration)
    end = round(duration * SECOND)
    quiet = runs_by_itself(configuration, planned)
    drills = configuration.rock.rock_model != "none"
    # Short runs go together: a call of the compiled code takes as long as a stretch of a run.
    size = max(_STRETCH // max(end, 1), 1) if quiet and not drills else 1
    batches = [phases[i : i + size] for i in range(0, len(phases), size)]
    lock, stopped = threading.Lock(), threading.Event()

    def tell(simulated: float) -> None:
        if stopped.is_set():
            raise _StoppedError
        with lock:
            report(simulated)

    def run(batch: Sequence[float]) -> list[Member]:
        if size == 1 or end > _STRETCH:
            if quiet:
                own: Simulation | EnsembleRuns = EnsembleRuns(configuration, batch)
            else:
                own = Simulation(configuration, batch[0], planned)
            return [_run(own, configuration, end, tell)]
        members = EnsembleRuns(configuration, batch).run(end)
        tell(len(batch) * end / SECOND)
        return members

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
    run: Simulation | EnsembleRuns,
    configuration: Configuration,
    end: int,
    report: Callable[[float], object],
) -> Member:
    """Run a member stretch by stretch: a long one, or one with changes or a depth."""
    statistics = Statistics()
    try:
        for begin in range(0, end, _STRETCH):
            time = min(begin + _STRETCH, end)
            if isinstance(run, EnsembleRuns):
                run.advance_to(time, statistics)
            else:
                statistics.add(run.advance_to(time))
            report((time - begin) / SECOND)
    except EngineError as error:
        return Member({}, failure=error)
    figures = statistics.figures()
    if configuration.rock.rock_model != "none" or configuration.strata.strata:
        figures["depth"] = run.depth
        figures["penetration_rate"] = run.depth / statistics.duration
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
    compile_members(configuration)
    if planned:
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
