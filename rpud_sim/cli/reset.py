"""``rpud reset``: let a running drill begin again."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill
from rpud_sim.cli.options import Number
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.quantities import Quantity

HELP = "let a running drill begin again"
EXAMPLE = "rpud reset --seed 7"

SCOPES = ("all", "time", "state", "faults")
SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--scope", choices=SCOPES, default="all", help="what begins again (default: %(default)s)"
    )
    parser.add_argument(
        "--seed",
        action=Number,
        quantity=SEED,
        metavar="N",
        help="of phase, scenario and noise from here on (default: the present one)",
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        drill.reset(arguments.scope, arguments.seed)
        status, time = drill.status, drill.time
    print(f"state: {status.state}, time: {time:.9f} s")
    return ExitCode.DONE
