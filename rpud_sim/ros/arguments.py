"""What the recorder and the replayer take on the command line. No ROS, so that help is quick."""

from __future__ import annotations

import argparse
import re
from collections.abc import Callable
from math import isfinite

DEFAULT_NAMESPACE = "/rpud"
COMPRESSIONS = ("none", "lz4", "zstd")
MAX_LOSS = 1.0
"""Seconds of messages that a crash of the recorder may cost, where `--max-loss` names none."""
MAX_CACHE_SIZE = 256 * 2**20
"""Bytes that wait for the disk, or that a snapshot has, where `--max-cache-size` names none."""
CLOCK_RATE = 40.0
"""Rate of `/clock` where `--clock` names none [Hz]."""
FASTEST_RATE = 1e6
"""The greatest rate of a replay [times real time]; publishing is slower than that."""
LONGEST = 1e9
"""The greatest number of seconds that any option takes: thirty years."""
FASTEST_CLOCK = 1e4
"""The greatest rate of `/clock` [Hz]: its messages come before all others."""
DISCOVERY_TIME = 3.5
"""How long a replay waits for subscribers unasked [s]; Fast DDS announces itself every 3 s."""

_NAME = r"(/[A-Za-z_][A-Za-z0-9_]*)+"
_REMAPPING = re.compile(f"{_NAME}:={_NAME}")


def number(
    unit: str,
    *,
    above: float | None = None,
    least: float | None = None,
    most: float | None = None,
) -> Callable:
    """Make an argparse type for a finite number in `unit`: `> above` or `>= least`, `<= most`."""
    allowed = f"greater than {above:g}" if above is not None else f"at least {least or 0:g}"
    if most is not None:
        allowed += f" and at most {most:g}"

    def convert(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = float("nan")
        fits = value > above if above is not None else value >= (least or 0)
        if not (isfinite(value) and fits and (most is None or value <= most)):
            raise argparse.ArgumentTypeError(
                f"{text!r} {unit}; it must be a finite number {allowed}"
            )
        return value

    return convert


def pattern(text: str) -> re.Pattern[str]:
    """Be an argparse type for a regular expression."""
    try:
        return re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        raise argparse.ArgumentTypeError(f"{text!r} is no regular expression: {error}") from error


def add_record_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud record` and of the executable `recorder`."""
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
        help="record the topics, in whatever namespace, in whose name this is found",
    )
    parser.add_argument(
        "--exclude",
        type=pattern,
        metavar="EXPRESSION",
        help="record no topic in whose name this is found",
    )
    parser.add_argument(
        "--qos-profile-overrides-path",
        metavar="FILE",
        help="YAML file of topics and the QoS to request for them (default: what is offered)",
    )
    parser.add_argument(
        "--out", required=True, metavar="DIR", help="the bag's new folder; nothing is overwritten"
    )
    parser.add_argument(
        "--namespace",
        default=DEFAULT_NAMESPACE,
        help="namespace to record and to resolve names in (default: %(default)s)",
    )
    parser.add_argument(
        "--compression",
        choices=COMPRESSIONS,
        default="zstd",
        help="compression of the bag's chunks (default: %(default)s)",
    )
    parser.add_argument(
        "--duration",
        type=number("s", above=0, most=LONGEST),
        metavar="S",
        help="stop after that many seconds (default: at SIGINT or SIGTERM)",
    )
    parser.add_argument(
        "--max-loss",
        type=number("s", above=0, most=LONGEST),
        default=MAX_LOSS,
        metavar="S",
        help="seconds of messages that a crash may cost at most (default: %(default)g)",
    )
    parser.add_argument(
        "--max-bag-size",
        type=number("bytes", above=0),
        metavar="BYTES",
        help="begin a new file of the bag before one is larger (default: one file)",
    )
    parser.add_argument(
        "--max-bag-duration",
        type=number("s", above=0, most=LONGEST),
        metavar="S",
        help="begin a new file of the bag when one lasts as long (default: one file)",
    )
    parser.add_argument(
        "--max-disk",
        type=number("bytes", above=0),
        metavar="BYTES",
        help="stop before the whole bag is larger, with exit code 1 (default: no limit)",
    )
    parser.add_argument(
        "--max-cache-size",
        type=number("bytes", above=0),
        default=MAX_CACHE_SIZE,
        metavar="BYTES",
        help="messages that may wait for the disk, or that a snapshot has (default: %(default)d)",
    )
    parser.add_argument(
        "--snapshot-mode",
        action="store_true",
        help="write the latest messages whenever the service ~/snapshot asks for it, and no others",
    )
    parser.add_argument(
        "--start-paused",
        action="store_true",
        help="record only when the service ~/resume asks for it",
    )
    parser.add_argument(
        "--until-eof",
        action="store_true",
        help="stop also where standard input ends, as it does with the program that holds it open",
    )
    parser.add_argument(
        "--allow-empty",
        action="store_true",
        help="exit code 0 also where a topic that was named never appears, or nothing comes",
    )
    parser.add_argument(
        "--ready-fd",
        type=int,
        metavar="N",
        help="write one line to this open file descriptor as soon as it records",
    )


def remapping(text: str) -> str:
    """Check a rule `OLD:=NEW` of two absolute topic names; an argparse type."""
    if not _REMAPPING.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form OLD:=NEW with two absolute topic names"
        )
    return text


def add_replay_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments of `rpud replay` and of the executable `replayer`."""
    parser.add_argument("bag", metavar="BAG", help="a bag's folder or one MCAP file")
    parser.add_argument(
        "--rate",
        type=number("(times real time)", above=0, most=FASTEST_RATE),
        default=1.0,
        metavar="R",
        help="how many times as fast as it was recorded (default: 1)",
    )
    parser.add_argument(
        "--start",
        type=number("s", least=0, most=LONGEST),
        default=0.0,
        metavar="S",
        help="skip that many seconds of the bag (default: 0)",
    )
    parser.add_argument(
        "--duration",
        type=number("s", above=0, most=LONGEST),
        metavar="S",
        help="end after that many seconds of the bag (default: at its end)",
    )
    parser.add_argument("--loop", action="store_true", help="begin again at the end")
    parser.add_argument(
        "--clock",
        nargs="?",
        type=number("Hz", above=0, most=FASTEST_CLOCK),
        const=CLOCK_RATE,
        metavar="HZ",
        help="publish the bag's time on /clock that often by the real time, also when it stands "
        f"still (default: {CLOCK_RATE:g} Hz)",
    )
    parser.add_argument(
        "--topics", nargs="+", metavar="TOPIC", help="replay only these topics (absolute names)"
    )
    parser.add_argument(
        "--exclude", nargs="+", default=[], metavar="TOPIC", help="leave these topics out"
    )
    parser.add_argument(
        "--remap",
        nargs="+",
        type=remapping,
        default=[],
        metavar="OLD:=NEW",
        help="publish a topic under another name (both absolute)",
    )
    parser.add_argument(
        "--start-paused", action="store_true", help="wait at the beginning to be resumed"
    )
    parser.add_argument(
        "--wait-for-subscribers",
        action="store_true",
        help="begin only when every replayed topic has a subscriber, however long that takes; "
        f"otherwise this is waited for at most {DISCOVERY_TIME:g} s",
    )
    parser.add_argument(
        "--disable-keyboard-controls",
        action="store_true",
        help="read no keys; otherwise, in a terminal: space pauses and resumes, right or n gives "
        "the next message, up and down change the rate by 0.1",
    )
