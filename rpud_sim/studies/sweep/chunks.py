"""Chunks of a sweep: the units of work, and the most that a lost worker costs.

Simulations are numbered point by point. The ensemble at a point is that of ``rpud simulate
--repeat REPEAT --seed SEED`` with the point's own seed, so that any point can be repeated.
"""

from __future__ import annotations

import dataclasses
import platform
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
from scipy.stats import qmc

from rpud_sim.bag.metadata import Manifest, installed_versions
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.ensemble import run_members
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.statistics import Figures
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.sweep.indices import saltelli_shares
from rpud_sim.studies.sweep.specification import PlannedRun, SweepSpecification
from rpud_sim.studies.workers import check_versions

# A chunk takes about a quarter of a second: much longer than sending and writing it, and short
# enough to lose. Small sweeps are cut finer, so that several workers have work. The size depends on
# the specification alone, since a folder may be completed on another machine.
_LONGEST, _SHORTEST = 600.0, 10.0  # simulated [s]
_MOST = 3072  # simulations
_WANTED = 32  # chunks of a small sweep
_COUNTS = ("events",)  # figures that are whole numbers


@dataclasses.dataclass(frozen=True)
class SweepChunk:
    """Consecutive simulations of a sweep."""

    number: int  # of the chunk
    first: int  # number of the first simulation
    count: int  # of simulations
    specification: SweepSpecification  # of the sweep
    # values of the axes at the points of these simulations
    points: Mapping[str, np.ndarray]
    versions: Mapping[str, str]  # of everything that determines the results

    def ensembles(self) -> Iterator[tuple[int, dict[str, Any], range]]:
        """Yield number and values of each point, with those of its members that are here."""
        repeat, end = self.specification.repeat, self.first + self.count
        for i in range(len(next(iter(self.points.values())))):
            number = self.first // repeat + i
            begin = number * repeat
            members = range(max(self.first, begin) - begin, min(end, begin + repeat) - begin)
            yield number, {name: column[i].item() for name, column in self.points.items()}, members


class SweepOutcome(NamedTuple):
    """Results of the simulations of a chunk."""

    table: pa.Table  # a row each; missing figures and labels are null
    bags: Mapping[str, Mapping[str, bytes]]  # files by name, by the path of the bag in the folder


def chunk_size(sweep: SweepSpecification) -> int:
    """Return the number of simulations in a chunk; the last one may have fewer."""
    whole = sweep.simulations * sweep.duration
    # Messages take much longer than the simulation, and bags stay in memory until they are written.
    longest = _SHORTEST if sweep.bags else _LONGEST
    simulated = min(max(whole / _WANTED, _SHORTEST), longest)
    return min(max(round(simulated / sweep.duration), 1), _MOST)


