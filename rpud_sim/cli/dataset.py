"""``rpud dataset``: labelled synthetic runs, and how well two baselines detect their faults."""

from __future__ import annotations

import argparse
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import (
    add_json_argument,
    add_scheduler_argument,
    add_workers_argument,
    worker_count,
)
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.studies.dataset.evaluation import Evaluation
    from rpud_sim.studies.dataset.metrics import Metrics

HELP = "make labelled synthetic runs over faults, rocks, severities and seeds"
EXAMPLE = "rpud dataset config/dataset_example.yaml --out datasets/first"
DETAILS = "With --evaluate it judges two baseline detectors on a data set instead."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "spec", nargs="?", metavar="SPEC", help="the data set, such as config/dataset_example.yaml"
    )
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument(
        "--out",
        metavar="DIR",
        help="folder for bags, tables and labels; finished runs of an earlier call are kept",
    )
    what.add_argument(
        "--evaluate",
        metavar="DIR",
        help="judge the baselines on the data set of this folder, and print a table",
    )
    where = parser.add_mutually_exclusive_group()
    add_workers_argument(where)
    add_scheduler_argument(where)
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    if arguments.evaluate:
        for name in ("spec", "workers", "scheduler"):
            if getattr(arguments, name):
                shown = "SPEC" if name == "spec" else f"--{name}"
                raise CommandError(f"{shown} does not go with --evaluate", ExitCode.USAGE)
        return _evaluate(arguments)
    if not arguments.spec:
        raise CommandError("--out needs SPEC; see rpud dataset --help", ExitCode.USAGE)
    return _make(arguments)


def _make(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.dataset.specification import DatasetError
    from rpud_sim.studies.dataset.specification_file import read_specification
    from rpud_sim.studies.processes import WorkerError

    started = time.perf_counter()
    with failing(DatasetError, code=ExitCode.USAGE), failing(WorkerError):
        specification = read_specification(arguments.spec)
        from rpud_sim.studies.dataset.dataset import make_dataset

        for kind in specification.left_out:
            complain("rpud dataset", f"{kind} is left out: the drill cannot honour it")
        with progress_bar(" runs", specification.run_count) as bar:
            result = make_dataset(
                specification,
                Path(arguments.out),
                worker_count(arguments),
                arguments.scheduler,
                bar.update,
            )
    wall = time.perf_counter() - started
    content = result.content
    if arguments.json:
        summary = {name: value for name, value in content.items() if name != "files"}
        print_json(
            {"out": str(result.folder), **summary, "run": result.run, "kept": result.kept}
            | {"wall_time": wall}
        )
        return ExitCode.DONE
    print(content["notice"])
    print(
        f"{content['runs']} runs of {specification.duration:g} s: {result.run} run, "
        f"{result.kept} kept, {content['failures']} failed, in {wall:.1f} s"
    )
    for split, about in content["splits"].items():
        print(f"{split}: {about['runs']} runs with {', '.join(about['rocks'])}")
    for name in ("README.md", "dataset.json"):
        print(printable(result.folder / name))
    return ExitCode.DONE


def _evaluate(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.dataset import NOTICE
    from rpud_sim.studies.dataset.evaluation import evaluate_dataset, run_count
    from rpud_sim.studies.dataset.specification import DatasetError

    path = Path(arguments.evaluate)
    with failing(DatasetError), progress_bar(" runs", run_count(path)) as bar:
        evaluation = evaluate_dataset(path, bar.update)
    if arguments.json:
        print_json({"dataset": str(path), "notice": NOTICE, **_content(evaluation)})
        return ExitCode.DONE
    print(NOTICE)
    for line in (*_overview(evaluation), "", *_by_fault(evaluation), *evaluation.left_out):
        print(line)
    return ExitCode.DONE


def _overview(evaluation: Evaluation) -> list[str]:
    head = (
        *("detector", "faults", "detected", "F1", "false alarms [1/h]"),
        *("median delay [s]", "greatest delay [s]"),
    )
    rows = [
        (
            result.detector,
            result.metrics.faults,
            result.metrics.detected,
            _shown(result.metrics.f1),
            _shown(result.metrics.false_alarms_per_hour, 1),
            _shown(result.metrics.delay_median),
            _shown(result.metrics.delay_greatest),
        )
        for result in evaluation.results
    ]
    return table(head, rows, 1)


def _by_fault(evaluation: Evaluation) -> list[str]:
    head = ["fault", "severity", "runs"]
    for result in evaluation.results:
        head += [f"{result.detector}: detected", "median delay [s]"]
    rows = []
    for fault in evaluation.results[0].by_fault:
        found = [result.by_fault[fault] for result in evaluation.results]
        cells = [
            cell for metrics in found for cell in (metrics.detected, _shown(metrics.delay_median))
        ]
        rows.append((*fault, found[0].faults, *cells))
    return table(head, rows, 1)


def _shown(value: float, digits: int = 2) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


def _content(evaluation: Evaluation) -> dict[str, Any]:
    return {
        "runs": evaluation.runs,
        "detectors": {
            result.detector: {
                "limit": _finite(result.limit),
                **_figures(result.metrics),
                "by_fault": [
                    {"kind": kind, "severity": severity, **_figures(metrics)}
                    for (kind, severity), metrics in result.by_fault.items()
                ],
            }
            for result in evaluation.results
        },
        "left_out": list(evaluation.left_out),
    }


def _figures(metrics: Metrics) -> dict[str, float | None]:
    names = (
        *("faults", "detected", "false_alarms", "hours", "precision", "recall", "f1"),
        *("false_alarms_per_hour", "delay_mean", "delay_median", "delay_greatest"),
    )
    return {name: _finite(getattr(metrics, name)) for name in names}


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
