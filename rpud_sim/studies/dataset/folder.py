"""Folder of a data set: its manifest, its finished runs, and the tables that are joined from them.

A file or folder appears when it is complete, so that the work can be killed at any time. While the
work goes on, its process locks the folder.
"""

from __future__ import annotations

import contextlib
import hashlib
import json
import shutil
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.whole_folder import whole_file, whole_folder
from rpud_sim.simulation.versions import PHYSICS, engine_versions, version_of
from rpud_sim.studies.dataset import NOTICE
from rpud_sim.studies.dataset.card import make_card
from rpud_sim.studies.dataset.plan import PlannedRun, plan_runs
from rpud_sim.studies.dataset.recording import Job, Recorded
from rpud_sim.studies.dataset.specification import SPLITS, DatasetError, Specification
from rpud_sim.studies.dataset.tables import WINDOWS
from rpud_sim.studies.held_folder import held_folder

CONTENT = "dataset.json"
CARD = "README.md"
RUNS = "runs"
BAGS = "bags"
_PARTS = "parts"
_ACCOUNT = "run.json"


class DatasetFolder:
    """Files of one data set."""

    def __init__(self, path: Path, specification: Specification) -> None:
        self.path = path
        self.runs = plan_runs(specification)  # as they are planned
        self._specification = specification
        self._manifest = {
            "notice": NOTICE,
            "specification": specification.content(),
            "physics": PHYSICS,
            # The engine, and what writes the files.
            "versions": engine_versions()
            | {name: version_of(name) for name in ("pyarrow", "mcap", "zstandard")},
        }

    def held(self) -> contextlib.AbstractContextManager[None]:
        """Create or open the folder, and lock it against other processes; see ``held_folder``.

        Raises:
            DatasetError: if it is locked or holds anything but this data set.
            OSError: if it cannot be created.
        """
        return held_folder(self.path, self._manifest, "dataset", DatasetError)

    @property
    def complete(self) -> bool:
        """Whether all files exist."""
        return (self.path / CONTENT).exists()

    def finished(self) -> frozenset[int]:
        """Return the numbers of the finished runs; delete what is left of unfinished ones."""
        if self.complete:
            return frozenset(run.number for run in self.runs)
        return frozenset(run.number for run in self.runs if self._is_whole(run))

    def add(self, job: Job, recorded: Recorded) -> None:
        """Write the files of a run; the part that shows that it is finished comes last."""
        run = job.run
        digests = {}
        if recorded.bag:
            with whole_folder(self._bag(run)) as folder:
                for name, content in recorded.bag.items():
                    (folder / name).write_bytes(content)
                    digests[f"{BAGS}/{run.split}/{run.name}/{name}"] = _digest(content)
        with whole_folder(self._part(run)) as folder:
            for name, content in recorded.tables.items():
                (folder / f"{name}.parquet").write_bytes(content)
                digests[f"{_PARTS}/{run.name}/{name}.parquet"] = _digest(content)
            account = {"failure": recorded.failure, "files": digests}
            (folder / _ACCOUNT).write_text(json.dumps(account) + "\n", encoding="utf-8")

    def join(self) -> dict[str, Any]:
        """Write the tables from the parts of the runs, then the rest; return ``dataset.json``."""
        if not self.complete:
            accounts = {run.name: self._account(run) for run in self.runs}
            files = {
                name: digest
                for account in accounts.values()
                for name, digest in account["files"].items()
                if name.startswith(f"{BAGS}/")
            }
            failures = {name: account["failure"] for name, account in accounts.items()}
            for split in SPLITS:
                runs = [run for run in self.runs if run.split == split]
                whole = [run for run in runs if not failures[run.name]]
                for table in (WINDOWS, *self._specification.topics):
                    self._join(table, split, whole, files)
                tables = [_run_table(runs, failures, self._specification)]
                self._write(f"{RUNS}/{split}.parquet", iter(tables), files)
            card = make_card(self._specification, self.runs)
            with whole_file(self.path / CARD) as unfinished:
                unfinished.write_text(card, encoding="utf-8")
            files[CARD] = _digest(card.encode())
            content = self._content(failures) | {"files": dict(sorted(files.items()))}
            with whole_file(self.path / CONTENT) as unfinished:
                unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
        shutil.rmtree(self.path / _PARTS, ignore_errors=True)
        return read_content(self.path)

    def _content(self, failures: Mapping[str, str]) -> dict[str, Any]:
        specification = self._specification
        return {
            "synthetic": True,
            "notice": NOTICE,
            "version": version_of("rpud_sim"),
            "physics": PHYSICS,
            "seed": specification.seed,
            "runs": len(self.runs),
            "failures": sum(map(bool, failures.values())),
            "splits": {
                split: {
                    "rocks": [n for n, rock in specification.rocks.items() if rock.split == split],
                    "runs": sum(run.split == split for run in self.runs),
                }
                for split in SPLITS
            },
            "specification": self._manifest["specification"],
            "versions": self._manifest["versions"],
        }

    def _join(self, table: str, split: str, runs: list[PlannedRun], files: dict[str, str]) -> None:
        parts = (self._part(run) / f"{table}.parquet" for run in runs)
        self._write(f"{table}/{split}.parquet", map(_read, parts), files)

    def _write(self, name: str, tables: Iterator[pa.Table], files: dict[str, str]) -> None:
        path = self.path / name
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as unfinished:
            writer = None
            for table in tables:
                if writer is None:
                    writer = pq.ParquetWriter(unfinished, table.schema, compression="zstd")
                if table.num_rows:
                    writer.write_table(table)
            if writer is None:  # every run of the split failed
                writer = pq.ParquetWriter(unfinished, pa.schema([]))
            writer.close()
        files[name] = _digest(path.read_bytes())

    def _is_whole(self, run: PlannedRun) -> bool:
        """Whether all files of a run have their digests: the machine may have lost power."""
        try:
            files = self._account(run)["files"]
            whole = all(
                _digest((self.path / name).read_bytes()) == digest for name, digest in files.items()
            )
        except (OSError, ValueError, LookupError, TypeError):
            whole = False
        if not whole:
            for path in (self._bag(run), self._part(run)):
                shutil.rmtree(path, ignore_errors=True)
                shutil.rmtree(path.with_name(f"{path.name}.part"), ignore_errors=True)
        return whole

    def _account(self, run: PlannedRun) -> dict[str, Any]:
        account: dict[str, Any] = json.loads(
            (self._part(run) / _ACCOUNT).read_text(encoding="utf-8")
        )
        return account

    def _bag(self, run: PlannedRun) -> Path:
        return self.path / BAGS / run.split / run.name

    def _part(self, run: PlannedRun) -> Path:
        return self.path / _PARTS / run.name


