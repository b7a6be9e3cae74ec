"""``rpud report``: report of a bag as one HTML page."""

from __future__ import annotations

import argparse
import dataclasses

from rpud_sim.cli.options import add_bag_argument, add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.terminal import complain, printable

HELP = "write a report of a bag as one HTML page"
DETAILS = (
    "The page is the screen of `rpud watch`, with the whole run as an overview, some blocks of "
    "motion, and values by segment between commands and faults. It needs no other file and no "
    "network. Exit codes: 0 done, 3 done but for damaged parts, 1 failed, 2 wrong call."
)
EXAMPLE = "rpud report bags/first --out first.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument(
        "--out", default="report.html", metavar="FILE", help="new file (default: %(default)s)"
    )
    parser.add_argument("--namespace", default="", metavar="NAME", help="drill; default: the first")
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection import InspectionError
    from rpud_sim.viewer.report import write_report

    with failing(BagError, InspectionError):
        seen = write_report(arguments.bag, arguments.out, arguments.namespace)
    for name, reason in (*seen.left_out.items(), *seen.damaged.items()):
        complain("rpud report", f"left out {name}: {reason}")
    if arguments.json:
        print_json({"out": arguments.out, **dataclasses.asdict(seen)})
    else:
        where = printable(arguments.out)
        print(f"{where}: {seen.messages} messages on {seen.topics} topics")
    return ExitCode.INCOMPLETE if seen.damaged else ExitCode.DONE
