"""Journal in a bag: its codecs and entries; and the progress of a drill that messages show."""

from __future__ import annotations

import json
from collections import OrderedDict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from functools import cache, cached_property
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Kind, columns_of
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.field_values import FieldReader
from rpud_sim.foundation.time import NEVER, SECOND, join_seconds
from rpud_sim.inspection import InspectionError
from rpud_sim.simulation.journal import STARTS, JournalEntry
from rpud_sim.simulation.topics import PROVED, TOPICS

JOURNAL = TOPICS["journal"].type

_STOPPED = "stopped"  # the STATE constant of rpud_msgs/Status
_END_LENGTH = 4 * SECOND  # end of a bag that shows how far a drill came [ns]
_BEYOND = 60 * SECOND  # of an entry after all messages: topics may be silent so long [ns]


class Recorded(NamedTuple):
    """Entry of a journal in a bag."""

    message: Message
    entry: JournalEntry
    fields: Any  # of the decoded message
    stamp: int  # of its header [ns]


class WrongHeader(NamedTuple):
    """Entry whose header does not fit."""

    recorded: Recorded
    field: str  # that does not fit
    value: str
    right: str  # what it should be


# Entries that are compared with those that a recorder repeats at the beginning of a bag's next
# file: it repeats as many as the drill keeps.
_KEPT = TOPICS["journal"].depth


class UnverifiableError(InspectionError):
    """Bag that can be neither proved nor disproved."""


@cache
def installed_codec(type_name: str) -> Codec:
    """Return the codec of a type as it is installed here; making one takes long."""
    return Codec(type_name, find_definition(type_name))


def held_journals(bag: BagReader) -> dict[str, TopicSummary]:
    """Return the journals that have messages, by name, at least one."""
    held = {s.topic.name: s for s in bag.topics if s.topic.type == JOURNAL and s.message_count}
    if not held:
        raise UnverifiableError(
            f"{bag.path} holds no journal; record the topic journal, or all of the namespace"
        )
    return held


def proof_codec(summary: TopicSummary) -> Codec:
    """Return the codec of a topic whose type is the installed one."""
    topic = summary.topic
    own = TOPICS.get(topic.name.rpartition("/")[2])
    expected = JOURNAL if topic.type == JOURNAL or own is None else own.type
    if topic.type != expected:
        raise UnverifiableError(f"the type of {topic.name} is {topic.type:.80}, not {expected}")
    if topic.type_hash not in ("", find_type_hash(expected)):
        raise UnverifiableError(f"{topic.name} is of another version of {expected}")
    return installed_codec(expected)


def _entries(recorded: Iterable[Message], codec: Codec) -> Iterator[Recorded]:
    """Yield a journal's entries with their messages, in order.

    Repeated entries are skipped: a recorder repeats them at the beginning of a bag's next file.
    Number zero begins the journal of another start of the node. Both journals may be equal, where
    the node is its own clock; then their publishing times differ. Without it the journal begins
    with the first entry with which a run can begin: its recorder came late. Missing or malformed
    entries raise an UnverifiableError.
    """
    expected = -1
    first = (0, b"")
    kept: OrderedDict[int, bytes] = OrderedDict()
    for message in recorded:
        found = _decode(message, codec)
        entry = found.entry
        if expected < 0:
            if entry.sequence and entry.kind not in STARTS:
                continue
            expected = entry.sequence
        published = (message.publish_time, message.data)
        if entry.sequence == 0 and published != first:
            first, expected = published, 0
            kept.clear()
        if entry.sequence < expected:
            if kept.get(entry.sequence, message.data) != message.data:
                raise UnverifiableError(
                    f"entry {entry.sequence} of the journal is there twice, with other content"
                )
            continue
        if entry.sequence > expected:
            raise UnverifiableError(
                f"entries {expected} to {entry.sequence - 1} of the journal are missing"
            )
        expected += 1
        kept[entry.sequence] = message.data
        if len(kept) > _KEPT:
            kept.popitem(last=False)
        yield found
    if expected < 0:
        raise UnverifiableError(
            "the journal holds no entry with which a run can begin; its recorder came too late"
        )


