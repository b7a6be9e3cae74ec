"""``rpud step``: advance a paused drill."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill, number
from rpud_sim.cli.program import ExitCode

HELP = "advance a paused drill by some seconds of simulation time"
EXAMPLE = "rpud step 0.1"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("seconds", type=number, metavar="SECONDS", help="of simulation time")
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        reached = drill.step(arguments.seconds)
    print(f"time: {reached:.9f} s")
    return ExitCode.DONE
