"""``rpud report``: report of a bag as one HTML page."""

from __future__ import annotations

import argparse

from rpud_sim.cli.options import add_bag_argument, add_json_argument
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.cli.tables import print_json
from rpud_sim.foundation.terminal import complain, printable

HELP = "write a report of a bag as one HTML page"
DETAILS = (
    "The page shows configuration, impacts, segments between commands and faults, contact force, "
    "energy, spectra, time series, timing and faults. Its plots zoom together. It needs no other "
    "file and no network. Exit codes: 0 done, 3 done but for damaged parts, "
    "1 failed, 2 wrong call."
)
EXAMPLE = "rpud report bags/first --out first.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    parser.add_argument(
        "--out", default="report.html", metavar="FILE", help="new file (default: %(default)s)"
    )
    add_json_argument(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.bag import BagError
    from rpud_sim.inspection.report.bag_report import ReportError, write_report

    with failing(BagError, ReportError), progress_bar(" messages", scaled=True) as bar:
        seen = write_report(arguments.bag, arguments.out, bar.update)
    for name, reason in (*seen.left_out.items(), *seen.damaged.items()):
        complain("rpud report", f"left out {name}: {reason}")
    content = {
        "out": arguments.out,
        "topics": len(seen.topics),
        "messages": sum(topic.summary.message_count for topic in seen.topics.values()),
        "left_out": seen.left_out,
        "damaged": seen.damaged,
    }
    if arguments.json:
        print_json(content)
    else:
        where = printable(arguments.out)
        print(f"{where}: {content['messages']} messages on {content['topics']} topics")
    return ExitCode.INCOMPLETE if seen.damaged else ExitCode.DONE
