"""``rpud set``: set parameters of a running drill."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.terminal import printable

HELP = "set parameters of a running drill"
EXAMPLE = "rpud set real_time_factor=0.5"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "assignments",
        nargs="+",
        metavar="NAME=VALUE",
        help="a parameter that may change while the drill runs, in SI units",
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    from rpud_sim.simulation.parameter_files import parse_assignment

    values = dict(map(parse_assignment, arguments.assignments))
    with connected_drill(arguments) as drill:
        drill.set_parameters(**values)
    print(printable(", ".join(f"{name}: {value}" for name, value in values.items())))
    return ExitCode.DONE
