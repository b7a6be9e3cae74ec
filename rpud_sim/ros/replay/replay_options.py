"""Options of a replay. No ROS, so that help is quick."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass

from rpud_sim.foundation.options import (
    bag_argument,
    duration_option,
    option,
    parent_flag,
    start_option,
)
from rpud_sim.foundation.quantities import Quantity

# Publishing is slower than the greatest rate.
RATE = Quantity("", "speed of a replay, in times real time", 0.0, 1e6, exclusive=True)
# The messages of ``/clock`` come before all others.
_CLOCK_RATE = Quantity("Hz", "rate of /clock", 0.0, 1e4, exclusive=True)
_DEFAULT_CLOCK_RATE = 40.0  # where ``--clock`` names none [Hz]
# Time that a replay waits for subscribers by default [s]; Fast DDS announces itself every 3 s.
DISCOVERY_TIME = 3.5

_NAME = r"(/[A-Za-z_][A-Za-z0-9_]*)+"
_REMAPPING = re.compile(f"{_NAME}:={_NAME}")


def remapping(text: str) -> str:
    """Return a rule ``OLD:=NEW`` of two absolute topic names; a type for argparse."""
    if not _REMAPPING.fullmatch(text):
        raise argparse.ArgumentTypeError(
            f"{text!r} is not of the form OLD:=NEW with two absolute topic names"
        )
    return text


@dataclass(frozen=True, kw_only=True)
class ReplayOptions:
    """What to replay, how fast, and under which names."""

    bag: str = bag_argument()
    start: float = start_option()
    duration: float | None = duration_option("replay")
    rate: float = option(1.0, "speed in times real time (default: %(default)g)", RATE, metavar="R")
    loop: bool = option(False, "begin again at the end")
    clock: float | None = option(
        None,
        "publish the bag's time on /clock that often by the real time, also when it stands "
        f"still (default: {_DEFAULT_CLOCK_RATE:g} Hz)",
        _CLOCK_RATE,
        nargs="?",
        const=_DEFAULT_CLOCK_RATE,
    )
    topics: Sequence[str] | None = option(
        None, "replay only these topics (absolute names)", nargs="+", metavar="TOPIC"
    )
    exclude: Sequence[str] = option((), "leave these topics out", nargs="+", metavar="TOPIC")
    remap: Sequence[str] = option(
        (),
        "publish a topic under another name (both absolute)",
        nargs="+",
        type=remapping,
        metavar="OLD:=NEW",
    )
    start_paused: bool = option(False, "wait at the beginning to be resumed")
    wait_for_subscribers: bool = option(
        False,
        "begin when every replayed topic has a subscriber, without a limit of time; "
        f"otherwise it waits at most {DISCOVERY_TIME:g} s",
    )
    with_parent: bool = parent_flag()
