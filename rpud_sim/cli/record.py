"""``rpud record``: record ROS topics into a bag."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from rpud_sim.cli.options import (
    BYTES,
    POSITIVE_SECONDS,
    Number,
    add_with_parent,
    options_from,
    pattern,
)
from rpud_sim.cli.program import CommandError, ExitCode, failing
from rpud_sim.cli.progress import status_line
from rpud_sim.foundation.terminal import printable
from rpud_sim.ros.record.record_options import COMPRESSIONS, RecordOptions

HELP = "record ROS topics into a bag that rosbag2 reads"
EXAMPLE = "rpud record --out bags/first --duration 10"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "topics",
        nargs="*",
        metavar="TOPIC",
        help="a topic to record, relative to the namespace; without one, the whole namespace",
    )
    parser.add_argument(
        "--all", action="store_true", dest="everything", help="record the topics of all namespaces"
    )
    parser.add_argument(
        "--regex",
        type=pattern,
        metavar="EXPRESSION",
        help="record the topics, of any namespace, whose name contains this expression",
    )
    parser.add_argument(
        "--exclude",
        type=pattern,
        metavar="EXPRESSION",
        help="record no topic whose name contains this expression",
    )
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="the bag's new folder; nothing is overwritten"
    )
    parser.add_argument(
        "--namespace",
        default=RecordOptions.namespace,
        help="namespace to record and to resolve names in (default: %(default)s)",
    )
    parser.add_argument(
        "--compression",
        choices=COMPRESSIONS,
        default=RecordOptions.compression,
        help="compression of the bag's chunks (default: %(default)s)",
    )
    parser.add_argument(
        "--duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="stop after that many seconds (default: at SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--max-loss",
        action=Number,
        quantity=POSITIVE_SECONDS,
        default=RecordOptions.max_loss,
        metavar="S",
        help="seconds of messages that a crash may cost at most, where processor and disk keep up "
        "(default: %(default)g)",
    )
    parser.add_argument(
        "--max-bag-size",
        action=Number,
        quantity=BYTES,
        metavar="BYTES",
        help="begin a new file of the bag before one is larger (default: one file)",
    )
    parser.add_argument(
        "--max-bag-duration",
        action=Number,
        quantity=POSITIVE_SECONDS,
        metavar="S",
        help="begin a new file of the bag when one lasts as long (default: one file)",
    )
    parser.add_argument(
        "--max-disk",
        action=Number,
        quantity=BYTES,
        metavar="BYTES",
        help="stop before the whole bag is larger, with exit code 1 (default: no limit)",
    )
    parser.add_argument(
        "--max-cache-size",
        action=Number,
        quantity=BYTES,
        default=RecordOptions.max_cache_size,
        metavar="BYTES",
        help="messages that may wait for the disk (default: %(default)d)",
    )
    parser.add_argument(
        "--start-paused",
        action="store_true",
        help="record only when the service ~/resume is called",
    )
    add_with_parent(parser)
    parser.add_argument("--until-eof", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument(
        "--allow-empty",
        action="store_true",
        help="exit code 0 also if a requested topic never appears, or no message arrives",
    )
    parser.add_argument(
        "--ready-fd",
        type=int,
        metavar="N",
        help="write one line to this open file descriptor when the recording begins",
    )


def run(arguments: argparse.Namespace) -> int:
    return record(options_from(arguments, RecordOptions))


def record(options: RecordOptions, ros_arguments: Sequence[str] = ()) -> int:
    """Record with these options and ROS arguments; print the summary and return the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.ros.record import recorder
    from rpud_sim.ros.starting import StartError

    with (
        failing(BagError),
        failing(StartError, code=ExitCode.USAGE),
        status_line(printable(Path(options.out).name)) as show,
    ):
        result = recorder.record(options, ros_arguments, show)
    with suppress(BrokenPipeError):
        print(result.summary, flush=True)
    if result.failure:
        raise CommandError(result.failure)
    return ExitCode.DONE
