"""Journal in a bag: its entries, and the stretches into which they divide the messages."""

from __future__ import annotations

import dataclasses
import json
from bisect import bisect_left, bisect_right
from collections.abc import Iterable, Iterator
from itertools import pairwise

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.simulation.journal import JournalEntry

# Kinds of entries after which stamps may repeat: each begins a stretch, counted from 0.
BEGINNINGS = ("begin", "origin")

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
    the node is its own clock; then their publishing times differ. A bag of a test begins with a
    later number, of an entry with which a run begins. Missing or malformed entries raise an
    UnverifiableError.
    """
    expected = 0
    first = (0, b"")
    for number, message in enumerate(recorded):
        entry = _decode(message, codec)
        if number == 0 and entry.kind == "begin":
            expected = entry.sequence
        published = (message.publish_time, message.data)
        if entry.sequence == 0 and published != first:
            first, expected = published, 0
        if entry.sequence < expected:
            continue
        if entry.sequence > expected:
            missing = f"entries {expected} to {entry.sequence - 1} of the journal are missing"
            late = "; its recorder came too late" if expected == 0 else ""
            raise UnverifiableError(f"{missing}{late}")
        expected += 1
        yield message, entry


def _decode(message: Message, codec: Codec) -> JournalEntry:
    try:
        fields = codec.decode(message.data)
        content = json.loads(fields.content)
        time = content.pop("time")
        if type(time) is not int or time < 0:
            raise ValueError(f"time = {time!r:.40}")
    except (BagFormatError, AttributeError, LookupError, RecursionError, ValueError) as error:
        reason = " ".join(f"{error!r:.120}".split())
        raise UnverifiableError(f"an entry of the journal cannot be understood: {reason}") from None
    return JournalEntry(int(fields.sequence), time, str(fields.kind), content)


class Stretches:
    """Stretches of a journal, each of one simulation and one origin of time.

    Stamps do not identify a stretch: those of different stretches may be equal. Publishing times
    do: the drill publishes entries and messages in one order. An entry may follow the first
    messages of its stretch shortly, but these never precede the entry before it.
    """

    def __init__(self, journal: Iterable[tuple[Message, JournalEntry]]) -> None:
        self.runs = 0  # number of runs that messages can belong to
        self.ended = False  # whether the last entry is the end of the drill
        self._earliest: list[int] = []  # publishing time of a message in each stretch [ns]
        self._begins: list[int] = []  # publishing time of the entry that begins each [ns]
        before, beginning = 0, False
        for message, entry in journal:
            if entry.kind in BEGINNINGS:
                # Entries that begin together are published together.
                self._earliest.append(self._earliest[-1] if beginning else before)
                self._begins.append(message.publish_time)
                self.runs += not beginning
            beginning = entry.kind in BEGINNINGS
            self.ended = entry.kind == "end"
            before = message.publish_time
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
