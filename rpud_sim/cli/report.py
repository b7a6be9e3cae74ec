"""`rpud report`: a bag as one HTML page."""

from __future__ import annotations

import argparse
import json

from rpud_sim.cli.progress import progress_bar
from rpud_sim.foundation.terminal import complain, printable

DAMAGED = 3
"""Exit code where something of the bag is damaged and left out."""

HELP = "write a report of a bag as one HTML page"
EXAMPLE = "rpud report bags/first --out first.html"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud report`."""
    parser.description = (
        f"{HELP[0].upper()}{HELP[1:]}: what the run was, impacts, contact force, energy, spectra, "
        "time series, timing and faults, in a file that needs nothing beside it. "
        f"Exit codes: 0 done, {DAMAGED} done but for what is damaged, 1 failed, 2 wrong call."
    )
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument(
        "--out", default="report.html", metavar="FILE", help="new file (default: %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="print one JSON object")


def run(arguments: argparse.Namespace) -> int:
    """Write the report and say where it is; give the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.inspection.report.bag_report import ReportError, write_report

    try:
        with progress_bar(" messages", scaled=True) as bar:
            seen = write_report(arguments.bag, arguments.out, bar.update)
    except (BagError, ReportError) as error:
        complain("rpud report", error)
        return 1
    for name, reason in (*seen.left_out.items(), *seen.damaged.items()):
        complain("rpud report", f"left out {name}: {reason}")
    content = {
        "out": arguments.out,
        "topics": len(seen.topics),
        "messages": sum(topic.summary.message_count for topic in seen.topics.values()),
        "left_out": seen.left_out,
        "damaged": seen.damaged,
    }
    print(
        json.dumps(content, indent=2)
        if arguments.json
        else f"{printable(arguments.out)}: {content['messages']} messages "
        f"on {content['topics']} topics"
    )
    return DAMAGED if seen.damaged else 0
