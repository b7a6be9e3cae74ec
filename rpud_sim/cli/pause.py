"""``rpud pause``: let simulation time stand still."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.program import ExitCode

HELP = "let the time of a running drill stand still, so that it can be stepped"
EXAMPLE = "rpud pause"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of ``rpud pause``."""
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    """Let simulation time stand still; return the exit code."""
    with connected_drill(arguments) as drill:
        drill.pause()
        status = drill.status
    print(f"state: {status.state}")
    return ExitCode.DONE
