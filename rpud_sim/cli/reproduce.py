"""``rpud reproduce``: figures and numbers of the paper and of the model, with intervals."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rpud_sim.cli.program import ExitCode
from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import printable

HELP = "reproduce the paper's figures and numbers as a report"
EXAMPLE = "rpud reproduce --out reproduction"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out",
        default="reproduction",
        metavar="DIR",
        help="folder for the report and its numbers (default: %(default)s)",
    )
    parser.add_argument(
        "--quick", action="store_true", help="small ensembles: seconds, with wide intervals"
    )
    parser.add_argument("--json", action="store_true", help="print all numbers as one JSON object")


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.reproduction.findings import summary
    from rpud_sim.studies.reproduction.reproduction import QUICK, Effort, reproduce
    from rpud_sim.studies.reproduction.reproduction_report import REPORT, write_report

    folder = Path(arguments.out)
    started = time.perf_counter()
    folder.mkdir(parents=True, exist_ok=True)
    result = reproduce(QUICK if arguments.quick else Effort(), _track)
    quick = " --quick" if arguments.quick else ""
    write_report(result, folder, f"rpud reproduce{quick} --out DIR")
    if arguments.json:
        print(json.dumps(result.numbers(), default=float))
        return ExitCode.DONE
    for line in summary(result):
        print(f"- {line}")
    print(f"{printable(folder / REPORT)} written in {time.perf_counter() - started:.0f} s")
    return ExitCode.DONE


def _track(items: Iterable[Any], total: int, title: str) -> Iterator[Any]:
    with progress_bar("it", total, title=title) as bar:
        for item in items:
            yield item
            bar.update()
