"""Journals in bags: their entries in order, and how far their drills came.

The entries and every message that a drill published show its progress: a journal alone could name
any time, and its run would never end.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import cached_property
from itertools import groupby
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.foundation.terminal import error_text
from rpud_sim.foundation.time import NEVER, SECOND, join_seconds
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import FieldReader, Kind, columns_of
from rpud_sim.messages.definitions import find_type_hash, installed_codec
from rpud_sim.recorded import RecordingError
from rpud_sim.simulation.changes import ChangeError
from rpud_sim.simulation.plan import JournalEntry, StrataTexts
from rpud_sim.simulation.topics import PROVED, TOPICS

JOURNAL = TOPICS["journal"].type

_MOST_ENTRIES = 2_000_000  # of a journal, twice as many as a drill keeps
_END_LENGTH = 4 * SECOND  # end of a bag that shows how far a drill came [ns]
_TWO_WAYS = SECOND // 10  # longest time between the two publishing times of one entry [ns]
_BEYOND = 60 * SECOND  # of an entry after all messages: topics may be silent so long [ns]


class UnverifiableError(RecordingError):
    """Bag that can be neither proved nor disproved."""


class RecordedEntry(NamedTuple):
    """Entry of a journal in a bag."""

    entry: JournalEntry
    stamp: int  # of its header [ns]
    frame: str  # of its header
    log_time: int  # [ns]
    publish_time: int  # [ns]


def held_journals(bag: BagReader) -> dict[str, TopicSummary]:
    """Return the journals that have messages, by name, at least one."""
    held = {s.topic.name: s for s in bag.topics if s.topic.type == JOURNAL and s.message_count}
    if not held:
        raise UnverifiableError(
            f"{bag.path} holds no journal; record the topic journal, or all of the namespace"
        )
    return held


def _content(recorded: RecordedEntry) -> tuple[JournalEntry, int, str]:
    return recorded.entry, recorded.stamp, recorded.frame


def _is_same(one: RecordedEntry, other: RecordedEntry) -> bool:
    """Whether one entry came twice, by its topic and when asked for, each with its own time."""
    near = abs(one.publish_time - other.publish_time) < _TWO_WAYS
    return near and _content(one) == _content(other)


class RecordedJournal:
    """Journal in a bag; the other messages of its drill bound how long it is run again."""

    def __init__(self, bag: BagReader, summary: TopicSummary) -> None:
        self.name = summary.topic.name
        self._bag = bag
        self._codec = installed_codec(JOURNAL)
        self._progress = progress_readers(bag, self.name[: -len("journal")])
        if summary.topic.type_hash not in ("", find_type_hash(JOURNAL)):
            try:  # every bag's journal is read
                self._codec = Codec(JOURNAL, summary.definition or "")
            except BagFormatError as error:
                raise UnverifiableError(f"{self.name}: {error}") from None

    def entries(self) -> Iterator[RecordedEntry]:
        """Yield the entries in the order of publishing, each once, with the strata of their run."""
        found: list[RecordedEntry] = []
        for message in self._bag.messages({self.name}):
            found.append(self._decode(message))
            if len(found) > _MOST_ENTRIES:
                raise UnverifiableError(f"{self.name} has more than {_MOST_ENTRIES} entries")
        # A recorder that asked for entries has them later than others, or twice.
        found.sort(key=lambda each: (each.publish_time, each.entry.sequence))
        starts: list[dict[int, RecordedEntry]] = []  # of the drill, by the numbers of their entries
        for each in found:
            number = each.entry.sequence
            if any(number in held and _is_same(each, held[number]) for held in starts):
                continue
            other = starts[-1].get(number) if starts else None
            if starts and other is None:
                starts[-1][number] = each
            elif other is not None and other.publish_time == each.publish_time:
                raise UnverifiableError(
                    f"entry {number} of the journal is there twice, with other content"
                )
            elif other is None or not (number and _content(each) == _content(other)):
                starts.append({number: each})
        latest = 0  # publishing time: a clock may have been set back, and numbers are right
        for held in starts:
            strata = StrataTexts()
            for number in sorted(held):
                latest = max(latest, held[number].publish_time)
                entry = held[number].entry
                if entry.kind == "begin":
                    try:
                        entry = replace(entry, content=strata.complete(number, entry.content))
                    except ChangeError as error:
                        raise UnverifiableError(f"{self.name}: {error}") from None
                yield held[number]._replace(entry=entry, publish_time=latest)

    def _decode(self, message: Message) -> RecordedEntry:
        try:
            fields = self._codec.decode(message.data)
            content = json.loads(fields.content)
            time = content.pop("time")
            if type(time) is not int or not 0 <= time < NEVER:
                raise ValueError(f"time = {time!r:.40}")
            if fields.kind == "origin" and type(content["origin"]) is not int:
                raise ValueError(f"origin = {content['origin']!r:.40}")
            entry = JournalEntry(int(fields.sequence), time, str(fields.kind), content)
            stamp = join_seconds(fields.header.stamp.sec, fields.header.stamp.nanosec)
            frame = str(fields.header.frame_id)
            return RecordedEntry(entry, stamp, frame, message.log_time, message.publish_time)
        except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
            text = f"an entry of the journal cannot be understood: {error_text(error)}"
            raise UnverifiableError(text) from None

    def check(self, entries: Iterable[RecordedEntry]) -> None:
        """Raise an UnverifiableError at an entry of a run whose time nothing shows.

        It would be run again without an end.
        """
        origin: int | None = None
        for each in entries:
            entry = each.entry
            if entry.kind == "origin":
                origin = int(entry.content["origin"])
            elif origin is None:
                origin = each.stamp - entry.time
            late = entry.kind == "begin" and entry.time > 0
            if late or not self._shows(origin, entry.time):
                raise UnverifiableError(
                    f"entry {entry.sequence} of the journal ({entry.kind:.20}) is of "
                    f"{entry.time / SECOND:.9g} s, and no other message shows that time"
                )

    def _shows(self, origin: int, time: int) -> bool:
        """Whether messages show a simulation time; log times have to where there are none [ns]."""
        if origin + time <= self._latest_at_end + _BEYOND:
            return True
        if self._latest is not None:
            return origin + time <= self._latest + _BEYOND
        return time <= self._bag.duration + _BEYOND

    def progress(self, window: tuple[int, int], *, at_end: bool) -> dict[str, np.ndarray]:
        """Return the progress by topic of what was published in a window [ns].

        ``at_end`` looks at the end of the bag alone.
        """
        parts: dict[str, list[np.ndarray]] = {}
        start = self._end_start if at_end else 0
        for topic, found in recorded_progress(self._bag, self._progress, start):
            if (own := within(found["published"], window)).any():
                parts.setdefault(topic, []).append(found[own])
        return {topic: np.concatenate(found) for topic, found in parts.items()}

    @property
    def _end_start(self) -> int:
        return max(0, self._bag.duration - _END_LENGTH)

    @cached_property
    def _latest_at_end(self) -> int:
        return common_stamp(_latest(recorded_progress(self._bag, self._progress, self._end_start)))

    @cached_property
    def _latest(self) -> int | None:
        """Latest stamp of the whole bag, which need not be at its end; None without any [ns]."""
        found = _latest(recorded_progress(self._bag, self._progress, 0))
        return common_stamp(found) if found else None


def within(times: np.ndarray, window: tuple[int, int]) -> np.ndarray:
    """Return which times lie in a window, both ends included, shape (n,)."""
    return (times >= window[0]) & (times <= window[1])


def _latest(shown: Iterable[tuple[str, np.ndarray]]) -> list[int]:
    """Return the greatest stamp of each topic [ns]."""
    found: dict[str, int] = {}
    for topic, progress in shown:
        found[topic] = max(int(progress["stamp"].max()), found.get(topic, 0))
    return [*found.values()]


def common_stamp(stamps: Iterable[int]) -> int:
    """Return the greatest stamp that two topics reach, so that one altered stamp changes nothing.

    It is the origin of the only topic if there is no other, and 0 without any [ns].
    """
    return min(sorted(stamps)[-2:], default=0)


class WrongHeader(NamedTuple):
    """Entry whose header does not fit."""

    recorded: RecordedEntry
    field: str  # that does not fit
    value: str
    right: str  # what it should be


def wrong_header(entries: Sequence[RecordedEntry]) -> WrongHeader | None:
    """Return the first entry of a run whose header does not fit; None if all do.

    The stamp is the entry's time under an origin active: the one before it, or one that another
    entry of the same time sets, for they are published together.
    """
    before: list[int] = []
    begun = entries[0].entry.content.get("parameters") if entries else None
    prefix = begun.get("frame_prefix", "") if isinstance(begun, Mapping) else ""
    frame = f"{prefix}{TOPICS['journal'].frame}"
    for time, group in groupby(entries, lambda each: each.entry.time):
        together = list(group)
        origins = [e.entry.content["origin"] for e in together if e.entry.kind == "origin"]
        for each in together:
            allowed = origins if each.entry.kind == "origin" else [*before, *origins]
            if each.frame != frame:
                return WrongHeader(each, "header.frame_id", f"{each.frame!r:.80}", f"{frame!r}")
            if allowed and each.stamp - time not in allowed:
                right = str(time + allowed[-1])
                return WrongHeader(each, "header.stamp", str(each.stamp), right)
        before = origins[-1:] or before
    return None


# Progress of a drill at one message. Times are in nanoseconds. Only a status shows whether the
# drill stopped, and counts the journal's entries so far: -1 elsewhere.
PROGRESS = np.dtype(
    [
        ("log_time", np.int64),
        ("published", np.int64),
        ("stamp", np.int64),
        ("stopped", np.bool_),
        ("entries", np.int64),
    ]
)
_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status

ProgressReaders = Mapping[str, tuple[Mapping[str, str], FieldReader]]


def progress_readers(bag: BagReader, prefix: str) -> ProgressReaders:
    """Return readers of a drill's topics that show its progress, by the names of the topics."""
    found = {}
    for summary in bag.topics:
        topic = summary.topic
        name = topic.name.removeprefix(prefix)
        if topic.name == name or name not in (*PROVED, "status") or not summary.definition:
            continue
        with suppress(BagFormatError):
            own = TOPICS[name].type
            same = (topic.type, topic.type_hash) == (own, find_type_hash(own))
            codec = installed_codec(own) if same else Codec(topic.type, summary.definition)
            wanted = {"header.stamp": Kind.TIME}
            if codec.type == TOPICS["status"].type:
                wanted |= {"state": Kind.TEXT, "journal_entries": Kind.NUMBER}
            columns = [c for c in columns_of(codec, "") if wanted.get(c.attribute) is c.kind]
            names = {column.attribute: column.name for column in columns}
            if "header.stamp" in names:
                found[topic.name] = names, FieldReader(codec, columns)
    return found


def recorded_progress(
    bag: BagReader, readers: ProgressReaders, start: int, duration: int | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield topics, and ``PROGRESS`` (n,) at some of their messages, those that can be read.

    ``start`` counts from the beginning of the bag [ns].
    """
    for block in bag.batches(readers.keys(), start, duration):
        names, reader = readers[block.topic]
        values = reader.read(block)
        held = {attribute: values.columns[name] for attribute, name in names.items()}
        found = np.zeros(len(values.rows), PROGRESS)
        found["log_time"] = block.log_times[values.rows]
        found["published"] = block.publish_times[values.rows]
        found["stamp"] = held["header.stamp"]
        found["entries"] = -1
        if "state" in held:
            found["stopped"] = held["state"] == _STOPPED
            found["entries"] = held.get("journal_entries", -1)
        if len(found):
            yield block.topic, found
