"""`rpud run`: drill in real time, and record if asked."""

from __future__ import annotations

import argparse

from rpud_sim.cli.parameters import add_parameter_arguments, chosen_values
from rpud_sim.foundation.terminal import complain
from rpud_sim.ros.arguments import DEFAULT_NAMESPACE, LONGEST, MAX_LOSS, number

HELP = "drill in real time on ROS topics"
EXAMPLE = "rpud run --duration 10 --record bags/first --set weight_on_bit=20"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud run`."""
    add_parameter_arguments(parser)
    parser.add_argument(
        "--duration",
        type=number("s", above=0, most=LONGEST),
        metavar="S",
        help="stop after that many seconds (default: at SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--record",
        metavar="DIR",
        help="record the namespace into a new bag, by a recorder beside it",
    )
    parser.add_argument(
        "--max-loss",
        type=number("s", above=0, most=LONGEST),
        default=MAX_LOSS,
        metavar="S",
        help="with --record: seconds of messages that a crash may cost at most "
        "(default: %(default)g)",
    )
    parser.add_argument(
        "--namespace",
        default=DEFAULT_NAMESPACE,
        help="namespace of the node (default: %(default)s)",
    )
    parser.add_argument(
        "--allow-duplicate",
        action="store_true",
        help="drill although a drill of the same name runs; both answer the same requests",
    )
    parser.add_argument("--quiet", action="store_true", help="no live line of rate and forces")


def run(arguments: argparse.Namespace) -> int:
    """Drill until the duration is over or a signal asks to stop; give the exit code."""
    from rpud_sim.foundation.quantities import ParameterError

    try:
        values = chosen_values(arguments)
    except ParameterError as error:
        complain("rpud run", error)
        return 2
    from rpud_sim.ros.drill.session import drill

    return drill(
        values,
        arguments.namespace,
        duration=arguments.duration,
        bag=arguments.record,
        live=not arguments.quiet,
        max_loss=arguments.max_loss,
        allow_duplicate=arguments.allow_duplicate,
    )
