"""Signals of a bag and clocks of its drills: numbers over the time since the bag began."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.columns import Column, Kind, usable
from rpud_sim.bag.field_values import FieldReader
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.bag.tables import compiled, late_messages
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_drill import Jump
from rpud_sim.simulation.topics import TOPICS

MOST_SIGNALS, MOST_TOPICS = 120, 100  # signals of a bag, and topics with signals
OURS = "rpud_msgs/"  # signals of these types come first where a bag has too many
IMPACTS = "rpud_msgs/msg/ContactForce"
TRAJECTORY = "rpud_msgs/msg/Trajectory"
JOURNAL, FAULTS = "rpud_msgs/msg/JournalEntry", "rpud_msgs/msg/Faults"
STATUS = "rpud_msgs/msg/Status"
WAVEFORM = "rpud_msgs/msg/Waveform"

_NO_SIGNALS = {"sequence", "sample_period"}  # they number messages, or help to read them
_BACK = SECOND  # step back of a clock that lateness does not explain [ns]
_AHEAD = 60 * SECOND  # step ahead of a clock that passed time does not explain [ns]


def find_jumps(stamps: np.ndarray, log_times: np.ndarray) -> list[Jump]:
    """Return the jumps in a series of messages, in the order of log times; shapes (n,), [ns]."""
    steps, passed = np.diff(stamps), np.maximum(np.diff(log_times), 0)
    return [
        Jump(int(log_times[place + 1]), int(steps[place] - passed[place]))
        for place in np.flatnonzero((steps < -_BACK) | (steps - passed > _AHEAD)).tolist()
    ]


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
        self.signals = [Signal(self.topic, self.type, each.name, each.unit) for each in numbers]
        self.codec, _ = compiled(self.type, summary.definition or "")
        self._fields = FieldReader(self.codec, [*stamp, *numbers])

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
    ranks: dict[str, dict[str, tuple[bool, bool]]] = defaultdict(dict)
    for name, reader in readers.items():
        known = ranks[namespace(name)]
        if reader.stamped:
            known[name] = reader.latched, reader.block
    return {
        drill: frozenset(name for name, rank in known.items() if rank == min(known.values()))
        for drill, known in ranks.items()
    }
