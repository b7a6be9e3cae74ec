"""``rpud play``: let simulation time pass."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.program import ExitCode

HELP = "let the time of a paused drill pass"
EXAMPLE = "rpud play"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``rpud play``."""
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Let simulation time pass; return the exit code."""
    with connected_drill(arguments) as drill:
        drill.play()
        status = drill.status
    print(f"state: {status.state}")
    return ExitCode.DONE
