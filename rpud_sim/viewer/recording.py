"""Open bag: its signals, its clocks, and its chunks."""

from __future__ import annotations

from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagChunk, BagError, BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.batches import SerializedBatch, joined, messages_of
from rpud_sim.bag.columns import Column, FieldReader, Kind, usable
from rpud_sim.bag.tables import compiled
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.recorded.run_clock import RunClock
from rpud_sim.simulation.topics import TOPICS

MOST_SIGNALS, MOST_TOPICS = 120, 100  # signals of a bag, and topics with signals
OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many
IMPACTS_TYPE = "rpud_msgs/msg/ContactForce"
TRAJECTORY_TYPE = "rpud_msgs/msg/Trajectory"
JOURNAL_TYPE, FAULTS_TYPE = "rpud_msgs/msg/JournalEntry", "rpud_msgs/msg/Faults"
STATUS_TYPE = "rpud_msgs/msg/Status"

# Parts that are read before the page stands; of the others it has not seen anything yet.
SAMPLED = 48
LATE = 0.5  # longest time from the stamp of a message to that of others logged before it [s]

_KEPT = 96  # parts whose rows, and decoded messages, are kept
_NO_SIGNALS = {"sequence", "sample_period"}  # they number messages, or help to read them


@dataclass(frozen=True)
class RecordedSignal:
    """Column of numbers of one topic."""

    topic: str  # its name
    type: str  # of its messages
    column: str  # its name
    unit: str  # from the comment in the type; empty without one

    @property
    def name(self) -> str:
        return f"{self.topic} {self.column}"

    @property
    def drill(self) -> str:
        return namespace(self.topic)

    @property
    def source(self) -> str:
        """``Type.column``, as the table of quantities names where a quantity comes from."""
        return f"{self.type.rpartition('/')[2]}.{self.column}"


def is_stranger(topic: str) -> bool:
    """Whether a drill has no topic of this name."""
    return topic.rpartition("/")[2] not in TOPICS


def namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


@dataclass(frozen=True)
class Rows:
    """Messages of one topic in a part of a bag."""

    log_times: np.ndarray  # shape (n,) [ns]
    publish_times: np.ndarray  # shape (n,) [ns]
    stamps: np.ndarray  # shape (n,) [ns]; the log times of messages without stamps
    # of each signal, by column, shape (n,); NaN where a value cannot be drawn
    values: dict[str, np.ndarray]


class TopicReader:
    """Reader of the signals of one topic, of which it takes at most so many."""

    def __init__(self, summary: TopicSummary, columns: Sequence[Column], most: int) -> None:
        self.summary, self.topic, self.type = summary, summary.topic.name, summary.topic.type
        self.unreadable = 0  # messages that are not of the type
        self.block = columns[0].name == "time"  # whether a message holds many rows
        stamp = [each for each in columns if each.name == "header.stamp" and each.kind is Kind.TIME]
        numbers = [
            each
            for each in columns
            if each.kind is Kind.NUMBER and each.name not in _NO_SIGNALS and not self.block
        ][:most]
        self.stamped = bool(stamp)
        self.latched = "transient_local" in {each.durability for each in summary.topic.offered_qos}
        self.signals = [
            RecordedSignal(self.topic, self.type, each.name, each.unit) for each in numbers
        ]
        self.codec, _ = compiled(self.type, summary.definition or "")
        self._fields = FieldReader(self.codec, [*stamp, *numbers])

    def read(self, block: SerializedBatch) -> Rows:
        """Return the rows of messages; count those that are not of the type."""
        found = self._fields.read(block)
        self.unreadable += len(found.errors)
        logs, published = block.log_times[found.rows], block.publish_times[found.rows]
        values = {}
        for signal in self.signals:
            numbers = found.array(signal.column).astype(float)
            values[signal.column] = np.where(usable(numbers), numbers, np.nan)
        stamps = found.array("header.stamp") if self.stamped else logs
        return Rows(logs, published, stamps, values)


def topic_readers(bag: BagReader) -> tuple[dict[str, TopicReader], dict[str, str]]:
    """Return the readers of topics by their names, and the reasons why others have none."""
    left_out = {**bag.damages, **bag.left_out}
    readers: dict[str, TopicReader] = {}
    left = MOST_SIGNALS
    for summary in sorted(
        bag.readable_topics, key=lambda each: not each.topic.type.startswith(OURS)
    ):
        name = summary.topic.name
        if name in left_out or not summary.message_count:
            continue
        if len(readers) >= MOST_TOPICS:
            left_out[name] = f"the bag has more than {MOST_TOPICS} topics"
            continue
        try:
            readers[name] = TopicReader(summary, bag.columns(name), left)
        except BagFormatError as error:
            left_out[name] = str(error)
        else:
            left -= len(readers[name].signals)
    return dict(sorted(readers.items())), left_out


