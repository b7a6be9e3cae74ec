"""Sweep: its chunks of work, the folder with their outcomes, and the tables of all results.

Simulations are numbered point by point. The ensemble at a point is that of ``rpud simulate
--repeat REPEAT --seed SEED`` with the point's own seed, so that any point can be repeated. A chunk
is the unit of work, and the most that a lost worker costs.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import platform
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.stats import qmc

from rpud_sim.bag.metadata import Manifest, installed_versions
from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.whole_folder import whole_file, whole_folder, write_whole
from rpud_sim.recorded.offline_bag import write_offline_bag
from rpud_sim.simulation.ensemble import compile_kernels, run_members
from rpud_sim.simulation.plan import Beginning, Plan, initial_phases
from rpud_sim.simulation.statistics import Figures
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.store import Report, StudyStore
from rpud_sim.studies.sweep.specification import PlannedRun, SweepSpecification, error_name
from rpud_sim.studies.sweep.sweep_report import figure_indices, sweep_page
from rpud_sim.studies.workers import check_versions

_CHUNKS = "chunks"
_TABLES = ("simulations.parquet", "points.parquet")
_TOGETHER = 8  # chunks in one group of rows of a table: each group takes its time

# A chunk takes about a quarter of a second: much longer than sending and writing it, and short
# enough to lose. Small sweeps are cut finer, so that several workers have work. The size depends on
# the specification alone, since a folder may be completed on another machine.
_LONGEST, _SHORTEST = 600.0, 10.0  # simulated [s]
_MOST = 3072  # simulations
_WANTED = 32  # chunks of a small sweep
_COUNTS = ("events",)  # figures that are whole numbers


@dataclasses.dataclass(frozen=True)
class SweepChunk:
    """All simulations at consecutive points of a sweep."""

    number: int  # of the chunk
    first: int  # number of the first point
    specification: SweepSpecification  # of the sweep
    points: Mapping[str, np.ndarray]  # values of the axes at its points
    versions: Mapping[str, str]  # of everything that determines the results

    @property
    def count(self) -> int:
        """Number of simulations."""
        return len(next(iter(self.points.values()))) * self.specification.repeat


class SweepOutcome(NamedTuple):
    """Results of the simulations of a chunk."""

    table: pa.Table  # a row each; missing figures and labels are null
    bags: Mapping[str, Mapping[str, bytes]]  # files by name, by the path of the bag in the folder


def chunk_points(sweep: SweepSpecification) -> int:
    """Return the number of points in a chunk; the last one may have fewer."""
    whole = sweep.simulations * sweep.duration
    # Messages take much longer than the simulation, and bags stay in memory until they are written.
    longest = _SHORTEST if sweep.bags else _LONGEST
    simulated = min(max(whole / _WANTED, _SHORTEST), longest)
    return max(round(min(simulated / sweep.duration, _MOST) / sweep.repeat), 1)


def chunk_count(sweep: SweepSpecification) -> int:
    return -(-sweep.point_count // chunk_points(sweep))


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


def saltelli_shares(inputs: int, samples: int, seed: int) -> np.ndarray:
    """Return the points of Saltelli's design in the unit cube; ``samples`` is a power of two.

    Shape (inputs + 3, samples, inputs): the matrices A and B, for each input A with that input's
    column of B, and A again.
    """
    # Every version of SciPy accepts a generator by this name.
    sequence = qmc.Sobol(2 * inputs, seed=np.random.default_rng(seed))
    both = sequence.random_base2(samples.bit_length() - 1)
    a, b = both[:, :inputs], both[:, inputs:]
    mixed = np.repeat(a[np.newaxis], inputs + 1, axis=0)
    for column in range(inputs):
        mixed[column, :, column] = b[:, column]
    return np.array([a, b, *mixed])


def make_chunks(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> Iterator[SweepChunk]:
    size, versions = chunk_points(sweep), engine_versions()
    for number in range(chunk_count(sweep)):
        first = number * size
        own = {name: values[first : first + size] for name, values in points.items()}
        yield SweepChunk(number, first, sweep, own, versions)


def simulate(chunk: SweepChunk) -> SweepOutcome:
    check_versions(chunk.versions)
    sweep = chunk.specification
    rows: list[dict[str, Any]] = []
    bags = {}
    columns = (values.tolist() for values in chunk.points.values())
    for number, values in enumerate(zip(*columns, strict=True), chunk.first):
        point = dict(zip(chunk.points, values, strict=True))
        seed = sweep.point_seed(number, point)
        phases = initial_phases(sweep.repeat, seed)
        runs = [sweep.plan_run(number, point, member) for member in range(sweep.repeat)]
        found = _ensemble(sweep, point, runs, phases)
        for member, (run, phase, (figures, failure)) in enumerate(
            zip(runs, phases, found, strict=True)
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


@dataclasses.dataclass(frozen=True)
class SweepResult:
    """Result of a sweep."""

    folder: Path  # with all files
    manifest: dict[str, Any]  # of the sweep
    simulations: int  # number that this call ran
    kept: int  # number that earlier calls had run
    failures: int  # number of simulations without figures
    report: Path  # file of the page
    indices: dict[str, Any]  # of the figures; empty in other designs than Saltelli's


def run_sweep(
    sweep: SweepSpecification,
    out: Path,
    workers: int,
    scheduler: str | None = None,
    report: Report = lambda runs: None,
) -> SweepResult:
    """Run those simulations of a sweep that are missing in its folder, and complete the folder.

    The folder is new, or left by an earlier call of the same sweep. ``scheduler`` is the address of
    a Dask cluster to use instead of local processes.
    """
    folder = SweepFolder(out, sweep, report)
    points = design_points(sweep)

    def prepare() -> None:  # each process of this machine would compile the same
        if scheduler is None:
            drill = sweep.configuration({name: each[0].item() for name, each in points.items()})
            compile_kernels(drill, messages=bool(sweep.bags))

    with folder.held():
        folder.finish(make_chunks(sweep, points), simulate, prepare, workers, scheduler)
        folder.complete_tables()
        table, failures = folder.points(), folder.failures()
        indices = {}
        if sweep.design == "saltelli":
            indices = figure_indices(sweep, table)
            write_whole(out / "indices.json", json_text(indices, indent=2) + "\n")
        page = out / "report.html"
        write_whole(page, sweep_page(sweep, table, failures, indices))
        runs = folder.simulated, folder.kept
        return SweepResult(out, folder.manifest, *runs, failures, page, indices)


def make_manifest(sweep: SweepSpecification) -> dict[str, Any]:
    """Return the specification, versions and sizes of a sweep, with a digest; no host is in it."""
    # What draws the design and writes the files.
    writers = ("scipy", "pyarrow", *(("mcap", "zstandard") if sweep.bags else ()))
    depends = {
        "specification": dataclasses.asdict(sweep),
        "versions": engine_versions() | {name: version_of(name) for name in writers},
    }
    text = json_text(depends, sort_keys=True)
    return depends | {
        "points": sweep.point_count,
        "simulations": sweep.simulations,
        "chunks": chunk_count(sweep),
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
    }


class SweepFolder(StudyStore[SweepChunk, SweepOutcome]):
    """Folder of a sweep: its finished chunks, and the tables of their results."""

    def __init__(
        self, path: Path, sweep: SweepSpecification, report: Report = lambda runs: None
    ) -> None:
        super().__init__(path, make_manifest(sweep), "sweep", report)
        self._specification = sweep
        self._simulations, self._points = (path / name for name in _TABLES)

    @property
    def complete(self) -> bool:
        return self._simulations.exists() and self._points.exists()

    def has(self, chunk: SweepChunk) -> bool:
        if self.complete:
            return True
        try:
            table = _rows(self._chunk_path(chunk.number))
        except (OSError, pa.ArrowInvalid):
            return False
        bags = table["bag"].drop_null().to_pylist() if self._specification.bags else []
        return len(table) == chunk.count and all((self.path / name).is_dir() for name in bags)

    def add(self, chunk: SweepChunk, outcome: SweepOutcome) -> None:
        """Write the bags of a chunk, then its file.

        The file is in Arrow's own format: Parquet would take most of the time that a sweep spends
        on a chunk of a worker, and the file lasts no longer than the sweep.
        """
        for name, files in outcome.bags.items():
            bag = self.path / name
            for left in (bag, bag.with_name(f"{bag.name}.part")):  # by a killed call
                shutil.rmtree(left, ignore_errors=True)
            with whole_folder(bag) as folder:
                for file, content in files.items():
                    write_whole(folder / file, content)
        path = self._chunk_path(chunk.number)
        path.parent.mkdir(exist_ok=True)
        table = outcome.table
        with whole_file(path) as unfinished, pa.ipc.new_file(unfinished, table.schema) as file:
            file.write_table(table)

    def complete_tables(self) -> None:
        """Write both tables from the chunks, a few at a time in their order, and remove them."""
        if not self.complete:
            count = chunk_count(self._specification)
            with (
                whole_file(self._simulations) as simulations,
                whole_file(self._points) as points,
                contextlib.ExitStack() as stack,
            ):
                writers: list[pq.ParquetWriter] = []
                for first in range(0, count, _TOGETHER):
                    numbers = range(first, min(first + _TOGETHER, count))
                    table = pa.concat_tables([_rows(self._chunk_path(each)) for each in numbers])
                    tables = table, point_table(self._specification, table)
                    if not writers:
                        paths = zip((simulations, points), tables, strict=True)
                        writers = [
                            stack.enter_context(pq.ParquetWriter(path, each.schema))
                            for path, each in paths
                        ]
                    for writer, each in zip(writers, tables, strict=True):
                        writer.write_table(each)
        shutil.rmtree(self.path / _CHUNKS, ignore_errors=True)

    def failures(self) -> int:
        """Return how many simulations gave no figures."""
        batches = pq.ParquetFile(self._simulations).iter_batches(columns=["failure"])
        return sum(len(batch) - batch.column(0).null_count for batch in batches)

    def points(self) -> Mapping[str, Any]:
        """Return the table of points, by column."""
        with pq.ParquetFile(self._points) as file:  # read_table imports pandas
            table = file.read()
        return {name: table[name].to_numpy() for name in table.column_names}

    def _chunk_path(self, number: int) -> Path:
        return self.path / _CHUNKS / f"{number:08}.arrow"


def _rows(path: Path) -> pa.Table:
    with pa.memory_map(str(path)) as mapped, pa.ipc.open_file(mapped) as file:
        return file.read_all()


def point_table(sweep: SweepSpecification, table: pa.Table) -> pa.Table:
    """Return the rows of points from those of all their simulations."""
    repeat, names = sweep.repeat, sweep.figures
    firsts = np.arange(0, table.num_rows, repeat)
    columns: dict[str, pa.Array | pa.ChunkedArray] = {
        name: table[name].take(pa.array(firsts)) for name in ("point", "seed", *sweep.axes)
    }
    figures = np.column_stack(
        [table[name].to_numpy().astype(np.float64) for name in names]
    ).reshape(len(firsts), repeat, len(names))
    valid = ~np.isnan(figures)
    count = valid.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(valid, figures, 0.0).sum(axis=1) / count
        squares = np.where(valid, (figures - mean[:, None]) ** 2, 0.0).sum(axis=1)
        error = np.sqrt(squares / (count - 1) / count)
    failed = table["failure"].is_valid().to_numpy().reshape(-1, repeat)
    columns["members"] = pa.array(repeat - failed.sum(axis=1))
    for i, name in enumerate(names):
        columns[name] = pa.array(mean[:, i], mask=count[:, i] == 0)
        columns[error_name(name)] = pa.array(error[:, i], mask=count[:, i] < 2)
    return pa.table(columns)