def chunk_count(sweep: SweepSpecification) -> int:
    return -(-sweep.simulations // chunk_size(sweep))


def design_points(sweep: SweepSpecification) -> dict[str, np.ndarray]:
    """Return the points of a sweep: by axis its values, shape (points,), SI units.

    Cases change slowest, then faults; each has the whole design. In a grid the last parameter
    changes fastest. Latin hypercubes and (scrambled) Sobol sequences are SciPy's, with the seed of
    the specification.
    """
    design = _swept_points(sweep)
    axes = sweep.axes
    outer = {name: item.levels() for name, item in axes.items() if name not in design}
    shape = [*map(len, outer.values()), sweep.design_count]
    *levels, inner = np.unravel_index(np.arange(sweep.point_count), shape)
    return {
        **{name: outer[name][level] for name, level in zip(outer, levels, strict=True)},
        **{name: values[inner] for name, values in design.items()},
    }


def _swept_points(sweep: SweepSpecification) -> dict[str, np.ndarray]:
    swept, count = sweep.swept, sweep.design_count
    points, seed = sweep.points or 0, sweep.seed
    if sweep.design == "grid":
        levels = [item.levels() for item in swept.values()]
        places = np.unravel_index(np.arange(count), [*map(len, levels)]) if levels else ()
        return {name: values[at] for name, values, at in zip(swept, levels, places, strict=True)}
    if sweep.design == "saltelli":
        shares = saltelli_shares(len(swept), points, seed).reshape(count, len(swept))
    elif sweep.design == "sobol":
        # Every version of SciPy accepts a generator by this name.
        sequence = qmc.Sobol(len(swept), seed=np.random.default_rng(seed))
        shares = sequence.random_base2(points.bit_length() - 1)
    else:
        shares = qmc.LatinHypercube(len(swept), seed=np.random.default_rng(seed)).random(count)
    return {name: item.at(shares[:, i]) for i, (name, item) in enumerate(swept.items())}


def make_chunks(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> Iterator[SweepChunk]:
    size = chunk_size(sweep)
    versions = engine_versions()
    for number in range(chunk_count(sweep)):
        first = number * size
        count = min(size, sweep.simulations - first)
        begin = first // sweep.repeat
        end = -(-(first + count) // sweep.repeat)
        own = {name: values[begin:end] for name, values in points.items()}
        yield SweepChunk(number, first, count, sweep, own, versions)


def simulate(chunk: SweepChunk) -> SweepOutcome:
    check_versions(chunk.versions)
    sweep = chunk.specification
    rows: list[dict[str, Any]] = []
    bags = {}
    for number, point, members in chunk.ensembles():
        seed = sweep.point_seed(number, point)
        phases = initial_phases(sweep.repeat, seed)[members.start : members.stop]
        runs = [sweep.plan_run(number, point, member) for member in members]
        found = _ensemble(sweep, point, runs, phases)
        for member, run, phase, (figures, failure) in zip(
            members, runs, phases, found, strict=True
        ):
            row = {"point": number, "member": member, "seed": seed, "phase": phase, **point}
            row |= {**run.labels(), **figures, "failure": failure}
            if sweep.bags and failure is None:
                row["bag"] = f"bags/{run.name}"
                bags[row["bag"]] = _record_bag(sweep, point, run, phase)
            rows.append(row)
    return SweepOutcome(pa.Table.from_pylist(rows, _schema(chunk)), bags)


def _schema(chunk: SweepChunk) -> pa.Schema:
    """Return the columns of a table of simulations, with their types."""
    sweep = chunk.specification
    whole, number, text = pa.int64(), pa.float64(), pa.string()
    labels = {"kind": text, "channel": text, "magnitude": number, "unit": text}
    types = {
        "point": whole,
        "member": whole,
        "seed": whole,
        "phase": number,
        **{name: pa.array(values).type for name, values in chunk.points.items()},
        **({**labels, "onset": number, "clear": number} if sweep.faults else {}),
        **{name: whole if name in _COUNTS else number for name in sweep.figures},
        "failure": text,
        **({"bag": text} if sweep.bags else {}),
    }
    return pa.schema(list(types.items()))


def _ensemble(
    sweep: SweepSpecification,
    point: Mapping[str, Any],
    runs: Sequence[PlannedRun],
    phases: Sequence[float],
) -> list[tuple[Figures, str | None]]:
    """Return the figures of each member, or why it has none; it does not affect the others."""
    # Members without a fault go together, which is faster. Each fault has its own times.
    alone = bool(runs[0].faults)
    groups = [slice(i, i + 1) for i in range(len(runs))] if alone else [slice(None)]
    try:
        drill, planned = sweep.configuration(point), sweep.planned(point)
        found = [
            member
            for group in groups
            for member in run_members(
                drill,
                sweep.duration,
                phases[group],
                planned=(*runs[group][0].faults, *planned),
            )
        ]
    except ParameterError as error:
        return [({}, str(error)) for _ in runs]
    return [
        (member.figures, " ".join(str(member.failure).split()) if member.failure else None)
        for member in found
    ]


def _record_bag(
    sweep: SweepSpecification, point: Mapping[str, Any], run: PlannedRun, phase: float
) -> dict[str, bytes]:
    """Simulate a run; return the files of its bag by name."""
    beginning = Beginning(sweep.settings(point), phase, run.seed, run.faults)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / run.name
        write_offline_bag(
            path,
            Plan(beginning, sweep.planned(point)),
            sweep.duration,
            topics=sweep.bag_topics,
            manifest=Manifest(
                parameters={**beginning.settings.values(), "seed": run.seed},
                scenario=run.scenario_text,
                # Nothing of the worker: any worker makes the same bytes.
                command=("rpud", "sweep"),
                versions=installed_versions(),
                machine=platform.machine(),
            ),
        )
        return {file.name: file.read_bytes() for file in sorted(path.iterdir())}
