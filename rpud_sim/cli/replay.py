"""``rpud replay``: publish a bag's messages again."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from functools import partial

from rpud_sim.cli.options import (
    LONGEST,
    Number,
    add_bag_argument,
    add_range_arguments,
    add_with_parent,
    options_from,
)
from rpud_sim.cli.program import ExitCode, failing
from rpud_sim.cli.progress import progress_bar
from rpud_sim.ros.replay.replay_options import (
    CLOCK_RATE,
    DEFAULT_CLOCK_RATE,
    DISCOVERY_TIME,
    RATE,
    ReplayOptions,
)

HELP = "publish a bag's messages with their types, QoS and timing"
EXAMPLE = "rpud replay bags/first --rate 0.5"

_NAME = r"(/[A-Za-z_][A-Za-z0-9_]*)+"
_REMAPPING = re.compile(f"{_NAME}:={_NAME}")
_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s{postfix}"


def remapping(text: str) -> str:
    """Return a rule ``OLD:=NEW`` of two absolute topic names; a type for argparse."""
    if not _REMAPPING.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form OLD:=NEW with two absolute topic names"
        )
    return text


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_bag_argument(parser)
    add_range_arguments(parser, "replay", LONGEST)
    parser.add_argument(
        "--rate",
        action=Number,
        quantity=RATE,
        default=ReplayOptions.rate,
        metavar="R",
        help="speed in times real time (default: %(default)g)",
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        "--clock",
        nargs="?",
        action=Number,
        quantity=CLOCK_RATE,
        const=DEFAULT_CLOCK_RATE,
        metavar="HZ",
        help="publish the bag's time on /clock that often by the real time, also when it stands "
        f"still (default: {DEFAULT_CLOCK_RATE:g} Hz)",
    )
    parser.add_argument(
        "--topics", nargs="+", metavar="TOPIC", help="replay only these topics (absolute names)"
    )
    parser.add_argument(
        "--exclude", nargs="+", default=(), metavar="TOPIC", help="leave these topics out"
    )
    parser.add_argument(
        "--remap",
        nargs="+",
        type=remapping,
        default=(),
        metavar="OLD:=NEW",
        help="publish a topic under another name (both absolute)",
    )
    parser.add_argument(
        "--start-paused", action="store_true", help="wait at the beginning to be resumed"
    )
    parser.add_argument(
        "--wait-for-subscribers",
        action="store_true",
        help="begin when every replayed topic has a subscriber, without a limit of time; "
        f"otherwise it waits at most {DISCOVERY_TIME:g} s",
    )
    add_with_parent(parser)


def run(arguments: argparse.Namespace) -> int:
    return replay(options_from(arguments, ReplayOptions))


def replay(options: ReplayOptions, ros_arguments: Sequence[str] = ()) -> int:
    """Replay with these options and ROS arguments; print the summary and return the exit code."""
    from rpud_sim.bag import BagError
    from rpud_sim.ros.replay import replayer
    from rpud_sim.ros.starting import StartError

    with (
        failing(BagError, replayer.ReplayError),
        failing(replayer.OptionError, StartError, code=ExitCode.USAGE),
    ):
        bar = partial(progress_bar, "s", delay=0.0, layout=_BAR)
        print(replayer.replay(options, ros_arguments, bar), flush=True)
    return ExitCode.DONE
