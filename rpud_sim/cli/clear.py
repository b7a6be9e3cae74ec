"""``rpud clear``: end faults."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.program import CommandError, ExitCode
from rpud_sim.foundation.terminal import printable

HELP = "end faults of a running drill"
EXAMPLE = "rpud clear free_mass_jammed"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "fault", nargs="?", metavar="FAULT", help="number of a fault, or a kind of faults"
    )
    parser.add_argument("--all", action="store_true", help="end all faults")
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    if (arguments.fault is None) != arguments.all:
        raise CommandError("needs either FAULT or --all", ExitCode.USAGE)
    which = "all" if arguments.all else arguments.fault
    with connected_drill(arguments) as drill:
        cleared = drill.clear(int(which) if which.isdecimal() else which)
    print(f"cleared: {printable(', '.join(map(str, cleared)) or 'no fault was active')}")
    return ExitCode.DONE
