"""Coverage of a bag: which part of its journal's runs it should hold."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Kind, columns_of
from rpud_sim.bag.field_values import FieldReader
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.verify.recorded_journal import Position, Span, Stretches
from rpud_sim.simulation.topics import TOPICS

# Length of the end of a bag that is searched for stamps [ns].
_END_LENGTH = 4 * SECOND
# Longest delay between topics on their way to a recorder [ns].
_TOPIC_DELAY = 1 * SECOND
_NOWHERE: Position = (-1, -1)
# Progress of the drill at a message; only a status says whether the drill stopped.
_PROGRESS = np.dtype(
    [
        ("log_time", np.uint64),
        ("stretch", np.int64),
        ("stamp", np.int64),
        ("status", np.bool_),
        ("stopped", np.bool_),
        ("published", np.int64),
        ("entries", np.int64),  # of the journal so far; -1 if it is no status
    ]
)
_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status


@dataclass(frozen=True)
class Coverage:
    """Part of the runs that a bag covers."""

    span: Span  # in positions of the drill
    # that at least two topics reach, so that one altered stamp changes nothing [ns]
    last_stamp: int
    # publishing time up to which the journal holds every entry [ns]; None if that is the end
    journal_until: int | None
    journal_count: int  # entries that the drill counted last in a status; 0 if it did not


def find_coverage(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Coverage:
    """Return the coverage of a bag.

    The last second of a recording shows nothing about its end: when a recorder closes, messages of
    some topics are still on their way. If the drill ended first, its last status shows the end.
    """
    start = max(0, bag.duration - _END_LENGTH)
    readers = {topic: _StampReader(codec) for topic, codec in codecs.items()}
    end = 0
    latest: dict[str, int] = {}
    parts: list[np.ndarray] = [np.empty(0, _PROGRESS)]
    for block in bag.blocks(codecs.keys(), start):
        end = max(end, int(block.log_times[-1]))
        found = readers[block.topic].read(block, stretches)
        if len(found):
            latest[block.topic] = int(found["stamp"][-1])
            parts.append(found)
    reached = _reached(np.concatenate(parts), end, stretches.ended)
    span = Span(_find_begin(bag, codecs, stretches), reached)
    last_stamp = min(sorted(latest.values())[-2:], default=0)
    return Coverage(span, last_stamp, *_journal_until(np.concatenate(parts), end, stretches))


def _journal_until(found: np.ndarray, end: int, stretches: Stretches) -> tuple[int | None, int]:
    """Return ``journal_until`` and ``journal_count`` of a coverage; see ``_reached``.

    A status counts the journal's entries. Without one that counts more than there are, the journal
    is complete but for the last second, in which an entry may be still on its way.
    """
    if stretches.ended:
        return None, 0
    counts = found[found["entries"] >= 0]
    confirmed = counts["published"][counts["entries"] <= stretches.count]
    until = max(stretches.last_published, int(confirmed.max(initial=0)))
    count = int(counts["entries"].max(initial=0))
    if count <= stretches.count:
        sure = found["published"][found["log_time"] <= max(0, end - _TOPIC_DELAY)]
        until = max(until, int(sure.max(initial=0)))
    return until, count


def _reached(found: np.ndarray, end: int, ended: bool) -> Position:
    """Return the position that the drill reached while all topics were recorded.

    ``found`` is the progress at the messages of the end of a bag, ``end`` the log time of the last
    of them [ns], and ``ended`` says whether the journal has the end of the drill.
    """
    counted = found["log_time"] <= max(0, end - _TOPIC_DELAY)
    positions: list[Position] = []
    if ended and found["stopped"].any():
        stops = np.flatnonzero(found["stopped"])
        stop = found[stops[np.argmax(found["log_time"][stops])]]
        positions = 2 * [(int(stop["stretch"]), int(stop["stamp"]))]
        counted &= found["log_time"] > stop["log_time"]
    stretches, stamps = found["stretch"][counted], found["stamp"][counted]
    # Some messages with this very stamp follow, but none of them follows a status.
    stamps = stamps - ~found["status"][counted]
    last = np.lexsort((stamps, stretches))[-2:]
    positions += zip(stretches[last].tolist(), stamps[last].tolist(), strict=True)
    # Two messages have to agree, so that one altered stamp changes nothing.
    return sorted(positions)[-2] if len(positions) > 1 else _NOWHERE


class _StampReader:
    def __init__(self, codec: Codec) -> None:
        columns = {column.attribute: column for column in columns_of(codec, "")}
        stamp = columns.get("header.stamp")
        state = columns.get("state") if codec.type_name == TOPICS["status"].type else None
        self._stamp = stamp.name if stamp and stamp.kind is Kind.TIME else ""
        self._state = state.name if state and state.kind is Kind.TEXT else ""
        entries = columns.get("journal_entries") if self._state else None
        self._entries = entries.name if entries and entries.kind is Kind.NUMBER else ""
        wanted = {self._stamp, self._state, self._entries}
        chosen = [column for column in columns.values() if column.name in wanted]
        self._reader = FieldReader(codec, chosen)

    def read(self, block: MessageBlock, stretches: Stretches) -> np.ndarray:
        """Return the progress of the drill at messages, without those that cannot be read."""
        if not self._stamp:
            return np.empty(0, _PROGRESS)
        values = self._reader.read(block)
        found = np.zeros(len(values.rows), _PROGRESS)
        found["log_time"] = block.log_times[values.rows]
        found["published"] = block.publish_times[values.rows]
        found["entries"] = values.columns[self._entries] if self._entries else -1
        found["stamp"] = values.columns[self._stamp]
        found["stretch"], _ = stretches.ranges(block.publish_times[values.rows])
        if self._state:
            states = values.columns[self._state]
            found["status"] = states != ""
            found["stopped"] = states == _STOPPED
        return found


def _find_begin(bag: BagReader, codecs: Mapping[str, Codec], stretches: Stretches) -> Position:
    for message in bag.messages(codecs.keys(), _TOPIC_DELAY):
        with contextlib.suppress(AttributeError, BagFormatError):
            stamp = codecs[message.topic].decode(message.data).header.stamp
            return stretches.of(message)[1], join_seconds(stamp.sec, stamp.nanosec)
    return sys.maxsize, 0
