"""``rpud press``: command a weight on bit."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill, number
from rpud_sim.cli.program import ExitCode

HELP = "press a running drill onto the rock with a weight on bit"
EXAMPLE = "rpud press 30"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("force", type=number, metavar="FORCE", help="weight on bit in newtons")
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        drill.press(arguments.force)
    print(f"weight on bit: {arguments.force:g} N")
    return ExitCode.DONE
