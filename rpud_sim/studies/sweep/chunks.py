"""Chunks of a sweep: the units of work, and the most that a lost worker costs.

Simulations are numbered point by point. The ensemble at a point is that of ``rpud simulate
--repeat REPEAT --seed SEED`` with the point's own seed, so that any point can be repeated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.ensemble import run_members
from rpud_sim.simulation.simulation import initial_phases
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.processes import check_versions
from rpud_sim.studies.sweep.plan import PlannedRun, plan_run, point_seed
from rpud_sim.studies.sweep.recording import record_bag
from rpud_sim.studies.sweep.specification import SweepSpecification

# A chunk takes about a quarter of a second: much longer than sending and writing it, and short
# enough to lose. Small sweeps are cut finer, so that several workers have work. The size depends on
# the specification alone, since a folder may be completed on another machine.
_LONGEST, _SHORTEST = 600.0, 10.0  # simulated [s]
_MOST = 3072  # simulations
_WANTED = 32  # chunks of a small sweep

Failure = str | None


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Consecutive simulations of a sweep."""

    number: int  # of the chunk
    first: int  # number of the first simulation
    count: int  # of simulations
    specification: SweepSpecification  # of the sweep
    # values of the axes at the points of these simulations
    points: Mapping[str, np.ndarray]
    versions: Mapping[str, str]  # of everything that determines the results

    @property
    def first_point(self) -> int:
        """Number of the point that the first simulation belongs to."""
        return self.first // self.specification.repeat

    def ensembles(self) -> Iterator[tuple[int, dict[str, Any], range]]:
        """Yield number and values of each point, with those of its members that are here."""
        repeat, end = self.specification.repeat, self.first + self.count
        for i in range(len(next(iter(self.points.values())))):
            number = self.first_point + i
            begin = number * repeat
            members = range(max(self.first, begin) - begin, min(end, begin + repeat) - begin)
            yield number, {name: column[i].item() for name, column in self.points.items()}, members


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Results of the simulations of a chunk."""

    phases: np.ndarray  # initial phase of each [cycles], shape (count,)
    figures: np.ndarray  # those of the specification, shape (count, figures); NaN if missing
    failures: tuple[Failure, ...]  # why a simulation has no figures, None if it has
    bags: tuple[Mapping[str, bytes], ...]  # files of each bag by name; empty without a bag


# Chunks with their outcomes, as they finish.
Outcomes = Generator[tuple[Chunk, Outcome], None, None]


def chunk_size(specification: SweepSpecification) -> int:
    """Return the number of simulations in a chunk; the last one may have fewer."""
    whole = specification.simulations * specification.duration
    # Messages take much longer than the simulation, and bags stay in memory until they are written.
    longest = _SHORTEST if specification.bags else _LONGEST
    simulated = min(max(whole / _WANTED, _SHORTEST), longest)
    return min(max(round(simulated / specification.duration), 1), _MOST)


def chunk_count(specification: SweepSpecification) -> int:
    """Return the number of chunks."""
    return -(-specification.simulations // chunk_size(specification))


def make_chunks(
    specification: SweepSpecification,
    points: Mapping[str, np.ndarray],
    finished: frozenset[int] = frozenset(),
) -> Iterator[Chunk]:
    """Yield the unfinished chunks of a sweep, in order."""
    size = chunk_size(specification)
    versions = engine_versions()
    for number in range(chunk_count(specification)):
        if number in finished:
            continue
        first = number * size
        count = min(size, specification.simulations - first)
        begin = first // specification.repeat
        end = -(-(first + count) // specification.repeat)
        own = {name: values[begin:end] for name, values in points.items()}
        yield Chunk(number, first, count, specification, own, versions)


def simulate(chunk: Chunk) -> Outcome:
    """Run the simulations of a chunk.

    Raises:
        WorkerError: if this worker's versions would give other bits than the sweep's machine.
    """
    check_versions(chunk.versions)
    specification = chunk.specification
    phases: list[float] = []
    results: list[_Result] = []
    for number, point, members in chunk.ensembles():
        seed = point_seed(specification, number, point)
        chosen = initial_phases(specification.repeat, seed)[members.start : members.stop]
        phases.extend(chosen)
        runs = [plan_run(specification, number, point, member) for member in members]
        results.extend(_ensemble(specification, point, runs, chosen))
    return Outcome(
        np.array(phases),
        np.array([result.figures for result in results]),
        tuple(result.failure for result in results),
        tuple(result.bag for result in results),
    )


@dataclasses.dataclass(frozen=True)
class _Result:
    """Result of one simulation."""

    figures: list[float]  # those of the specification, NaN if missing
    failure: Failure = None  # why it has no figures
    bag: Mapping[str, bytes] = dataclasses.field(default_factory=dict)  # files by name


def _ensemble(
    specification: SweepSpecification,
    point: Mapping[str, Any],
    runs: Sequence[PlannedRun],
    phases: Sequence[float],
) -> Iterator[_Result]:
    """Yield the result of each member; a failed one does not affect the others."""
    nothing = [np.nan] * len(specification.figures)
    try:
        drill, planned = specification.configuration(point), specification.planned(point)
        # Members without a fault go together, which is faster. Each fault has its own times.
        groups = (
            [(runs, phases)]
            if runs[0].scenario is None
            else [([run], [phase]) for run, phase in zip(runs, phases, strict=True)]
        )
        found = [
            member
            for group, own in groups
            for member in run_members(
                drill, specification.duration, own, scenario=group[0].scenario, planned=planned
            )
        ]
    except ParameterError as error:
        yield from (_Result(nothing, str(error)) for _ in phases)
        return
    for run, phase, member in zip(runs, phases, found, strict=True):
        if member.failure is not None:
            yield _Result(nothing, " ".join(str(member.failure).split()))
            continue
        values = [member.figures.get(name) for name in specification.figures]
        figures = [np.nan if value is None else float(value) for value in values]
        bag = record_bag(specification, point, run, phase) if specification.bags else {}
        yield _Result(figures, None, bag)
