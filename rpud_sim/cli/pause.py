"""``rpud pause``: let simulation time stand still."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, print_state_after

HELP = "let the time of a running drill stand still, so that it can be stepped"
EXAMPLE = "rpud pause"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    return print_state_after(arguments, lambda drill: drill.pause())
