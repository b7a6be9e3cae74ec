"""Making of a data set, from its specification to its tables."""

from __future__ import annotations

import contextlib
import dataclasses
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.studies.dataset.folder import DatasetFolder
from rpud_sim.studies.dataset.recording import make_jobs, record
from rpud_sim.studies.dataset.specification import Specification
from rpud_sim.studies.workers import run_on_workers


@dataclasses.dataclass(frozen=True)
class DatasetResult:
    """Result of making a data set."""

    folder: Path  # with all files
    content: dict[str, Any]  # of its ``dataset.json``
    run: int  # number of runs that this call simulated
    kept: int  # number that earlier calls had simulated


def make_dataset(
    specification: Specification,
    out: Path,
    workers: int,
    scheduler: str | None = None,
    report: Callable[[int], None] = lambda runs: None,
) -> DatasetResult:
    """Simulate those runs of a data set that are missing in its folder, and complete the folder.

    Args:
        out: its folder; new, or left by an earlier call for the same data set.
        scheduler: address of a Dask cluster to use instead of local processes.
        report: called with the number of runs that finished since its last call.

    Raises:
        DatasetError: if the folder holds anything else.
        WorkerError: if the workers fail.
        OSError: if a file cannot be written.
    """
    folder = DatasetFolder(out, specification)
    with folder.held():
        finished = folder.finished()
        report(len(finished))
        missing = len(folder.runs) - len(finished)
        if missing:
            jobs = make_jobs(specification, folder.runs, finished)

            def compile_first() -> None:
                first = folder.runs[0].beginning(specification).settings.configuration
                compile_kernels(first, messages=True)

            outcomes = run_on_workers(record, jobs, workers, scheduler, compile_first)
            with contextlib.closing(outcomes):
                for job, recorded in outcomes:
                    folder.add(job, recorded)
                    report(1)
        return DatasetResult(out, folder.join(), missing, len(finished))
