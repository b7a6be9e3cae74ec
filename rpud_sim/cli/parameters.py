"""Arguments that choose the drill's parameters, shared by the commands that run one."""

from __future__ import annotations

import argparse
from typing import Any


def add_parameter_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --regime, --config and --set."""
    parser.add_argument(
        "--regime",
        choices=("free", "drilling"),
        help="free is Table 1 of the paper, drilling is Table 2 with 10 N (default: drilling)",
    )
    parser.add_argument(
        "--config", metavar="FILE", help="a ROS parameter file, such as config/drilling.yaml"
    )
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        dest="assignments",
        help="set one parameter, in SI units; may be given again and again",
    )


def chosen_values(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the parameters that were given, by name: the file's, then --regime, then each --set.

    Raises:
        ParameterError: if the file or an assignment cannot be read.
    """
    from rpud_sim.simulation.parameter_files import parse_assignment, read_parameter_file

    values = read_parameter_file(arguments.config) if arguments.config else {}
    if arguments.regime:
        values["regime"] = arguments.regime
    values.update(parse_assignment(text) for text in arguments.assignments)
    return values
