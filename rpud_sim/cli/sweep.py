"""`rpud sweep`: a design of experiments over any parameters, on all cores or a cluster."""

from __future__ import annotations

import argparse
import json
import os
import time
from pathlib import Path

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, printable

HELP = "run a design of experiments over any parameters"
EXAMPLE = "rpud sweep config/sweep.yaml --out sweeps/first"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud sweep`."""
    parser.add_argument("spec", metavar="SPEC", help="the sweep, such as config/sweep.yaml")
    parser.add_argument(
        "--out",
        required=True,
        metavar="DIR",
        help="folder for tables and pictures; what an earlier call has finished there is kept",
    )
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "--workers",
        type=_count,
        metavar="N",
        help="processes on this machine (default: one for each of its cores)",
    )
    where.add_argument(
        "--scheduler",
        metavar="tcp://HOST:PORT",
        help="run on the Dask cluster of this scheduler",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Run the sweep and print what was made; give the exit code."""
    from rpud_sim.studies.sweep.chunks import WorkerError
    from rpud_sim.studies.sweep.specification import SweepError, read_specification

    started = time.perf_counter()
    try:
        specification = read_specification(arguments.spec)
        from rpud_sim.studies.sweep.sweep import run_sweep

        with progress_bar(" simulations", specification.simulations) as bar:
            result = run_sweep(
                specification,
                Path(arguments.out),
                arguments.workers or len(os.sched_getaffinity(0)),
                arguments.scheduler,
                bar.update,
            )
    except ModuleNotFoundError as error:
        if error.name != "pyarrow":
            raise
        return _fail("needs the Python module pyarrow: pip install pyarrow", 1)
    except SweepError as error:
        return _fail(str(error), 2)
    except WorkerError as error:
        return _fail(str(error), 1)
    except OSError as error:  # Parquet's own name no file
        return _fail(f"{error.filename}: {error.strerror}" if error.filename else str(error), 1)
    wall = time.perf_counter() - started
    if arguments.json:
        print(
            json.dumps(
                {
                    "out": str(result.folder),
                    **result.manifest,
                    "run": result.simulations,
                    "kept": result.kept,
                    "failures": result.failures,
                    "pictures": [str(path) for path in result.pictures],
                    "wall_time": wall,
                },
                indent=2,
            )
        )
        return 0
    print(
        f"{specification.point_count} points of {specification.repeat} simulations of "
        f"{specification.duration:g} s: {result.simulations} run, {result.kept} kept, "
        f"{result.failures} failed, in {wall:.1f} s"
    )
    for path in (
        result.folder / "simulations.parquet",
        result.folder / "points.parquet",
        *result.pictures,
    ):
        print(printable(path))
    return 0


def _count(text: str) -> int:
    try:
        count = int(text)
    except ValueError:
        count = 0
    if not 1 <= count <= 1024:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1 to 1024")
    return count


def _fail(message: str, code: int) -> int:
    complain("rpud sweep", message)
    return code
