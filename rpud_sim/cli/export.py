"""``rpud export``: topics of a bag as files for other programs."""

from __future__ import annotations

import argparse
from dataclasses import asdict
from typing import TYPE_CHECKING

from rpud_sim.cli.options import (
    LONGEST,
    Number,
    add_bag_argument,
    add_json_argument,
    add_range_arguments,
    add_run_argument,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json, table
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.inspection.export import Exported
    from rpud_sim.inspection.rebuild import Rebuilt

HELP = "write the topics of a bag as Parquet, CSV or NumPy files"
DETAILS = (
    "It writes one table for each topic, and export.json with types, units, losses and the "
    "configuration of the run. With --rate it writes one table instead: every channel of the "
    "waveform, rebuilt exactly from the trajectory. Exit codes: 0 done, 3 done but for damaged "
    "parts, 1 failed, 2 wrong call."
)
EXAMPLE = "rpud export bags/first --out tables"

_FORMATS = ("parquet", "csv", "numpy")
_RATE = Quantity("Hz", "of the samples", 1.0, 1e9, whole=True)  # time is whole nanoseconds


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
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
        "--rate",
        action=Number,
        quantity=_RATE,
        metavar="HZ",
        help="export the waveform, rebuilt at this whole number of samples a second",
    )
    add_run_argument(parser, "with --rate: ")
    add_range_arguments(parser, "export", LONGEST)
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    """Export and print the account; return the exit code."""
    if arguments.rate is not None:
        return _export_waveform(arguments)
    if arguments.number != 1:
        raise ParameterError("--run goes with --rate")
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.export import export

    with failing(BagError, InspectionError), progress_bar(" messages", scaled=True) as bar:
        exported = export(
            arguments.bag,
            arguments.out,
            arguments.file_format,
            arguments.topics,
            arguments.start,
            arguments.duration,
            bar.update,
        )
    for name, reason in (*exported.left_out.items(), *exported.damaged.items()):
        complain("rpud export", f"left out {name}: {reason}")
    print_json(asdict(exported)) if arguments.json else print(_account(exported))
    return ExitCode.INCOMPLETE if exported.damaged else ExitCode.DONE


def _export_waveform(arguments: argparse.Namespace) -> ExitCode:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.inspection.rebuild import rebuild

    with failing(BagError, InspectionError), progress_bar(" samples", scaled=True) as bar:
        rebuilt = rebuild(
            arguments.bag,
            arguments.out,
            arguments.rate,
            arguments.file_format,
            arguments.topics,
            arguments.start,
            arguments.duration,
            arguments.number,
            bar.update,
        )
    print_json(asdict(rebuilt)) if arguments.json else print(_waveform_account(rebuilt))
    return ExitCode.DONE


def _waveform_account(rebuilt: Rebuilt) -> str:
    lines = [
        f"rebuilt {rebuilt.count} samples at {rebuilt.rate} Hz in {printable(rebuilt.table)}: "
        f"{rebuilt.size / 1e6:.2f} MB",
        f"the bag's trajectory is {rebuilt.trajectory_size / 1e6:.2f} MB uncompressed",
    ]
    if rebuilt.runs > 1:
        lines.append(f"this is run {rebuilt.run} of {rebuilt.runs}, which resets began")
    if rebuilt.missing:
        lines.append(f"{rebuilt.missing} samples are NaN: segments are missing")
    return "\n".join(lines)


def _account(exported: Exported) -> str:
    head = ("topic", "messages", "rows", "size [MB]", "file")
    rows = [
        (topic.name, topic.messages, topic.rows, f"{topic.size / 1e6:.3f}", topic.path)
        for topic in exported.topics
    ]
    return "\n".join(table(head, rows, left=1))
