"""Runs read side by side: their values, and whether their messages have the same bits."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.compare.values import RecordedValues, ValueReader
from rpud_sim.inspection.output import Damages
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.inspection.verify.messages import differing_fields
from rpud_sim.simulation.topics import PROVED

EQUAL, DIFFERENT, NOT_COMPARED = "equal", "different", "not compared"

_TIME = "builtin_interfaces/msg/Time"
_STAMP = slice(4, 12)  # of the header, after the four bytes that tell the encoding
_SEVERAL_TIMES = ("faults", "trajectory")  # topics with other times than the stamp
_MOST_WAITING = 64 * 2**20  # messages of a topic that the other run lacks [bytes]
_OVERHEAD = 256  # bytes that a message takes in addition to its data


@dataclass(frozen=True)
class TopicBits:
    """Comparison of one topic's messages with those of the reference, bit for bit.

    Stamps count from the beginning of each run, since wall clocks differ.
    """

    topic: str  # its relative name
    state: str  # equal, different, or not compared
    messages: int = 0  # number of messages that are equal before the first difference or the end
    time: float | None = None  # simulation time of the first difference [s]; None without one
    field: str = ""  # in which both differ first; empty where a message is missing
    reference: str = ""  # reference, other: the field's values as texts, or what there is instead
    other: str = ""
    note: str = ""  # why it is not compared, or which run goes on longer; empty otherwise


def first_different(run: Sequence[TopicBits]) -> TopicBits | None:
    """Return the topic that differs first; None if none does."""
    found = [topic for topic in run if topic.state == DIFFERENT]
    return min(found, key=lambda topic: topic.time or 0.0, default=None)


class Side:
    """Run in an open bag, of which each block is read once."""

    def __init__(self, bag: BagReader, drill: RecordedDrill, damages: Damages) -> None:
        self._drill = drill
        self._values = ValueReader(bag, drill, damages)
        # Topics whose bits are compared, by their relative names.
        self.held: dict[str, TopicSummary] = {
            self.relative(summary.topic.name): summary
            for summary in bag.readable_topics
            if summary.topic.name.startswith(drill.prefix) and summary.message_count
        }
        names = {drill.topic(name) for name in PROVED if name in self.held}
        self._blocks = bag.blocks(names | self._values.topics)
        self._latest: dict[str, bytes] = {}
        self.reached = -1  # simulation time of the latest message so far [ns]
        self.ended = False

    def relative(self, topic: str) -> str:
        return topic.removeprefix(self._drill.prefix)

    @property
    def values(self) -> RecordedValues:
        return self._values.values()

    def next(self) -> MessageBlock | None:
        """Return the next block, whose values are read; None at the end."""
        block = next(self._blocks, None)
        if block is None:
            self.ended = True
        else:
            self._values.add(block)
        return block

    def timed(self, block: MessageBlock) -> Iterator[_Timed]:
        """Yield the messages of the run in a block, without repeats."""
        first, last = self._drill.bounds
        for number, published in enumerate(block.publish_times.tolist()):
            data = block.message(number)
            # A latched message is repeated where a bag's next file begins.
            if first <= published <= last and data != self._latest.get(block.topic):
                self._latest[block.topic] = data
                origin = self._drill.clock.offset(published)
                time = _stamp_of(data) - origin
                self.reached = max(self.reached, time)
                yield _Timed(data, time, origin)


def read_side_by_side(
    sides: Sequence[Side], report: Callable[[int], object]
) -> Iterator[tuple[TopicBits, ...]]:
    """Read runs; yield the comparison of each with the first, by topic that a run computes.

    They are read side by side, so that few messages wait for their partner.
    """
    pairs = [_pairs(sides[0], other) for other in sides[1:]]
    partners = [*zip(sides[1:], pairs, strict=True)]
    while reading := [number for number, side in enumerate(sides) if not side.ended]:
        number = min(reading, key=lambda number: sides[number].reached)
        side = sides[number]
        block = side.next()
        if block is None:
            continue
        report(len(block))
        topic = side.relative(block.topic)
        waiting = [
            (pair, other)
            for other, found in ([(sides[0], pairs[number - 1])] if number else partners)
            if isinstance(pair := found.get(topic), _Pair) and not pair.done
        ]
        own = min(number, 1)
        for timed in side.timed(block) if waiting else ():
            for pair, other in waiting:
                # Beyond the end of the other run there is nothing to wait for.
                if not other.ended or timed.time <= other.reached or pair.waiting[1 - own]:
                    pair.add(own, timed)
    for other, each in partners:
        until = min(sides[0].reached, other.reached)
        yield tuple(
            pair.result(until) if isinstance(pair, _Pair) else pair for pair in each.values()
        )


def _pairs(first: Side, second: Side) -> dict[str, _Pair | TopicBits]:
    """Return the topics of two runs, by name: to be compared, or with the reason why not."""
    found: dict[str, _Pair | TopicBits] = {}
    for topic in PROVED:
        held = [side.held[topic] for side in (first, second) if topic in side.held]
        if len(held) == 1:
            lacking = "this run" if topic in first.held else "the reference"
            found[topic] = TopicBits(topic, NOT_COMPARED, note=f"{lacking} does not hold it")
        elif held:
            try:
                [(name, definition)] = {(s.topic.type, s.definition) for s in held}
                found[topic] = _Pair(topic, Codec(name, definition or ""))
            except (BagFormatError, ValueError):
                note = "the definitions of its messages differ"
                found[topic] = TopicBits(topic, NOT_COMPARED, note=note)
    return found


@dataclass(frozen=True)
class _Timed:
    data: bytes  # serialized
    time: int  # simulation time [ns]
    origin: int  # stamp of simulation time zero [ns]


class _Pair:
    """Messages of one topic of two runs, which wait for each other."""

    def __init__(self, topic: str, codec: Codec) -> None:
        self.codec = codec  # of the topic
        self.done = False  # whether a difference is found
        self._topic = topic
        self._several_times = topic in _SEVERAL_TIMES
        self.waiting: tuple[deque[_Timed], deque[_Timed]] = (deque(), deque())  # of each run
        self._sizes = [0, 0]  # of what waits [bytes]
        self._began = False
        self._equal = 0
        self._found: TopicBits | None = None

    def add(self, side: int, message: _Timed) -> None:
        self.waiting[side].append(message)
        self._sizes[side] += _size(message)
        first, second = self.waiting
        while first and second and not self.done:
            if not self._began and first[0].time != second[0].time:
                # A recorder may have begun later: nothing is missing before its first message.
                early, late = (first, second) if first[0].time < second[0].time else (second, first)
                if len(early) == 1:
                    break  # the next one shows whether the other recorder began later
                if early[1].time <= late[0].time:
                    self._take(int(early is second))
                    continue
            self._began = True
            self._compare(self._take(0), self._take(1))
        if self._sizes[side] > _MOST_WAITING and not self.done:
            self._missing(side, self.waiting[side][0])

    def _take(self, side: int) -> _Timed:
        message = self.waiting[side].popleft()
        self._sizes[side] -= _size(message)
        return message

    def _compare(self, first: _Timed, second: _Timed) -> None:
        if first.time != second.time:
            side = int(second.time < first.time)
            self._missing(side, (first, second)[side])
            return
        apart = [(data[: _STAMP.start], data[_STAMP.stop :]) for data in (first.data, second.data)]
        # Both stamps are the same time in their run. Other times differ with the origin.
        same = apart[0] == apart[1]
        same &= first.origin == second.origin or not self._several_times
        difference = None if same else self._difference(first, second)
        if difference is None:
            self._equal += 1
        else:
            self._end(first.time, *difference)

    def _missing(self, side: int, message: _Timed) -> None:
        texts = ["nothing at this time"] * 2
        texts[side] = "a message"
        self._end(message.time, "", *texts)

    def _difference(self, first: _Timed, second: _Timed) -> tuple[str, str, str] | None:
        """Return the first field that differs, and its value in both; None if none does."""
        try:
            pair = [_shifted(self.codec.decode(each.data), each.origin) for each in (first, second)]
        except BagFormatError as error:
            same = first.data == second.data
            return None if same else ("", "a message", str(error))
        return next(differing_fields(*pair), None)

    def _end(self, time: int, field: str, reference: str, other: str) -> None:
        self.done = True
        self._found = TopicBits(
            self._topic, DIFFERENT, self._equal, time / SECOND, field, reference, other
        )
        for waiting in self.waiting:
            waiting.clear()

    def result(self, until: int) -> TopicBits:
        """Return the comparison up to a time that both runs reached [ns]."""
        if self._found:
            return self._found
        if not self._equal:
            return TopicBits(self._topic, NOT_COMPARED, note="the runs have no time in common")
        longer = [
            name
            for name, waiting in zip(("the reference", "this run"), self.waiting, strict=True)
            if waiting and waiting[0].time <= until
        ]
        note = f"{longer[0]} goes on longer" if longer else ""
        return TopicBits(self._topic, EQUAL, self._equal, note=note)


def _size(message: _Timed) -> int:
    return len(message.data) + _OVERHEAD


def _stamp_of(data: bytes) -> int:
    """Return the stamp of a message that begins with a header [ns]; -1 if it is too short.

    Decoding every message would take ten times as long.
    """
    if len(data) < _STAMP.stop:
        return -1
    order = "<" if data[1] & 1 else ">"
    return join_seconds(*struct.unpack(f"{order}iI", data[_STAMP]))


def _shifted(value: Any, offset: int) -> Any:
    """Return a decoded message with times counted from an origin [ns]; zero times stay."""
    if getattr(value, "__msgtype__", "") == _TIME:
        time = join_seconds(value.sec, value.nanosec)
        time -= offset if time else 0
        return SimpleNamespace(sec=time // SECOND, nanosec=time % SECOND)
    if hasattr(value, "__msgtype__"):
        inner = {name: item for name, item in vars(value).items() if name != "__msgtype__"}
        return SimpleNamespace(**{name: _shifted(item, offset) for name, item in inner.items()})
    if isinstance(value, list):
        return [_shifted(item, offset) for item in value]
    return value