def read_content(path: Path) -> dict[str, Any]:
    """Return the content of a data set's ``dataset.json``.

    Raises:
        DatasetError: if the folder holds no complete data set.
    """
    try:
        content = json.loads((path / CONTENT).read_text(encoding="utf-8"))
    except OSError as error:
        raise DatasetError(f"{path}: holds no complete data set: {error.strerror}") from None
    except ValueError:
        content = None
    if not (isinstance(content, dict) and isinstance(content.get("files"), dict)):
        raise DatasetError(f"{path / CONTENT}: is not of a data set")
    return content


def read_table(path: Path, name: str, content: Mapping[str, Any]) -> pa.Table:
    """Return a table of a data set, such as ``windows/test.parquet``.

    Raises:
        DatasetError: if it is missing, or not the one that was written.
    """
    try:
        data = (path / name).read_bytes()
    except OSError as error:
        raise DatasetError(f"{path / name}: {error.strerror}") from None
    if _digest(data) != content["files"].get(name):
        raise DatasetError(f"{path / name}: is not the file whose digest {CONTENT} has")
    return pq.read_table(pa.BufferReader(data))


def _run_table(
    runs: list[PlannedRun], failures: Mapping[str, str], specification: Specification
) -> pa.Table:
    """Return the table of the runs of a split, with their exact labels."""
    columns: dict[str, pa.Array] = {
        name: pa.array([getattr(run, name) for run in runs], kind)
        for name, kind in (
            ("name", pa.string()),
            ("split", pa.string()),
            ("rock", pa.string()),
            ("kind", pa.string()),
            ("channel", pa.string()),
            ("severity", pa.uint8()),
            ("magnitude", pa.float64()),
            ("unit", pa.string()),
        )
    }
    for name in ("onset", "clear"):
        times = [getattr(run, name) for run in runs]
        seconds = [None if time is None else time / SECOND for time in times]
        columns[name] = pa.array(seconds, pa.float64())
        columns[f"{name}_ns"] = pa.array(times, pa.int64())
    columns["duration"] = pa.array([specification.duration] * len(runs), pa.float64())
    columns["seed"] = pa.array([run.seed for run in runs], pa.int64())
    columns["initial_phase"] = pa.array([run.initial_phase for run in runs], pa.float64())
    for name in specification.varied:
        columns[name] = pa.array([run.values[name] for run in runs], pa.float64())
    columns["bag"] = pa.array(
        [None if failures[run.name] else f"{BAGS}/{run.split}/{run.name}" for run in runs],
        pa.string(),
    )
    columns["failure"] = pa.array([failures[run.name] or None for run in runs], pa.string())
    table = pa.table({"run" if name == "name" else name: c for name, c in columns.items()})
    return table.replace_schema_metadata({"rpud_sim": json.dumps({"notice": NOTICE})})


def _read(path: Path) -> pa.Table:
    return pq.read_table(path)


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()