PieceRows = dict[str, Rows]  # rows of one part of a bag, by topic


class RecordedBag:
    """Open bag; for one thread at a time.

    Chunks are numbered in the order of their beginnings. A damaged one is empty, and counted.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.bag = rpud_sim.bag.open(path)
        try:
            self.begin = self.bag.start_time  # log time of its beginning [ns]
            # By topic: readers, and reasons why there are no signals.
            self.readers, self.left_out = topic_readers(self.bag)
            self.pieces: list[BagChunk] = self.bag.chunks()
        except BaseException:
            self.bag.close()
            raise
        self.signals = [each for reader in self.readers.values() for each in reader.signals]
        self.damages: dict[int, str] = {}  # reasons why parts are not read, by their numbers
        # Rows of a part by topic, none of a damaged one; those that were used last are kept.
        self.rows = lru_cache(_KEPT)(lambda number: self.rows_of([number]))
        self.decoded = lru_cache(_KEPT)(self._decode)
        self._held = lru_cache(_KEPT)(self._numbers)
        # Topics that show the time of each namespace. Blocks are logged long after their stamps,
        # and latched messages may be old: they do so only where there is nothing else.
        self._timed: dict[str, set[str]] = {}
        for drill in {*map(namespace, self.readers)} or {""}:  # nothing is readable
            own = [each for name, each in self.readers.items() if namespace(name) == drill]
            stamped = [each for each in own if each.stamped]
            prompt = [each for each in stamped if not (each.latched or each.block)]
            self._timed[drill] = {each.topic for each in prompt or stamped or own}
        self._topics = {
            name
            for name, reader in self.readers.items()
            if (reader.signals or reader.stamped)
            and (not reader.block or name in self._timed[namespace(name)])
        }
        self._spans: dict[str, dict[int, tuple[float, float] | None]] = defaultdict(dict)
        self._begun: dict[str, int] = {}  # publishing times of first messages [ns]
        # None of a namespace without stamps, where log times count.
        self.clocks = {drill: self._first_clock(drill) for drill in self._timed}

    def is_drill(self, drill: str) -> bool:
        """Whether a namespace has topics of a drill."""
        ours = [name for name, reader in self.readers.items() if reader.type.startswith(OURS)]
        return drill in map(namespace, ours)

    def topic(self, drill: str, kind: str) -> str:
        """Return the topic of a drill with messages of a type, the drill's own first; or ""."""
        of_kind = [name for name, reader in self.readers.items() if reader.type == kind]
        found = [name for name in of_kind if namespace(name) == drill]
        return min(found, key=is_stranger, default="")

    @property
    def sample(self) -> list[int]:
        """Numbers of the parts that give a first picture."""
        places = np.linspace(0, len(self.pieces) - 1, SAMPLED) if self.pieces else np.empty(0)
        numbers: list[int] = np.unique(places.astype(int)).tolist()
        return numbers

    def rows_of(self, numbers: Iterable[int]) -> PieceRows:
        """Return the rows of several parts together, by topic; they are not kept."""
        by_topic: dict[str, list[SerializedBatch]] = defaultdict(list)
        for number in numbers:
            for block in self._undamaged(number, self._topics):
                by_topic[block.topic].append(block)
        return {
            name: self.readers[name].read(
                blocks[0] if len(blocks) == 1 else joined([block.packed() for block in blocks])
            )
            for name, blocks in by_topic.items()
        }

    def messages(self, number: int, topic: str) -> list[Message]:
        """Return the messages of a topic in a part; none of a damaged one."""
        return [*messages_of(self._undamaged(number, {topic}))]

    def pieces_between(self, drill: str, start: float, end: float) -> Iterator[int]:
        """Yield the numbers of parts that may hold what a drill did from ``start`` to ``end`` [s].

        Times are since the bag began. It reads some parts to find the others.
        """
        for number in self.pieces_from(drill, start):
            times = self.span(drill, number)
            if times is not None and times[0] > end + LATE:
                return
            yield number

    def pieces_from(self, drill: str, time: float, *, back: bool = False) -> Iterator[int]:
        """Yield the numbers of parts from a time [s] on, to the end or to the beginning."""
        held = self._held(drill, len(self.pieces))
        end = partial(self._end, drill)
        if back:
            yield from reversed(held[: bisect_left(held, time + LATE, key=end) + 1])
        else:
            yield from held[bisect_left(held, time - LATE, key=end) :]

    def elapsed(self, topic: str, rows: Rows) -> np.ndarray:
        """Return the times of rows since the bag began [s]."""
        clock = self.clocks[namespace(topic)]
        if clock is None or not self.readers[topic].stamped:
            return (rows.log_times - self.begin) / SECOND
        return clock.elapsed(rows.stamps, rows.publish_times)

    def time_of(self, message: Message, stamp: Any) -> float:
        """Return the time since the bag began [s] of a stamp in a message."""
        clock = self.clocks[namespace(message.topic)]
        if clock is None:
            return (message.log_time - self.begin) / SECOND
        return clock.seconds(join_seconds(stamp.sec, stamp.nanosec), message.publish_time)

    def run(self, message: Message) -> int:
        """Return a number that messages of one run of a drill share."""
        clock = self.clocks[namespace(message.topic)]
        return clock.run(message.publish_time) if clock else 0

    def end_of(self, found: PieceRows) -> float:
        """Return the greatest time since the bag began of some rows [s]; 0 without any."""
        times = [self.elapsed(topic, rows) for topic, rows in found.items()]
        return max((float(each.max()) for each in times if len(each)), default=0.0)

    def set_clock(self, message: Message, entry: Any, time: Any) -> bool:
        """Tell a drill's clock an entry of its journal; return whether time goes on otherwise now.

        Entries of before the bag, which a late recorder gets, tell the origin alone.
        """
        drill, published = namespace(message.topic), message.publish_time
        if (clock := self.clocks[drill]) is None:
            return False
        stamp = join_seconds(entry.header.stamp.sec, entry.header.stamp.nanosec)
        if published < self._begun[drill] - SECOND:
            clock = RunClock(clock.zero)
        elif clock.origin is None:
            clock = RunClock(min(stamp, clock.zero))
        self.clocks[drill] = clock
        self._spans[drill].clear()
        return clock.add(str(entry.kind), stamp, time, published)

    def span(self, drill: str, number: int) -> tuple[float, float] | None:
        """Return the first and the last time of a drill in a part [s]; None if it has none."""
        if number not in self._spans[drill]:
            times = [self.elapsed(name, rows) for name, rows in self._timed_rows(drill, number)]
            ends = [(float(each.min()), float(each.max())) for each in times]
            first, last = zip(*ends, strict=True) if ends else ((), ())
            self._spans[drill][number] = (min(first), max(last)) if ends else None
        return self._spans[drill][number]

    def close(self) -> None:
        self.bag.close()

    def _decode(self, number: int, topic: str) -> list[tuple[Message, Any]]:
        """Return the messages of a topic in a part, as they came and decoded; no others."""
        found = []
        for message in self.messages(number, topic):
            with suppress(BagError):
                found.append((message, self.readers[topic].codec.decode(message.data)))
        return found

    def _numbers(self, drill: str, count: int) -> list[int]:
        """Return which of the first parts hold topics of a drill."""
        parts = enumerate(self.pieces[:count])
        return [number for number, piece in parts if drill in map(namespace, piece.topics)]

    def _undamaged(self, number: int, topics: set[str]) -> list[SerializedBatch]:
        """Return what a part holds of some topics, up to its damage; note the damage."""
        found: list[SerializedBatch] = []
        if not self.pieces[number].topics.isdisjoint(topics):
            try:
                found = self.pieces[number].batches(topics)
            except BagError as error:
                self.damages.setdefault(number, str(error))
        return found

    def _end(self, drill: str, number: int) -> float:
        span = self.span(drill, number)
        return span[1] if span else (self.pieces[number].end_time - self.begin) / SECOND

    def _first_clock(self, drill: str) -> RunClock | None:
        """Return the clock of a namespace by its first messages."""
        for number in self._held(drill, len(self.pieces))[:SAMPLED]:
            found = [rows for _, rows in self._timed_rows(drill, number)]
            if found and self.readers[min(self._timed[drill])].stamped:
                first = min(found, key=lambda rows: rows.stamps[0])
                late = int(first.log_times[0]) - self.begin
                self._begun[drill] = int(first.publish_times[0])
                # A namespace may begin after the bag.
                return RunClock(int(first.stamps[0]) - (late if late > SECOND else 0))
        return None

    def _timed_rows(self, drill: str, number: int) -> list[tuple[str, Rows]]:
        """Return what shows the time of a namespace in a part, by topic."""
        rows = self.rows(number)
        return [(n, rows[n]) for n in self._timed[drill] & rows.keys() if len(rows[n].stamps)]
