"""Run of a sweep in its folder: finished chunks, the tables of all results, and the page."""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from rpud_sim.foundation.whole_folder import whole_file, whole_folder, write_whole
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.store import Report, StudyStore
from rpud_sim.studies.sweep.chunks import (
    SweepChunk,
    SweepOutcome,
    chunk_count,
    design_points,
    make_chunks,
    simulate,
)
from rpud_sim.studies.sweep.indices import figure_indices
from rpud_sim.studies.sweep.specification import SweepSpecification
from rpud_sim.studies.sweep.sweep_page import error_name, sweep_page

_CHUNKS = "chunks"
_TABLES = ("simulations.parquet", "points.parquet")
_TOGETHER = 8  # chunks in one group of rows of a table: each group takes its time


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
            write_whole(out / "indices.json", json.dumps(indices, indent=2) + "\n")
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
    text = json.dumps(depends, sort_keys=True)
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
            held = None  # rows of a point that is not complete yet
            repeat, count = self._specification.repeat, chunk_count(self._specification)
            with (
                whole_file(self._simulations) as simulations,
                whole_file(self._points) as points,
                contextlib.ExitStack() as stack,
            ):
                writers: list[pq.ParquetWriter] = []
                for first in range(0, count, _TOGETHER):
                    numbers = range(first, min(first + _TOGETHER, count))
                    table = pa.concat_tables([_rows(self._chunk_path(each)) for each in numbers])
                    rows = table if held is None else pa.concat_tables([held, table])
                    whole = rows.num_rows // repeat * repeat
                    # A copy: a slice would keep the rows before it in memory.
                    held = rows.take(pa.array(range(whole, rows.num_rows), pa.int64()))
                    tables = table, point_table(self._specification, rows.slice(0, whole))
                    if not writers:
                        paths = zip((simulations, points), tables, strict=True)
                        writers = [
                            stack.enter_context(pq.ParquetWriter(path, each.schema))
                            for path, each in paths
                        ]
                    for writer, each in zip(writers, tables, strict=True):
                        if each.num_rows:
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
