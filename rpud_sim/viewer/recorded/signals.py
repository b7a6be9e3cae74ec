"""Signals of a bag: the numbers that can be drawn over time, and how they are read."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.columns import Column, Kind, usable
from rpud_sim.bag.field_values import FieldReader
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.tables import compiled, late_messages

MOST_SIGNALS = 120  # greatest number of signals of a bag
MOST_TOPICS = 100  # greatest number of topics with signals

IMPACTS = "rpud_msgs/msg/ContactForce"
TRAJECTORY = "rpud_msgs/msg/Trajectory"
JOURNAL, FAULTS = "rpud_msgs/msg/JournalEntry", "rpud_msgs/msg/Faults"
STATUS = "rpud_msgs/msg/Status"
WAVEFORM = "rpud_msgs/msg/Waveform"
PEAK_FORCE = "peak_force"  # column of an impact

# Numbers of messages, and what only helps to read them.
_NO_SIGNALS = {"sequence", "sample_period"}
_OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many


@dataclass(frozen=True)
class Signal:
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


def namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


@dataclass(frozen=True)
class Rows:
    """Messages of one topic in a part of a bag."""

    log_times: np.ndarray  # shape (n,) [ns]
    stamps: np.ndarray  # shape (n,) [ns]; the log times of messages without stamps
    # of each signal, by column, shape (n,); NaN where a value cannot be drawn
    values: dict[str, np.ndarray]


@dataclass
class TopicReader:
    """Reader of the signals of one topic."""

    summary: TopicSummary  # of the topic
    columns: Sequence[Column]  # of its table
    unreadable: int = 0  # messages that are not of the type
    reason: str = ""  # of the first of these
    stamped: bool = field(init=False)
    block: bool = field(init=False)
    signals: tuple[Signal, ...] = field(init=False)

    def __post_init__(self) -> None:
        topic = self.summary.topic
        self.block = self.columns[0].name == "time"
        names = {column.name: column for column in self.columns}
        stamp = names.get("header.stamp")
        self.stamped = stamp is not None and stamp.kind is Kind.TIME
        self.stamped &= stamp_column(self.columns) != "log_time"
        numbers = [
            column
            for column in self.columns
            if column.kind is Kind.NUMBER and column.name not in _NO_SIGNALS and not self.block
        ]
        self.signals = tuple(
            Signal(topic.name, topic.type, column.name, column.unit) for column in numbers
        )
        self._numbers = {column.name: column for column in numbers}
        self._stamp = [stamp] if stamp is not None and self.stamped else []
        self._fields = self._field_reader()

    @property
    def latched(self) -> bool:
        """Whether messages may be older than the bag."""
        return is_latched(self.summary)

    def keep(self, signals: Iterable[Signal]) -> None:
        """Read these signals alone."""
        self.signals = tuple(signals)
        self._fields = self._field_reader()

    def read(self, block: MessageBlock) -> Rows:
        """Return the rows of messages; count those that are not of the type."""
        late = late_messages(block)
        if late:
            block = block.part(np.setdiff1d(np.arange(len(block)), [*late]))
            self.unreadable += len(late)
            self.reason = self.reason or next(iter(late.values()))
        found = self._fields.read(block)
        if found.errors and not self.unreadable:
            self.reason = found.errors[0][1]
        self.unreadable += len(found.errors)
        logs = block.log_times[found.rows].astype(np.int64)
        stamps = found.array(self._stamp[0].name) if self._stamp else logs
        values = {}
        for signal in self.signals:
            numbers = found.array(signal.column).astype(float)
            values[signal.column] = np.where(usable(numbers), numbers, np.nan)
        return Rows(logs, stamps, values)

    def _field_reader(self) -> FieldReader:
        assert self.summary.definition is not None  # a table needs it
        codec, _ = compiled(self.summary.topic.type, self.summary.definition)
        numbers = [self._numbers[signal.column] for signal in self.signals]
        return FieldReader(codec, [*self._stamp, *numbers])


def topic_readers(bag: BagReader) -> tuple[dict[str, TopicReader], dict[str, str]]:
    """Return the readers of topics by their names, and the reasons why others have none."""
    left_out = {**bag.damages, **bag.left_out}
    readers: dict[str, TopicReader] = {}
    for summary in bag.readable_topics:
        name = summary.topic.name
        if name in left_out or not summary.message_count:
            continue
        if len(readers) >= MOST_TOPICS:
            left_out[name] = f"the bag has more than {MOST_TOPICS} topics"
            continue
        try:
            readers[name] = TopicReader(summary, bag.columns(name))
        except BagFormatError as error:
            left_out[name] = str(error)
    _limit(readers)
    return readers, left_out


def clock_topics(readers: Mapping[str, TopicReader]) -> dict[str, frozenset[str]]:
    """Return the topics whose stamps show the time of each drill; none if no topic has stamps.

    Blocks are logged long after their stamps, and latched messages may be old. They are used only
    if a drill has nothing else.
    """
    chosen: dict[str, frozenset[str]] = {}
    for drill in {namespace(name) for name in readers}:
        stamped = {
            name: reader
            for name, reader in readers.items()
            if namespace(name) == drill and reader.stamped
        }
        groups = (
            {name for name, each in stamped.items() if not each.latched and not each.block},
            {name for name, each in stamped.items() if not each.latched},
            set(stamped),
        )
        chosen[drill] = frozenset(next((group for group in groups if group), set()))
    return chosen


def _limit(readers: dict[str, TopicReader]) -> None:
    """Keep at most ``MOST_SIGNALS``, those of drills first."""
    left = MOST_SIGNALS
    for reader in sorted(
        readers.values(), key=lambda each: not each.summary.topic.type.startswith(_OURS)
    ):
        reader.keep(reader.signals[:left])
        left -= len(reader.signals)


def stamp_column(columns: Sequence[Column]) -> str:
    """Return the column with the times of a topic's rows: log_time if there is no stamp."""
    if columns[0].name == "time":
        return "time"
    stamped = any(column.name == "header.stamp" and column.kind is Kind.TIME for column in columns)
    return "header.stamp" if stamped else "log_time"


def is_latched(summary: TopicSummary) -> bool:
    """Whether a topic's first messages may be older than the bag."""
    return any(offer.durability == "transient_local" for offer in summary.topic.offered_qos)
