"""``rpud feed``: command the feed of a drill on an arm."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill, number
from rpud_sim.cli.program import ExitCode

HELP = "feed a running drill on an arm toward the rock, or retract it"
EXAMPLE = "rpud feed --rate 0.0005"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    motion = parser.add_mutually_exclusive_group(required=True)
    motion.add_argument(
        "--rate", type=number, metavar="V", help="toward the rock in m/s; 0 holds the mount"
    )
    motion.add_argument(
        "--position", type=number, metavar="X", help="along the drill axis in metres"
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        drill.feed(arguments.rate, arguments.position)
    if arguments.rate is not None:
        print(f"feed: {arguments.rate:g} m/s")
    else:
        print(f"feed: to {arguments.position:g} m")
    return ExitCode.DONE
