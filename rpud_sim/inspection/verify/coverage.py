"""Coverage of a bag: the stretches of its journal, and which part of them it should hold."""

from __future__ import annotations

import contextlib
import sys
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.recorded_journal import (
    PROGRESS,
    Recorded,
    RecordedJournal,
    WrongHeader,
    agreed,
    with_wrong_header,
)
from rpud_sim.inspection.recorded_topics import leading

# Kinds of entries after which stamps may repeat: each begins a stretch, counted from 0.
BEGINNINGS = ("begin", "origin")

Position = tuple[int, int]  # progress of the drill: number of the stretch, and the stamp in it [ns]

# Longest delay between topics on their way to a recorder [ns].
_TOPIC_DELAY = 1 * SECOND
_NOWHERE: Position = (-1, -1)


class JournalStretches:
    """Stretches of a journal, each of one simulation and one origin of time.

    Stamps do not identify a stretch: those of different stretches may be equal. Publishing times
    do: the drill publishes entries and messages in one order. An entry may follow the first
    messages of its stretch shortly, but these never precede the entry before it.
    """

    def __init__(self, journal: Iterable[Recorded]) -> None:
        self.runs = 0  # number of runs that messages can belong to
        self.ended = False  # whether the last entry is the end of the drill
        self.count = 0  # entries that the drill has made, if it made none after the last one
        self.first: Recorded | None = None
        self.wrong: WrongHeader | None = None  # the first one
        self.last_published = 0  # publishing time of the last entry [ns]
        earliest: list[int] = []  # publishing time of a message in each stretch [ns]
        begins: list[int] = []  # publishing time of the entry that begins each [ns]
        before, beginning = 0, False
        for recorded, wrong in with_wrong_header(journal):
            entry, published = recorded.entry, recorded.message.publish_time
            self.first = self.first or recorded
            self.wrong = self.wrong or wrong
            if entry.kind in BEGINNINGS or not begins:
                # Entries that begin together are published together.
                earliest.append(earliest[-1] if beginning else before)
                begins.append(published)
                self.runs += not beginning
            beginning = entry.kind in BEGINNINGS
            self.ended = entry.kind == "end"
            self.count = entry.sequence + 1
            before = self.last_published = published
        self._edges = [np.array(times, np.int64) for times in (begins, earliest)]
        # False if the clock was set back meanwhile, or if another program wrote these times.
        self._ordered = all((np.diff(times) >= 0).all() for times in self._edges)

    def fitting(self, stretch: int, publish_times: np.ndarray) -> int:
        """Return how many messages, from the first on, may belong to a stretch by these times."""
        first, last = self.ranges(publish_times)
        fit = (first <= stretch) & (stretch <= last)
        return leading(fit)

    def ranges(self, publish_times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the first and the last stretch that messages may belong to, by these times."""
        begins, earliest = self._edges
        final = max(0, len(begins) - 1)
        if not self._ordered:
            return np.zeros(len(publish_times), np.int64), np.full(len(publish_times), final)
        first = np.maximum(np.searchsorted(begins, publish_times) - 1, 0)
        last = np.searchsorted(earliest, publish_times, side="right") - 1
        return first, np.minimum(np.maximum(first, last), final)

    def of(self, message: Message) -> tuple[int, int]:
        """Return the first and the last stretch that a message may belong to."""
        first, last = self.ranges(np.array([message.publish_time]))
        return int(first[0]), int(last[0])


@dataclass(frozen=True)
class Coverage:
    """Part of the runs that a bag covers."""

    begun: Position  # from here on, the bag should hold a topic that it holds at all
    reached: Position  # up to here it should hold it, as all of its topics together show
    last_stamp: int  # that at least two topics reach [ns]
    # publishing time up to which the journal holds every entry [ns]; None if that is the end
    journal_until: int | None
    journal_count: int  # entries that the drill counted last in a status; 0 if it did not


def find_coverage(
    bag: BagReader, journal: RecordedJournal, stretches: JournalStretches
) -> Coverage:
    """Return the coverage of a bag.

    The last second of a recording shows nothing about its end: when a recorder closes, messages of
    some topics are still on their way. If the drill ended first, its last status shows the end.
    """
    found = np.concatenate([np.empty(0, PROGRESS), *(progress for _, progress in journal.end)])
    end = int(found["log_time"].max(initial=0))
    return Coverage(
        _find_begin(bag, journal.codecs, stretches),
        _reached(found, end, stretches),
        agreed(journal.last),
        *_journal_until(found, end, stretches),
    )


def _journal_until(
    found: np.ndarray, end: int, stretches: JournalStretches
) -> tuple[int | None, int]:
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


def _reached(found: np.ndarray, end: int, stretches: JournalStretches) -> Position:
    """Return the position that the drill reached while all topics were recorded.

    ``found`` is the progress at the messages of the end of a bag, ``end`` the log time of the last
    of them [ns].
    """
    counted = found["log_time"] <= max(0, end - _TOPIC_DELAY)
    numbers, _ = stretches.ranges(found["published"])
    positions: list[Position] = []
    if stretches.ended and found["stopped"].any():
        stops = np.flatnonzero(found["stopped"])
        stop = stops[np.argmax(found["log_time"][stops])]
        positions = 2 * [(int(numbers[stop]), int(found["stamp"][stop]))]
        counted &= found["log_time"] > found["log_time"][stop]
    # Some messages with this very stamp follow, but none of them follows a status.
    stamps = (found["stamp"] - ~found["status"])[counted]
    last = np.lexsort((stamps, numbers[counted]))[-2:]
    positions += zip(numbers[counted][last].tolist(), stamps[last].tolist(), strict=True)
    # Two messages have to agree, so that one altered stamp changes nothing.
    return sorted(positions)[-2] if len(positions) > 1 else _NOWHERE


def _find_begin(
    bag: BagReader, codecs: Mapping[str, Codec], stretches: JournalStretches
) -> Position:
    for message in bag.messages(codecs.keys(), _TOPIC_DELAY):
        with contextlib.suppress(AttributeError, BagFormatError):
            stamp = codecs[message.topic].decode(message.data).header.stamp
            return stretches.of(message)[1], join_seconds(stamp.sec, stamp.nanosec)
    return sys.maxsize, 0
