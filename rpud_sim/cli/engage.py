"""``rpud engage``: put the drill tool into the rock, or take it out."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.program import ExitCode

HELP = "put the tool of a running drill into the rock, or take it out"
EXAMPLE = "rpud engage --off"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--off", action="store_true", help="take the tool out of the rock")
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        drill.engage(not arguments.off)
        regime = drill.status.regime
    print(f"regime: {regime}")
    return ExitCode.DONE
