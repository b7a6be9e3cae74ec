"""Options of recorder and replayer, without what takes long to load."""

from __future__ import annotations

import argparse
import re
from collections.abc import Sequence
from dataclasses import dataclass

from rpud_sim.foundation.options import (
    BYTES,
    POSITIVE_SECONDS,
    bag_argument,
    duration_option,
    namespace_option,
    option,
    parent_flag,
    positional,
    required,
    run_time_option,
    start_option,
)
from rpud_sim.foundation.quantities import Quantity

# Names of the writer's compressions; repeated, because the writer takes long to load.
COMPRESSIONS = ("none", "zstd")


def pattern(text: str) -> re.Pattern[str]:
    """Return a regular expression; a type for argparse."""
    try:
        return re.compile(text)
    except (re.error, RecursionError, OverflowError) as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a valid regular expression: {error}"
        ) from error


@dataclass(frozen=True, kw_only=True)
class RecordOptions:
    """What to record, how to write it, and when to end."""

    topics: Sequence[str] = positional(
        "TOPIC",
        "a topic to record, relative to the namespace; without one, the whole namespace",
        nargs="*",
    )
    everything: bool = option(False, "record the topics of all namespaces", flag="--all")
    regex: re.Pattern[str] | None = option(
        None,
        "record the topics, of any namespace, whose name contains this expression",
        type=pattern,
        metavar="EXPRESSION",
    )
    exclude: Sequence[re.Pattern[str]] = option(
        (),
        "record no topic whose name contains this expression; may be given several times",
        type=pattern,
        action="append",
        metavar="EXPRESSION",
    )
    out: str = required("the bag's new folder", metavar="DIR", new=True)
    namespace: str = namespace_option("namespace to record and to resolve names in")
    compression: str = option(
        "zstd", "compression of the bag's chunks (default: %(default)s)", choices=COMPRESSIONS
    )
    duration: float | None = run_time_option()
    max_loss: float = option(
        1.0,
        "seconds of messages that a crash loses at most, if processor and disk keep up "
        "(default: %(default)g)",
        POSITIVE_SECONDS,
    )
    max_bag_size: int | None = option(
        None, "begin a new file before a file is larger (default: one file)", BYTES
    )
    max_bag_duration: float | None = option(
        None,
        "begin a new file after this time (default: one file)",
        POSITIVE_SECONDS,
    )
    max_disk: int | None = option(
        None, "stop, with exit code 1, before the whole bag is larger (default: no limit)", BYTES
    )
    min_free: int = option(
        64 * 2**20,
        "stop, with exit code 1, before the disk has less free space (default: %(default)d)",
        BYTES,
    )
    max_cache_size: int = option(
        256 * 2**20, "messages that may wait for the disk (default: %(default)d)", BYTES
    )
    use_sim_time: bool = option(
        False,
        "take log times from /clock; the default if a recorded drill is its source",
    )
    start_paused: bool = option(False, "record only when the service ~/resume is called")
    with_parent: bool = parent_flag()
    allow_empty: bool = option(
        False, "exit code 0 also if a requested topic never appears, or no message arrives"
    )
    ready_fd: int | None = option(
        None,
        "write one line to this open file descriptor when the recording begins",
        type=int,
        metavar="N",
    )


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
        "publish the bag's time on /clock at this real rate, also while paused "
        f"(default: {_DEFAULT_CLOCK_RATE:g} Hz)",
        _CLOCK_RATE,
        nargs="?",
        const=_DEFAULT_CLOCK_RATE,
    )
    topics: Sequence[str] | None = option(
        None, "replay only these topics (absolute names)", nargs="+", metavar="TOPIC"
    )
    exclude: Sequence[str] = option(
        (), "leave these topics out", nargs="+", action="extend", metavar="TOPIC"
    )
    remap: Sequence[str] = option(
        (),
        "publish a topic under another name (both absolute)",
        nargs="+",
        type=remapping,
        metavar="OLD:=NEW",
    )
    namespace: str = namespace_option("namespace of the replayer; topics keep their names")
    start_paused: bool = option(False, "wait at the beginning until resumed")
    wait_for_subscribers: bool = option(
        False,
        "begin when every replayed topic has a subscriber, without a timeout; "
        f"otherwise it waits at most {DISCOVERY_TIME:g} s",
    )
    with_parent: bool = parent_flag()
