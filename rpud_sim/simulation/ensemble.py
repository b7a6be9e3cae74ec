"""Ensembles of runs over initial vibration phases, as fast as the machine allows."""

from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from queue import Empty, SimpleQueue

import numpy as np
from numba.core import event

from rpud_sim.drilling.rotor import RotorWork
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.compile import compilation_notice
from rpud_sim.model.elementary import CALLED_BY_PYTHON
from rpud_sim.model.engine import EngineError
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation.changes import Planned, apply_to_simulation
from rpud_sim.simulation.commands import WeightOnBit
from rpud_sim.simulation.configuration import Configuration, whole_configuration
from rpud_sim.simulation.energy_account import EnergyAccount, FeedAccount, RecentEnergy
from rpud_sim.simulation.members import Figures, Member, QuietRuns, runs_by_itself
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

# Simulated time between two reports of progress, and between two looks at Ctrl-C [ns].
_STRETCH = 10 * SECOND

# Longest wait for a report of another thread [s].
_PATIENCE = 0.1

_LONG = 1.0  # time of compiling after which it is reported [s]


class _StoppedError(Exception):
    """The other members are not wanted any more."""


@dataclasses.dataclass(frozen=True)
class Ensemble:
    """Figures of the members of an ensemble."""

    phases: tuple[float, ...]  # initial phase of each member [cycles]
    # the figures of each member, at least one; all have the same names
    members: tuple[Figures, ...]
    accounts: tuple[EnergyAccount, ...]  # the energy account of each member
    real_time_factor: float  # simulated seconds over wall seconds, over all members
    # the account of feed and mount of each member; none without a feed
    feed_accounts: tuple[FeedAccount, ...] = ()
    # energies of the rotor of each member; none without rotation
    rotor_works: tuple[RotorWork, ...] = ()

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
        report: called in another thread with a line that says so, if compiling takes long.
        messages: also those that make a run's messages many at once.
    """
    with _notice(report):
        for function, arguments in CALLED_BY_PYTHON:
            function(*arguments)
        simulation = Simulation(configuration)
        block = simulation.advance_to(1000)
        statistics = Statistics()
        statistics.add(block)
        statistics.figures()
        EnergyAccount.of(block)
        block.sample(Times.from_nanoseconds(0))
        if not simulation.configuration.has_feed:  # whose steps change the weight on bit
            simulation.apply(WeightOnBit(0.5 * simulation.applied.weight_on_bit.force + 1.0))
        simulation.advance_to(2000)  # the engine gets changes when time goes on
        if messages:
            energy = RecentEnergy()
            energy.add(simulation.advance_through(np.array([3000, 4000])))
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


@contextlib.contextmanager
def _notice(report: Callable[[str], object]) -> Iterator[None]:
    notice = threading.Timer(_LONG, lambda: report(compilation_notice()))
    try:
        with event.install_listener("numba:compile", _CompilationListener(notice)):
            yield
    finally:
        notice.cancel()


def compile_members(
    configuration: Configuration | Parameters, report: Callable[[str], object] = lambda text: None
) -> None:
    """Compile, or load from the cache, what runs members of ensembles."""
    configuration = whole_configuration(configuration)
    if not runs_by_itself(configuration):
        compile_kernels(configuration, report)
        return
    with _notice(report):
        QuietRuns(configuration, (0.0,)).advance_to(1000, Statistics())


def run_members(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], None] = lambda simulated: None,
    scenario: Scenario | None = None,
    accounts: bool = False,
    threads: int = 1,
    planned: Sequence[Planned] = (),
) -> Generator[Member, None, None]:
    """Yield the result of one simulation per initial phase, in their order; failed ones as well.

    Args:
        duration: of each run [s].
        phases: initial phase of each run [cycles].
        report: called now and then with the simulated seconds since the last call.
        scenario: faults that begin by themselves, in each run at the same times.
        accounts: whether the energy accounts are wanted.
        threads: to run members on; the compiled code needs no GIL.
        planned: commands and faults, in the order of their times, in each run.

    Raises:
        ParameterError: if a planned change is refused.
        FaultError: if a fault of the scenario cannot be honoured.
    """
    configuration = whole_configuration(configuration)
    end = round(duration * SECOND)
    quiet = runs_by_itself(configuration, scenario) and not planned
    drills = configuration.rock.rock_model != "none"
    # Short runs go together: a call of the compiled code takes as long as a stretch of a run.
    size = max(_STRETCH // max(end, 1), 1) if quiet and not drills else 1
    batches = [phases[i : i + size] for i in range(0, len(phases), size)]

    def run(batch: Sequence[float], report: Callable[[float], None]) -> list[Member]:
        if not quiet:
            return [_run(configuration, batch[0], scenario, planned, end, report)]
        if drills or end > _STRETCH:
            return [_run_quietly(configuration, batch[0], end, report)]
        members = QuietRuns(configuration, batch).run(end, accounts)
        report(len(batch) * end / SECOND)
        return members

    if threads == 1 or len(batches) == 1:
        for batch in batches:
            yield from run(batch, report)
        return
    # The caller's thread alone reports.
    reported: SimpleQueue[float] = SimpleQueue()
    stopped = threading.Event()

    def tell(simulated: float) -> None:
        if stopped.is_set():
            raise _StoppedError
        reported.put(simulated)

    with ThreadPoolExecutor(threads) as pool:
        try:
            running = [pool.submit(run, batch, tell) for batch in batches]
            for future in running:
                while not future.done():
                    with contextlib.suppress(Empty):
                        report(reported.get(timeout=_PATIENCE))
                yield from future.result()
            while not reported.empty():
                report(reported.get())
        finally:
            # Or the pool would finish all other members, after a failure or Ctrl-C, before it ends.
            stopped.set()
            pool.shutdown(cancel_futures=True)


def _run(
    configuration: Configuration,
    phase: float,
    scenario: Scenario | None,
    planned: Sequence[Planned],
    end: int,
    report: Callable[[float], None],
) -> Member:
    simulation = Simulation(configuration, phase, scenario)
    pending = deque(planned)

    def advance(time: int, statistics: Statistics) -> None:
        while pending and pending[0].delay < time:
            if pending[0].delay > simulation.time:
                statistics.add(simulation.advance_to(pending[0].delay))
            apply_to_simulation(simulation, pending.popleft().change)
        statistics.add(simulation.advance_to(time))

    return _stretch_by_stretch(configuration, simulation, advance, end, report)


def _run_quietly(
    configuration: Configuration, phase: float, end: int, report: Callable[[float], None]
) -> Member:
    """Run a long member, or one whose depth is wanted."""
    run = QuietRuns(configuration, (phase,))
    return _stretch_by_stretch(configuration, run, run.advance_to, end, report)


def _stretch_by_stretch(
    configuration: Configuration,
    run: Simulation | QuietRuns,
    advance: Callable[[int, Statistics], object],
    end: int,
    report: Callable[[float], None],
) -> Member:
    statistics = Statistics()
    time = 0
    while time < end:
        before, time = time, min(time + _STRETCH, end)
        try:
            advance(time, statistics)
        except EngineError as error:
            return Member({}, failure=error)
        report((time - before) / SECOND)
    figures = statistics.figures()
    if configuration.rock.rock_model != "none" or configuration.strata.strata:
        figures["depth"] = run.depth
        figures["penetration_rate"] = run.depth / statistics.duration
    return Member(figures, statistics.account, feed=statistics.feed, rotation=statistics.rotation)


def run_ensemble(
    configuration: Configuration | Parameters,
    duration: float,
    phases: Sequence[float],
    report: Callable[[float], None] = lambda simulated: None,
    scenario: Scenario | None = None,
    threads: int = 1,
    planned: Sequence[Planned] = (),
) -> Ensemble:
    """Run one simulation per initial phase; arguments as for ``run_members``.

    Returns:
        The ``Ensemble``. With a rock model its members have the depth at the end [m] and the mean
        penetration rate [m/s] as well.

    Raises:
        EngineError: if a member cannot go on; the first of them in order.
    """
    configuration = whole_configuration(configuration)
    compile_members(configuration)
    if scenario or planned:
        compile_kernels(configuration)
    members: list[Figures] = []
    accounts: list[EnergyAccount] = []
    feeds: list[FeedAccount] = []
    rotors: list[RotorWork] = []
    started = time.perf_counter()
    found = run_members(configuration, duration, phases, report, scenario, True, threads, planned)
    with contextlib.closing(found):
        for member in found:
            if member.failure is not None:
                raise member.failure
            assert member.account is not None
            members.append(member.figures)
            accounts.append(member.account)
            if member.feed is not None:
                feeds.append(member.feed)
            if member.rotation is not None:
                rotors.append(member.rotation)
    wall = time.perf_counter() - started
    simulated = round(duration * SECOND) / SECOND * len(members)
    speed = simulated / wall if wall > 0.0 else math.inf
    return Ensemble(
        tuple(phases), tuple(members), tuple(accounts), speed, tuple(feeds), tuple(rotors)
    )
