"""Coverage of a bag: which part of its journal's runs it should hold."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import dataclass

from rpud_sim.bag import BagFormatError, BagReader, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.verify.recorded_journal import Position, Span, Stretches
from rpud_sim.simulation.topics import TOPICS

# Length of the end of a bag that is searched for stamps [ns].
_END_LENGTH = 10 * SECOND
# Longest delay between topics on their way to a recorder [ns].
_TOPIC_DELAY = 1 * SECOND
_NOWHERE: Position = (-1, -1)
_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status


@dataclass(frozen=True)
class Coverage:
    """Part of the runs that a bag covers.

    Args:
        span: in positions of the drill.
        last_stamp: that at least two topics reach, so that one altered stamp changes nothing [ns].
    """

    span: Span
    last_stamp: int


def find_coverage(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Coverage:
    """Return the coverage of a bag.

    The last second of a recording shows nothing about its end: when a recorder closes, messages of
    some topics are still on their way. If the drill ended first, its last status shows the end.

    Args:
        bag: open.
        codecs: of the topics to look at, by name.
        stretches: of its journal.
    """
    start = max(0, bag.duration - _END_LENGTH)
    end = max((int(block.log_times[-1]) for block in bag.blocks(codecs.keys(), start)), default=0)
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
        elif message.log_time <= end - _TOPIC_DELAY:
            # Two messages have to agree, so that one altered stamp changes nothing.
            reached = sorted([*reached, position])[-2:]
    span = Span(_find_begin(bag, codecs, stretches), reached[0] if len(reached) == 2 else _NOWHERE)
    return Coverage(span, min(sorted(latest.values())[-2:], default=0))


def _find_begin(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Position:
    """Return the position of the drill when its recorder had subscribed to all topics."""
    for message in bag.messages(codecs.keys(), _TOPIC_DELAY):
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
