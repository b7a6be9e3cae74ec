"""Run of a sweep, from its specification to its tables and its page."""

from __future__ import annotations

import contextlib
import dataclasses
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.simulation.ensemble import compile_kernels, compile_members
from rpud_sim.studies.sweep.chunks import chunk_size, make_chunks, simulate
from rpud_sim.studies.sweep.design import design_points
from rpud_sim.studies.sweep.folder import SweepFolder
from rpud_sim.studies.sweep.indices import figure_indices
from rpud_sim.studies.sweep.specification import SweepSpecification
from rpud_sim.studies.sweep.sweep_report import sweep_page
from rpud_sim.studies.workers import run_on_workers

REPORT = "report.html"
INDICES = "indices.json"


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
    specification: SweepSpecification,
    out: Path,
    workers: int,
    scheduler: str | None = None,
    report: Callable[[int], None] = lambda simulations: None,
) -> SweepResult:
    """Run those simulations of a sweep that are missing in its folder, and complete the folder.

    Args:
        out: its folder; new, or left by an earlier call of the same sweep.
        scheduler: address of a Dask cluster to use instead of local processes.
        report: called with the number of simulations that finished since its last call.

    Raises:
        SweepError: if the folder holds anything else.
        WorkerError: if the workers fail.
        OSError: if a file cannot be written.
    """
    folder = SweepFolder(out, specification)
    with folder.held():
        finished = folder.finished()
        kept = _kept(specification, finished)
        report(kept)
        if len(finished) < folder.manifest["chunks"]:
            points = design_points(specification)
            chunks = make_chunks(specification, points, finished)

            def compile_first() -> None:
                first = {name: values[0].item() for name, values in points.items()}
                drill = specification.configuration(first)
                compile_members(drill)
                if specification.faults or specification.bags:
                    compile_kernels(drill, messages=bool(specification.bags))

            outcomes = run_on_workers(simulate, chunks, workers, scheduler, compile_first)
            with contextlib.closing(outcomes):
                for chunk, outcome in outcomes:
                    folder.add(chunk, outcome)
                    report(chunk.count)
        folder.complete_tables()
        indices = {}
        if specification.design == "saltelli":
            indices = figure_indices(specification, folder.points())
            with whole_file(out / INDICES) as unfinished:
                unfinished.write_text(json.dumps(indices, indent=2) + "\n", encoding="utf-8")
        page = sweep_page(specification, folder.points(), folder.failures(), indices)
        with whole_file(out / REPORT) as unfinished:
            unfinished.write_text(page, encoding="utf-8")
        return SweepResult(
            out,
            folder.manifest,
            specification.simulations - kept,
            kept,
            folder.failures(),
            out / REPORT,
            indices,
        )


def _kept(specification: SweepSpecification, finished: frozenset[int]) -> int:
    size = chunk_size(specification)
    return sum(min(size, specification.simulations - number * size) for number in finished)
