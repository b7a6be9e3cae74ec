"""`rpud export`: the topics of a bag as files for other programs."""

from __future__ import annotations

import argparse
import json
from dataclasses import asdict
from typing import TYPE_CHECKING

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, table

if TYPE_CHECKING:
    from rpud_sim.inspection.export.export import Exported

HELP = "write the topics of a bag as Parquet, CSV or NumPy files"
EXAMPLE = "rpud export bags/first --out tables"

_FORMATS = ("parquet", "csv", "numpy")
_LONGEST = 1e9  # s

DAMAGED = 3
"""Exit code where something of the bag is damaged and left out."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud export`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}: one table for each topic, and export.json, which tells "
        "types, units, losses and how the run came about. Exit codes: 0 done, "
        f"{DAMAGED} done but for what is damaged, 1 failed, 2 wrong call."
    )
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument("--out", required=True, metavar="DIR", help="new folder for the files")
    parser.add_argument(
        "--format",
        choices=_FORMATS,
        default=_FORMATS[0],
        dest="file_format",
        help="of the files (default: %(default)s)",
    )
    parser.add_argument(
        "--topics", nargs="+", metavar="TOPIC", help="export only these topics (absolute names)"
    )
    parser.add_argument(
        "--start", type=float, default=0.0, metavar="S", help="leave out so much at the beginning"
    )
    parser.add_argument("--duration", type=float, metavar="S", help="export at most so much")
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Export and print the account; give the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.foundation.quantities import ParameterError
    from rpud_sim.inspection.export.export import ExportError, export

    try:
        _check(arguments)
    except ParameterError as error:
        complain("rpud export", error)
        return 2
    try:
        with progress_bar(" messages", scaled=True) as bar:
            exported = export(
                arguments.bag,
                arguments.out,
                arguments.file_format,
                arguments.topics,
                arguments.start,
                arguments.duration,
                bar.update,
            )
    except ModuleNotFoundError as error:
        if error.name != "pyarrow":
            raise
        complain("rpud export", "needs the Python module pyarrow: pip install pyarrow")
        return 1
    except (BagError, ExportError) as error:
        complain("rpud export", error)
        return 1
    for name, reason in (*exported.left_out.items(), *exported.damaged.items()):
        complain("rpud export", f"left out {name}: {reason}")
    print(json.dumps(asdict(exported), indent=2) if arguments.json else _account(exported))
    return DAMAGED if exported.damaged else 0


def _check(arguments: argparse.Namespace) -> None:
    from rpud_sim.foundation.quantities import Quantity

    Quantity("s", "", 0.0, _LONGEST).check("--start", arguments.start)
    if arguments.duration is not None:
        Quantity("s", "", 0.0, _LONGEST, exclusive=True).check("--duration", arguments.duration)


def _account(exported: Exported) -> str:
    head = ("topic", "messages", "rows", "size [MB]", "file")
    rows = [head] + [
        (
            topic.name,
            str(topic.messages),
            str(topic.rows),
            f"{topic.size / 1e6:.3f}",
            topic.path,
        )
        for topic in exported.topics
    ]
    return "\n".join(table(rows, left=1))
