"""Signals of a bag and clocks of its drills: numbers over the time since the bag began."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.columns import Column, Kind, usable
from rpud_sim.bag.field_values import FieldReader
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.tables import compiled, late_messages
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_drill import Jump
from rpud_sim.simulation.topics import TOPICS

_BACK = SECOND  # step back of a clock that lateness does not explain [ns]
_AHEAD = 60 * SECOND  # step ahead of a clock that passed time does not explain [ns]

# Stamps and log times of messages in the order of their log times, each of shape (n,) [ns].
Series = tuple[np.ndarray, np.ndarray]


def find_jumps(stamps: np.ndarray, log_times: np.ndarray) -> list[Jump]:
    """Return the jumps in a series of messages, in the order of log times; shapes (n,), [ns]."""
    steps, passed = np.diff(stamps), np.maximum(np.diff(log_times), 0)
    return [
        Jump(int(log_times[place + 1]), int(steps[place] - passed[place]))
        for place in np.flatnonzero((steps < -_BACK) | (steps - passed > _AHEAD)).tolist()
    ]


def zero_stamp(stamps: np.ndarray, log_times: np.ndarray, begin: int) -> int:
    """Return the stamp of a clock at the bag's beginning [ns], from a topic's first message.

    ``stamps`` and ``log_times`` have the shape (n,) [ns]; ``begin`` is a log time [ns].
    """
    others = np.flatnonzero(log_times != log_times[0])
    last = int(others[0]) - 1 if len(others) else -1  # a block is logged after its last row
    return int(stamps[last]) - (int(log_times[0]) - begin)


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
OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many


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


def is_stranger(topic: str) -> bool:
    """Whether a drill has no topic of this name."""
    return topic.rpartition("/")[2] not in TOPICS


def namespace(topic: str) -> str:
    return topic.rpartition("/")[0]


@dataclass(frozen=True)
class Rows:
    """Messages of one topic in a part of a bag."""

    log_times: np.ndarray  # shape (n,) [ns]
    stamps: np.ndarray  # shape (n,) [ns]; the log times of messages without stamps
    # of each signal, by column, shape (n,); NaN where a value cannot be drawn
    values: dict[str, np.ndarray]


class TopicReader:
    """Reader of the signals of one topic, of which it takes at most so many."""

    def __init__(self, summary: TopicSummary, columns: Sequence[Column], most: int) -> None:
        self.summary = summary
        self.unreadable = 0  # messages that are not of the type
        self.block = columns[0].name == "time"  # whether a message holds many rows
        self.stamped = any(
            (column.name, column.kind) == ("header.stamp", Kind.TIME) for column in columns
        )
        numbers = [
            column
            for column in columns
            if column.kind is Kind.NUMBER and column.name not in _NO_SIGNALS and not self.block
        ][:most]
        self.signals = tuple(
            Signal(summary.topic.name, summary.topic.type, column.name, column.unit)
            for column in numbers
        )
        stamp = [column for column in columns if column.name == "header.stamp" and self.stamped]
        assert summary.definition is not None  # a table needs it
        codec, _ = compiled(summary.topic.type, summary.definition)
        self._fields = FieldReader(codec, [*stamp, *numbers])

    def read(self, block: MessageBlock) -> Rows:
        """Return the rows of messages; count those that are not of the type."""
        if late := late_messages(block):
            block = block.part(np.setdiff1d(np.arange(len(block)), [*late]))
        found = self._fields.read(block)
        self.unreadable += len(late) + len(found.errors)
        logs = block.log_times[found.rows].astype(np.int64)
        values = {}
        for signal in self.signals:
            numbers = found.array(signal.column).astype(float)
            values[signal.column] = np.where(usable(numbers), numbers, np.nan)
        return Rows(logs, found.array("header.stamp") if self.stamped else logs, values)


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


def clock_topics(readers: Mapping[str, TopicReader]) -> dict[str, frozenset[str]]:
    """Return the topics whose stamps show the time of each drill; none if no topic has stamps.

    Blocks are logged long after their stamps, and latched messages may be old. They are used only
    if a drill has nothing else.
    """
    chosen: dict[str, frozenset[str]] = {}
    for drill in {namespace(name) for name in readers}:
        ranks = {
            name: ("transient_local" in {each.durability for each in offers}, reader.block)
            for name, reader in readers.items()
            if namespace(name) == drill and reader.stamped
            for offers in [reader.summary.topic.offered_qos]
        }
        best = min(ranks.values(), default=None)
        chosen[drill] = frozenset(name for name, rank in ranks.items() if rank == best)
    return chosen
