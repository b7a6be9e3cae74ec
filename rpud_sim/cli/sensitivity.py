"""``rpud sensitivity``: how far the headline figures are known, and which inputs decide that."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from rpud_sim.cli.options import add_json_argument
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.terminal import printable

HELP = "divide the uncertainty of the headline figures among the parameters"
EXAMPLE = "rpud sensitivity config/sensitivity.yaml --out sensitivity.json"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("spec", metavar="SPEC", help="the study, such as config/sensitivity.yaml")
    parser.add_argument("--out", metavar="FILE", help="file for all numbers as one JSON object")
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.studies.sensitivity.sensitivity import run_sensitivity
    from rpud_sim.studies.sensitivity.specification import SensitivityError, read_specification

    started = time.perf_counter()
    with failing(SensitivityError, code=ExitCode.USAGE):
        specification = read_specification(arguments.spec)
    if arguments.out and not Path(arguments.out).absolute().parent.is_dir():
        raise CommandError(f"--out {printable(arguments.out)}: its folder does not exist")
    if arguments.out and Path(arguments.out).is_dir():
        raise CommandError(f"--out {printable(arguments.out)}: is a folder")
    with failing(SensitivityError):
        result = run_sensitivity(specification, _track)
    content = result.content()
    if arguments.out:
        from rpud_sim.foundation.whole_folder import whole_file

        with whole_file(Path(arguments.out)) as unfinished:
            Path(unfinished).write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    if arguments.json:
        print_json(content)
        return ExitCode.DONE
    print(_text(content["figures"]))
    print(
        f"{specification.simulations} simulations of {specification.duration:g} s in "
        f"{time.perf_counter() - started:.0f} s"
    )
    if arguments.out:
        print(printable(arguments.out))
    return ExitCode.DONE


def _track(items: Iterable[Any], total: int, title: str) -> Iterator[Any]:
    with progress_bar(f" {title}", total) as bar:
        for item in items:
            yield item
            bar.update()


def _text(figures: dict[str, Any]) -> str:
    lines = table(
        ("figure", "unit", "mean", "5 %", "95 %", "noise share"),
        (
            (
                name,
                figure["unit"],
                f"{figure['mean']:.4g}",
                *(f"{end:.4g}" for end in figure["interval_90"]),
                f"{figure['noise_share']:.2f}",
            )
            for name, figure in figures.items()
        ),
        2,
    )
    for name, figure in figures.items():
        ranked = sorted(figure["inputs"].items(), key=lambda item: -item[1]["total"])
        lines += ["", f"{name}: share of the variance [95 % interval]"]
        lines += table(
            ("input", "alone", "", "in all", ""),
            (
                (
                    input_name,
                    f"{item['first']:.2f}",
                    _interval(item["first_interval"]),
                    f"{item['total']:.2f}",
                    _interval(item["total_interval"]),
                )
                for input_name, item in ranked
            ),
            1,
        )
    lines += [
        "",
        "The motion is chaotic: an input whose share in all is near the noise share has none.",
    ]
    return "\n".join(lines)


def _interval(ends: list[float]) -> str:
    return f"[{ends[0]:.2f}, {ends[1]:.2f}]"