def _decode(message: Message, codec: Codec) -> Recorded:
    try:
        fields = codec.decode(message.data)
        content = json.loads(fields.content)
        time = content.pop("time")
        if type(time) is not int or not 0 <= time < NEVER:
            raise ValueError(f"time = {time!r:.40}")
        if fields.kind == "origin" and type(content["origin"]) is not int:
            raise ValueError(f"origin = {content['origin']!r:.40}")
        entry = JournalEntry(int(fields.sequence), time, str(fields.kind), content)
        stamp = fields.header.stamp
        return Recorded(message, entry, fields, join_seconds(stamp.sec, stamp.nanosec))
    except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
        reason = " ".join(f"{error!r:.120}".split())
        raise UnverifiableError(f"an entry of the journal cannot be understood: {reason}") from None


def progress_codecs(bag: BagReader, prefix: str) -> dict[str, Codec]:
    """Return the codecs of a drill's topics that show its progress, by their names."""
    found = {}
    for summary in bag.topics:
        topic = summary.topic
        name = topic.name.removeprefix(prefix)
        if topic.name == name or name not in (*PROVED, "status") or not summary.definition:
            continue
        with suppress(BagFormatError):
            own = TOPICS[name].type
            same = (topic.type, topic.type_hash) == (own, find_type_hash(own))
            found[topic.name] = (
                installed_codec(own) if same else Codec(topic.type, summary.definition)
            )
    return found


class RecordedJournal:
    """Journal in a bag; the other messages of its drill bound how long it is run again."""

    def __init__(self, bag: BagReader, summary: TopicSummary) -> None:
        self.name = summary.topic.name
        self.prefix = self.name[: -len("journal")]  # namespace, with a slash at its end
        self.codecs = progress_codecs(bag, self.prefix)
        self._bag = bag
        self._codec = installed_codec(JOURNAL)
        if summary.topic.type_hash not in ("", find_type_hash(JOURNAL)):
            try:  # every bag's journal is read
                self._codec = Codec(JOURNAL, summary.definition or "")
            except BagFormatError as error:
                raise UnverifiableError(f"{self.name}: {error}") from None

    @cached_property
    def end(self) -> list[tuple[str, np.ndarray]]:
        """Topics, and the progress at their messages, of the end of the bag."""
        start = max(0, self._bag.duration - _END_LENGTH)
        return [*recorded_progress(self._bag, self.codecs, start)]

    @property
    def last(self) -> list[int]:
        """Last stamp of each topic in the end of the bag [ns]."""
        return [*{topic: int(progress["stamp"][-1]) for topic, progress in self.end}.values()]

    def entries(self) -> Iterator[Recorded]:
        """Yield the entries; an UnverifiableError at one of a time that nothing shows.

        It would be run again without an end.
        """
        origin: int | None = None
        begun = 0
        for recorded in _entries(self._bag.messages({self.name}), self._codec):
            entry = recorded.entry
            if entry.kind == "origin":
                origin = int(entry.content["origin"])
            elif origin is None:
                origin, begun = recorded.stamp - entry.time, entry.time
            late = entry.kind == "begin" and entry.time > 0
            if late or not self._shows(origin, entry.time, begun):
                raise UnverifiableError(
                    f"entry {entry.sequence} of the journal ({entry.kind:.20}) is of "
                    f"{entry.time / SECOND:.9g} s, and no other message shows that time"
                )
            yield recorded

    def _shows(self, origin: int, time: int, begun: int) -> bool:
        """Whether messages show a simulation time; log times have to where there are none [ns]."""
        if origin + time <= self._latest_at_end + _BEYOND:
            return True
        if self._latest is not None:
            return origin + time <= self._latest + _BEYOND
        return time - begun <= self._bag.duration + _BEYOND

    @cached_property
    def _latest_at_end(self) -> int:
        return agreed(_latest(self.end))

    @cached_property
    def _latest(self) -> int | None:
        """Latest stamp of the whole bag, which need not be at its end; None without any [ns]."""
        found = _latest(recorded_progress(self._bag, self.codecs, 0))
        return agreed(found) if found else None


