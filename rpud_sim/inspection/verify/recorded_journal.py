"""Journal in a bag: its entries, and the stretches into which they divide the messages."""

from __future__ import annotations

import dataclasses
import json
from bisect import bisect_left, bisect_right
from collections import OrderedDict
from collections.abc import Iterable, Iterator
from itertools import groupby, pairwise

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import NEVER, join_seconds
from rpud_sim.simulation.journal import STARTS, JournalEntry
from rpud_sim.simulation.topics import TOPICS

# Kinds of entries after which stamps may repeat: each begins a stretch, counted from 0.
BEGINNINGS = ("begin", "origin")
# Entries that are compared with those that a recorder repeats at the beginning of a bag's next
# file: it repeats as many as the drill keeps.
_KEPT = TOPICS["journal"].depth

Position = tuple[int, int]  # progress of the drill: number of the stretch, and the stamp in it [ns]


class UnverifiableError(Exception):
    """Bag that can be neither proved nor disproved; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Span:
    """Part of the runs that a bag covers, as all of its topics together show."""

    begun: Position  # from here on, the bag should hold a topic that it holds at all
    reached: Position  # up to here it should hold it


def journal_entries(
    recorded: Iterable[Message], codec: Codec
) -> Iterator[tuple[Message, JournalEntry]]:
    """Yield the journal's entries with their messages, in order.

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
        entry = _decode(message, codec)
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
        yield message, entry
    if expected < 0:
        raise UnverifiableError(
            "the journal holds no entry with which a run can begin; its recorder came too late"
        )


def _decode(message: Message, codec: Codec) -> JournalEntry:
    try:
        fields = codec.decode(message.data)
        content = json.loads(fields.content)
        time = content.pop("time")
        if type(time) is not int or not 0 <= time < NEVER:
            raise ValueError(f"time = {time!r:.40}")
    except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
        reason = " ".join(f"{error!r:.120}".split())
        raise UnverifiableError(f"an entry of the journal cannot be understood: {reason}") from None
    return JournalEntry(int(fields.sequence), time, str(fields.kind), content)


def wrong_header(
    journal: Iterable[tuple[Message, JournalEntry]], codec: Codec
) -> tuple[Message, JournalEntry, str, str, str] | None:
    """Return the first entry whose header does not fit; its field, its value and the right one.

    The stamp is the entry's time under an origin in force: the one before it, or one that another
    entry of the same time sets, for they are published together.
    """
    before: list[int] = []
    frame = TOPICS["journal"].frame
    for time, group in groupby(journal, lambda each: each[1].time):
        entries = list(group)
        origins = [entry.content["origin"] for _, entry in entries if entry.kind == "origin"]
        for message, entry in entries:
            header = codec.decode(message.data).header
            if header.frame_id != frame:
                return message, entry, "header.frame_id", f"{header.frame_id!r:.80}", f"{frame!r}"
            own = join_seconds(header.stamp.sec, header.stamp.nanosec) - time
            allowed = origins if entry.kind == "origin" else [*before, *origins]
            if allowed and own not in allowed:
                return message, entry, "header.stamp", str(time + own), str(time + allowed[-1])
        before = origins[-1:] or before
    return None


class Stretches:
    """Stretches of a journal, each of one simulation and one origin of time.

    Stamps do not identify a stretch: those of different stretches may be equal. Publishing times
    do: the drill publishes entries and messages in one order. An entry may follow the first
    messages of its stretch shortly, but these never precede the entry before it.
    """

    def __init__(self, journal: Iterable[tuple[Message, JournalEntry]]) -> None:
        self.runs = 0  # number of runs that messages can belong to
        self.ended = False  # whether the last entry is the end of the drill
        self.count = 0  # entries that the drill has made, if it made none after the last one
        self.first: tuple[Message, JournalEntry] | None = None
        self.last_published = 0  # publishing time of the last entry [ns]
        self._earliest: list[int] = []  # publishing time of a message in each stretch [ns]
        self._begins: list[int] = []  # publishing time of the entry that begins each [ns]
        before, beginning = 0, False
        for message, entry in journal:
            if self.first is None:
                self.first = message, entry
            if entry.kind in BEGINNINGS or not self._begins:
                # Entries that begin together are published together.
                self._earliest.append(self._earliest[-1] if beginning else before)
                self._begins.append(message.publish_time)
                self.runs += not beginning
            beginning = entry.kind in BEGINNINGS
            self.ended = entry.kind == "end"
            self.count = entry.sequence + 1
            before = self.last_published = message.publish_time
        # False if the clock was set back meanwhile, or if another program wrote these times.
        self._ordered = all(
            first <= second
            for times in (self._earliest, self._begins)
            for first, second in pairwise(times)
        )

    def fitting(self, stretch: int, publish_times: np.ndarray) -> int:
        """Return how many messages, from the first on, may belong to a stretch by these times [ns].

        Stretches ascend with the times. So if the earliest and the latest time fit, all do.
        """
        if (
            self._range(int(publish_times.max()))[0] <= stretch
            and stretch <= self._range(int(publish_times.min()))[1]
        ):
            return len(publish_times)
        first, last = self.ranges(publish_times)
        return int(np.argmin((first <= stretch) & (stretch <= last)))

    def ranges(self, publish_times: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the first and the last stretch that messages may belong to, by these times."""
        final = max(0, len(self._begins) - 1)
        if not self._ordered:
            return np.zeros(len(publish_times), np.int64), np.full(len(publish_times), final)
        first = np.maximum(np.searchsorted(self._begins, publish_times) - 1, 0)
        last = np.searchsorted(self._earliest, publish_times, side="right") - 1
        return first, np.minimum(np.maximum(first, last), final)

    def of(self, message: Message) -> tuple[int, int]:
        """Return the first and the last stretch that a message may belong to."""
        return self._range(message.publish_time)

    def _range(self, publish_time: int) -> tuple[int, int]:
        """Return the first and the last stretch of a publishing time [ns]."""
        final = max(0, len(self._begins) - 1)
        if not self._ordered:
            return 0, final
        first = bisect_left(self._begins, publish_time) - 1
        last = bisect_right(self._earliest, publish_time) - 1
        return max(0, first), min(max(0, first, last), final)
