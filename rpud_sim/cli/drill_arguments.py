"""Arguments of commands on a running drill, and the connection to it."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from rpud_sim.cli.options import POSITIVE_SECONDS, Number
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.ros.record.record_options import RecordOptions

if TYPE_CHECKING:
    from rpud_sim.ros.client import DrillClient

DOMAIN = Quantity("", "a ROS domain", 0, 232, whole=True)
PATIENCE = 5.0  # for a drill and its answer [s]


def number(text: str) -> float:
    """Return a finite number, whose range the drill checks; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def add_place_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --namespace and --domain."""
    parser.add_argument(
        "--namespace",
        default=RecordOptions.namespace,
        help="namespace of the drill (default: %(default)s)",
    )
    parser.add_argument(
        "--domain",
        action=Number,
        quantity=DOMAIN,
        metavar="N",
        help="ROS domain (default: ROS_DOMAIN_ID, or 0)",
    )


def add_drill_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare --namespace, --domain and --patience."""
    add_place_arguments(parser)
    parser.add_argument(
        "--patience",
        action=Number,
        quantity=POSITIVE_SECONDS,
        default=PATIENCE,
        metavar="S",
        help="fail if there is no drill or no answer within that many seconds "
        "(default: %(default)g)",
    )


@contextmanager
def connected_drill(arguments: argparse.Namespace) -> Iterator[DrillClient]:
    """Connect to the drill of --namespace and --domain; each error becomes one line."""
    from rpud_sim.ros.client import ClientError, DrillClient, RefusedError
    from rpud_sim.ros.starting import StartError

    with (
        failing(ClientError),
        failing(StartError, code=ExitCode.USAGE),
        DrillClient(
            arguments.namespace,
            domain_id=arguments.domain,
            node_name=f"rpud_{arguments.command}",
            patience=arguments.patience,
        ) as drill,
    ):
        try:
            yield drill
        except RefusedError as error:
            raise CommandError(f"the drill refuses: {error}") from error