def _latest(shown: Iterable[tuple[str, np.ndarray]]) -> list[int]:
    """Return the greatest stamp of each topic [ns]."""
    found: dict[str, int] = {}
    for topic, progress in shown:
        found[topic] = max(int(progress["stamp"].max()), found.get(topic, 0))
    return [*found.values()]


def agreed(stamps: Iterable[int]) -> int:
    """Return the greatest stamp that two topics reach, so that one altered stamp changes nothing.

    It is that of the only topic if there is no other, and 0 without any [ns].
    """
    return min(sorted(stamps)[-2:], default=0)


def with_wrong_header(
    journal: Iterable[Recorded],
) -> Iterator[tuple[Recorded, WrongHeader | None]]:
    """Yield each entry, and how its header does not fit; None if it does.

    The stamp is the entry's time under an origin in force: the one before it, or one that another
    entry of the same time sets, for they are published together.
    """
    before: list[int] = []
    frame = TOPICS["journal"].frame
    for time, group in groupby(journal, lambda each: each.entry.time):
        entries = list(group)
        origins = [e.entry.content["origin"] for e in entries if e.entry.kind == "origin"]
        for each in entries:
            allowed = origins if each.entry.kind == "origin" else [*before, *origins]
            wrong, own = None, each.fields.header.frame_id
            if own != frame:
                wrong = WrongHeader(each, "header.frame_id", f"{own!r:.80}", f"{frame!r}")
            elif allowed and each.stamp - time not in allowed:
                right = str(time + allowed[-1])
                wrong = WrongHeader(each, "header.stamp", str(each.stamp), right)
            yield each, wrong
        before = origins[-1:] or before


# Progress of a drill at one message. Times are in nanoseconds. Only a status says whether the drill
# stopped, and counts the journal's entries so far: -1 elsewhere.
PROGRESS = np.dtype(
    [
        ("log_time", np.uint64),
        ("published", np.int64),
        ("stamp", np.int64),
        ("status", np.bool_),
        ("stopped", np.bool_),
        ("entries", np.int64),
    ]
)


def recorded_progress(
    bag: BagReader, codecs: Mapping[str, Codec], start: int, duration: int | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """Yield topics, and ``PROGRESS`` (n,) at some of their messages, those that can be read.

    ``start`` counts from the beginning of the bag [ns].
    """
    readers = {}
    for topic, codec in codecs.items():
        wanted = {"header.stamp": Kind.TIME}
        if codec.type.name == TOPICS["status"].type:
            wanted |= {"state": Kind.TEXT, "journal_entries": Kind.NUMBER}
        columns = [c for c in columns_of(codec, "") if wanted.get(c.attribute) is c.kind]
        names = {column.attribute: column.name for column in columns}
        if "header.stamp" in names:
            readers[topic] = names, FieldReader(codec, columns)
    for block in bag.blocks(readers.keys(), start, duration):
        names, reader = readers[block.topic]
        values = reader.read(block)
        held = {attribute: values.columns[name] for attribute, name in names.items()}
        found = np.zeros(len(values.rows), PROGRESS)
        found["log_time"] = block.log_times[values.rows]
        found["published"] = block.publish_times[values.rows]
        found["stamp"] = held["header.stamp"]
        found["entries"] = -1
        if "state" in held:
            found["status"] = held["state"] != ""
            found["stopped"] = held["state"] == _STOPPED
            found["entries"] = held.get("journal_entries", -1)
        if len(found):
            yield block.topic, found
