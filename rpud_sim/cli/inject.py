"""``rpud inject``: inject a fault."""

from __future__ import annotations

import argparse

from rpud_sim.cli.drill_command import add_drill_arguments, connected_drill, number
from rpud_sim.cli.options import POSITIVE_SECONDS, Number
from rpud_sim.cli.program import ExitCode

HELP = "inject a fault into a running drill"
EXAMPLE = "rpud inject free_mass_jammed --for 5"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "kind",
        metavar="KIND",
        help="kind of the fault; `rpud faults` lists those that are possible",
    )
    parser.add_argument(
        "--channel",
        default="",
        metavar="C",
        help="topic with the faulty signal, such as reacting_force; only for signal faults",
    )
    parser.add_argument(
        "--magnitude",
        type=number,
        metavar="M",
        help="how much, in the unit of the kind (default: that of the kind)",
    )
    parser.add_argument(
        "--for",
        dest="duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="end the fault after that many seconds of simulation time (default: never)",
    )
    add_drill_arguments(parser)


def run(arguments: argparse.Namespace) -> int:
    with connected_drill(arguments) as drill:
        fault = drill.inject(
            arguments.kind, arguments.channel, arguments.magnitude, arguments.duration
        )
    print(f"fault {fault}: {' on '.join(filter(None, (arguments.kind, arguments.channel)))}")
    return ExitCode.DONE
