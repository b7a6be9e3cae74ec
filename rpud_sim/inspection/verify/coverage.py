"""How much of the runs a bag covers, as all of its topics together show."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass

from rpud_sim.bag import BagFormatError, BagReader, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.verify.runs import Position, Span, Stretches
from rpud_sim.simulation.topics import TOPICS

# At the end of the bag, in which stamps are looked for [ns].
_LAST = 10 * SECOND
# Topics reach a recorder one a little before the other [ns].
_DELAY = 1 * SECOND
_NOWHERE: Position = (-1, -1)
_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status


@dataclass(frozen=True)
class Coverage:
    """What a bag covers.

    Args:
        span: of the runs.
        last_stamp: that at least two topics come to, so that an altered one is not it [ns].
    """

    span: Span
    last_stamp: int


def find_coverage(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Coverage:
    """Find out what a bag covers.

    The last second of a recording shows nothing about its end: when a recorder is closed, messages
    of some topics are still on their way. If the drill ended first, its last status shows all.

    Args:
        bag: that is looked at.
        codecs: of the topics that show it, by name.
        stretches: of its journal.
    """
    start = max(0, bag.duration - _LAST)
    end = max((message.log_time for message in bag.messages(codecs.keys(), start)), default=0)
    latest: dict[str, int] = {}
    reached: list[Position] = []
    for message in bag.messages(codecs.keys(), start):
        decoded = _decode(message, codecs)
        if decoded is None:
            continue
        stamp, state = decoded
        latest[message.topic] = stamp
        # Some messages with this very stamp follow, but none of them follows a status.
        position = (stretches.of(message)[0], stamp if state else stamp - 1)
        if state == _STOPPED and stretches.ended:
            reached = [position, position]
        elif message.log_time <= end - _DELAY:
            # Two messages have to show it, so that an altered one does not.
            reached = sorted([*reached, position])[-2:]
    span = Span(_begun(bag, codecs, stretches), reached[0] if len(reached) == 2 else _NOWHERE)
    return Coverage(span, min(sorted(latest.values())[-2:], default=0))


def _begun(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Position:
    """Where the drill was when its recorder had subscribed to all topics."""
    for message in bag.messages(codecs.keys(), _DELAY):
        decoded = _decode(message, codecs)
        if decoded is not None:
            return stretches.of(message)[1], decoded[0]
    return sys.maxsize, 0


def _decode(message: Message, codecs: Mapping[str, Codec]) -> tuple[int, str] | None:
    """Return the stamp of a message [ns], and its state if it is a status."""
    codec = codecs[message.topic]
    try:
        decoded = codec.decode(message.data)
        stamp = decoded.header.stamp
        state = decoded.state if codec.type_name == TOPICS["status"].type else ""
    except (AttributeError, BagFormatError):
        return None
    return join_seconds(stamp.sec, stamp.nanosec), str(state)
