"""Chunks of a sweep: the units of work, and the most that a lost worker costs.

Simulations are numbered point by point. The ensemble at a point is that of ``rpud simulate
--repeat REPEAT --seed SEED`` with the point's own seed, so that any point can be repeated.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Generator, Iterator, Mapping

import numpy as np

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.ensemble import initial_phases, run_members
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.processes import check_versions
from rpud_sim.studies.sweep.specification import Specification

# A chunk takes about a quarter of a second: much longer than sending and writing it, and short
# enough to lose. Small sweeps are cut finer, so that several workers have work. The size depends on
# the specification alone, since a folder may be completed on another machine.
_LONGEST, _SHORTEST = 600.0, 10.0  # simulated [s]
_MOST = 3072  # simulations
_WANTED = 32  # chunks of a small sweep

_NO_FIGURES = [np.nan] * len(FIGURES)

Failure = str | None


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Consecutive simulations of a sweep."""

    number: int  # of the chunk
    first: int  # number of the first simulation
    count: int  # of simulations
    specification: Specification  # of the sweep
    # values of the swept parameters at the points of these simulations
    points: Mapping[str, np.ndarray]
    versions: Mapping[str, str]  # of everything that determines the results

    @property
    def first_point(self) -> int:
        """Number of the point that the first simulation belongs to."""
        return self.first // self.specification.repeat


@dataclasses.dataclass(frozen=True)
class Outcome:
    """Results of the simulations of a chunk."""

    phases: np.ndarray  # initial phase of each [cycles], shape (count,)
    figures: np.ndarray  # ``FIGURES`` of each, shape (count, figures), SI units; NaN if missing
    failures: tuple[Failure, ...]  # why a simulation has no figures, None if it has


# Chunks with their outcomes, as they finish.
Outcomes = Generator[tuple[Chunk, Outcome], None, None]


def chunk_size(specification: Specification) -> int:
    """Return the number of simulations in a chunk; the last one may have fewer."""
    whole = specification.simulations * specification.duration
    simulated = min(max(whole / _WANTED, _SHORTEST), _LONGEST)
    return min(max(round(simulated / specification.duration), 1), _MOST)


def chunk_count(specification: Specification) -> int:
    """Return the number of chunks."""
    return -(-specification.simulations // chunk_size(specification))


def point_seed(specification: Specification, point: int) -> int:
    """Return the seed of the initial phases at a point."""
    return specification.seed + point


def make_chunks(
    specification: Specification,
    design: Mapping[str, np.ndarray],
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
        points = {name: values[begin:end] for name, values in design.items()}
        yield Chunk(number, first, count, specification, points, versions)


def simulate(chunk: Chunk) -> Outcome:
    """Run the simulations of a chunk.

    Raises:
        WorkerError: if this worker's versions would give other bits than the sweep's machine.
    """
    check_versions(chunk.versions)
    repeat = chunk.specification.repeat
    end = chunk.first + chunk.count
    phases: list[float] = []
    rows: list[list[float]] = []
    failures: list[Failure] = []
    for i in range(len(next(iter(chunk.points.values())))):
        point = chunk.first_point + i
        members = range(
            max(chunk.first, point * repeat) - point * repeat,
            min(end, (point + 1) * repeat) - point * repeat,
        )
        drawn = initial_phases(repeat, point_seed(chunk.specification, point))
        chosen = drawn[members.start : members.stop]
        values = {name: column[i].item() for name, column in chunk.points.items()}
        phases.extend(chosen)
        for row, failure in _ensemble(chunk.specification, values, chosen):
            rows.append(row)
            failures.append(failure)
    return Outcome(np.array(phases), np.array(rows), tuple(failures))


def _ensemble(
    specification: Specification, point: Mapping[str, float | str], phases: tuple[float, ...]
) -> Iterator[tuple[list[float], Failure]]:
    """Yield figures and failure of each member; a failed one does not affect the others."""
    try:
        parameters = specification.parameters(point)
    except ParameterError as error:
        yield from ((_NO_FIGURES, str(error)) for _ in phases)
        return
    for member in run_members(parameters, specification.duration, phases):
        if member.failure is not None:
            yield _NO_FIGURES, str(member.failure)
            continue
        found = [member.figures[name] for name in FIGURES]
        yield [np.nan if value is None else float(value) for value in found], None
