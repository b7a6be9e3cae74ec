"""``rpud sweep``: design of experiments over any parameters, on all cores or a cluster."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from rpud_sim.cli.options import (
    add_json_argument,
    add_scheduler_argument,
    add_workers_argument,
    worker_count,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.terminal import printable

HELP = "run a design of experiments over any parameters"
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
    from rpud_sim.studies.processes import WorkerError
    from rpud_sim.studies.sweep.specification import SweepError, read_specification

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
                "wall_time": wall,
            }
        )
        return ExitCode.DONE
    print(
        f"{specification.point_count} points of {specification.repeat} simulations of "
        f"{specification.duration:g} s: {result.simulations} run, {result.kept} kept, "
        f"{result.failures} failed, in {wall:.1f} s"
    )
    for path in (
        result.folder / "simulations.parquet",
        result.folder / "points.parquet",
        result.report,
    ):
        print(printable(path))
    return ExitCode.DONE
