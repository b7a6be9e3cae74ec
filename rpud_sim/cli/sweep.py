"""``rpud sweep``: design of experiments over any parameters, on all cores or a cluster."""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rpud_sim.cli.options import (
    add_json_argument,
    add_scheduler_argument,
    add_workers_argument,
    worker_count,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import printable

HELP = "run a design of experiments over parameters, rocks and faults"
_CAUSES = 3  # inputs of a figure in the table; the page and indices.json have all
EXAMPLE = "rpud sweep config/sweep.yaml --out sweeps/first"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", metavar="SPEC", help="the sweep, such as config/sweep.yaml")
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for tables and a page; finished parts of an earlier call are kept",
    )
    where = parser.add_mutually_exclusive_group()
    add_workers_argument(where)
    add_scheduler_argument(where)
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.sweep.specification import SweepError
    from rpud_sim.studies.sweep.specification_file import read_specification
    from rpud_sim.studies.workers import WorkerError

    started = time.perf_counter()
    with failing(SweepError, code=ExitCode.USAGE), failing(WorkerError):
        specification = read_specification(arguments.spec)
        from rpud_sim.studies.sweep.sweep import run_sweep

        with progress_bar(" simulations", specification.simulations) as bar:
            result = run_sweep(
                specification,
                Path(arguments.out),
                worker_count(arguments),
                arguments.scheduler,
                bar.update,
            )
    wall = time.perf_counter() - started
    if arguments.json:
        print_json(
            {
                "out": str(result.folder),
                **result.manifest,
                "run": result.simulations,
                "kept": result.kept,
                "failures": result.failures,
                "report": str(result.report),
                **({"indices": result.indices} if result.indices else {}),
                "wall_time": wall,
            }
        )
        return ExitCode.DONE
    print(
        f"{specification.point_count} points of {specification.repeat} simulations of "
        f"{specification.duration:g} s: {result.simulations} run, {result.kept} kept, "
        f"{result.failures} failed, in {wall:.1f} s"
    )
    for line in _indices(result.indices):
        print(line)
    names = ["simulations.parquet", "points.parquet", *(["indices.json"] if result.indices else [])]
    for path in (*(result.folder / name for name in names), result.report):
        print(printable(path))
    return ExitCode.DONE


def _indices(indices: Mapping[str, Any]) -> list[str]:
    """Return a table of the figures, with the inputs that cause most of their variance."""
    if not indices:
        return []
    rows = []
    for name, item in indices.items():
        if "missing" in item:
            rows.append((name, item["unit"], "-", "-", "-", "-", item["missing"]))
            continue
        ranked = sorted(item["inputs"].items(), key=lambda each: -each[1]["total"])
        rows.append(
            (
                *(name, item["unit"], f"{item['mean']:.4g}"),
                *(f"{end:.4g}" for end in item["interval_90"]),
                f"{item['noise_share']:.2f}",
                ", ".join(f"{cause} {share['total']:.2f}" for cause, share in ranked[:_CAUSES]),
            )
        )
    head = ("figure", "unit", "mean", "5 %", "95 %", "noise", "greatest shares in all")
    return table(head, rows, 2)
