"""Folder of a sweep: its manifest, its finished chunks, and the tables of their results.

A file appears when it is complete, so that a sweep can be killed at any time. While a sweep runs,
its process locks the folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from rpud_sim.foundation.whole_folder import whole_file, whole_folder
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.held_folder import held_folder
from rpud_sim.studies.sweep.chunks import Chunk, Outcome, chunk_count, chunk_size
from rpud_sim.studies.sweep.specification import SweepError, SweepSpecification
from rpud_sim.studies.sweep.tables import PointTables, simulation_table

SIMULATIONS = "simulations.parquet"
POINTS = "points.parquet"
_CHUNKS = "chunks"
_TOGETHER = 8  # chunks in one group of rows of a table: each group takes its time


def make_manifest(specification: SweepSpecification) -> dict[str, Any]:
    """Return the specification, versions and sizes of a sweep, with a digest; no host is in it."""
    # What draws the design and writes the files.
    writers = ("scipy", "pyarrow", *(("mcap", "zstandard") if specification.bags else ()))
    depends = {
        "specification": specification.content(),
        "versions": engine_versions() | {name: version_of(name) for name in writers},
    }
    text = json.dumps(depends, sort_keys=True)
    return depends | {
        "points": specification.point_count,
        "simulations": specification.simulations,
        "chunks": chunk_count(specification),
        "sha256": hashlib.sha256(text.encode()).hexdigest(),
    }


class SweepFolder:
    """Files of one sweep."""

    def __init__(self, path: Path, specification: SweepSpecification) -> None:
        self.path = path
        self.manifest = make_manifest(specification)
        self._specification = specification

    def held(self) -> contextlib.AbstractContextManager[None]:
        """Create or open the folder, and lock it against other processes; see ``held_folder``.

        Raises:
            SweepError: if it is locked or holds anything but this sweep; nothing is changed then.
            OSError: if it cannot be created.
        """
        return held_folder(self.path, self.manifest, "sweep", SweepError)

    @property
    def complete(self) -> bool:
        """Whether both tables exist."""
        return all((self.path / name).exists() for name in (SIMULATIONS, POINTS))

    def finished(self) -> frozenset[int]:
        """Return the numbers of the finished chunks."""
        if self.complete:
            return frozenset(range(self.manifest["chunks"]))
        return frozenset(
            number for number in range(self.manifest["chunks"]) if self._is_complete(number)
        )

    def add(self, chunk: Chunk, outcome: Outcome) -> None:
        """Write the bags of a chunk, then its file.

        The file is in Arrow's own format: Parquet would take most of the time that a sweep spends
        on a chunk of a worker, and the file lasts no longer than the sweep.
        """
        table = simulation_table(chunk, outcome)
        for files, name in zip(outcome.bags, self._bags(table), strict=True):
            if name is not None:
                self._write_bag(self.path / name, files)
        path = self._chunk_path(chunk.number)
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as unfinished, pa.ipc.new_file(unfinished, table.schema) as file:
            file.write_table(table)

    def _write_bag(self, path: Path, files: Mapping[str, bytes]) -> None:
        """Write a bag, in place of one that a killed call left without its chunk."""
        for old in (path, path.with_name(f"{path.name}.part")):
            shutil.rmtree(old, ignore_errors=True)
        with whole_folder(path) as folder:
            for name, content in files.items():
                with whole_file(folder / name) as unfinished:
                    unfinished.write_bytes(content)

    def complete_tables(self) -> None:
        """Write both tables from the chunks, a few at a time in their order, and remove them."""
        if not self.complete:
            tables = PointTables(self._specification)
            with (
                whole_file(self.path / SIMULATIONS) as simulations,
                whole_file(self.path / POINTS) as points,
                _Writer(simulations) as all_simulations,
                _Writer(points) as all_points,
            ):
                count = self.manifest["chunks"]
                for first in range(0, count, _TOGETHER):
                    numbers = range(first, min(first + _TOGETHER, count))
                    table = pa.concat_tables([_rows(self._chunk_path(each)) for each in numbers])
                    all_simulations.write(table)
                    all_points.write(tables.add(table))
        shutil.rmtree(self.path / _CHUNKS, ignore_errors=True)

    def failures(self) -> int:
        """Return how many simulations gave no figures."""
        file = pq.ParquetFile(self.path / SIMULATIONS)
        return sum(
            len(batch) - batch.column(0).null_count
            for batch in file.iter_batches(columns=["failure"])
        )

    def points(self) -> Mapping[str, Any]:
        """Return the table of points, by column."""
        with pq.ParquetFile(self.path / POINTS) as file:  # read_table imports pandas
            table = file.read()
        return {name: table[name].to_numpy() for name in table.column_names}

    def _chunk_path(self, number: int) -> Path:
        return self.path / _CHUNKS / f"{number:08}.arrow"

    def _is_complete(self, number: int) -> bool:
        """Whether a chunk's file has all rows, and its bags are there.

        The machine may have lost power while writing them.
        """
        size = chunk_size(self._specification)
        rows = min(size, self._specification.simulations - number * size)
        try:
            table = _rows(self._chunk_path(number))
            bags = [name for name in self._bags(table) if name is not None]
            return len(table) == rows and all((self.path / name).is_dir() for name in bags)
        except (OSError, pa.ArrowInvalid):
            return False

    def _bags(self, table: pa.Table) -> list[str | None]:
        """Return the path of each simulation's bag in the folder; None without one."""
        if not self._specification.bags:
            return [None] * len(table)
        names: list[str | None] = table["bag"].to_pylist()
        return names


def _rows(path: Path) -> pa.Table:
    """Return all rows of a chunk's file."""
    with pa.memory_map(str(path)) as mapped, pa.ipc.open_file(mapped) as file:
        return file.read_all()


class _Writer:
    """Parquet file with the columns of the first table."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._writer: pq.ParquetWriter | None = None

    def __enter__(self) -> _Writer:
        return self

    def __exit__(self, *failure: object) -> None:
        if self._writer is not None:
            self._writer.close()

    def write(self, table: pa.Table) -> None:
        """Add the rows of a table."""
        if self._writer is None:
            self._writer = pq.ParquetWriter(self._path, table.schema)
        if table.num_rows:
            self._writer.write_table(table)
