"""Whether two runs have the same bits: their messages side by side, up to the first difference."""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

from rpud_sim.bag import BagFormatError, BagReader, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.inspection.verify.messages import (
    differing_fields,
)
from rpud_sim.simulation.topics import PROVED

EQUAL, DIFFERENT, NOT_COMPARED = "equal", "different", "not compared"

_TIME = "builtin_interfaces/msg/Time"
_STAMP = slice(4, 12)  # of the header, after the four bytes that tell the encoding
_SEVERAL_TIMES = ("faults", "trajectory")  # topics with other times than the stamp
_MOST_WAITING = 64 * 2**20  # messages of a topic that the other run lacks [bytes]
_OVERHEAD = 256  # bytes that a message takes in addition to its data
_REPORTED = 1000  # messages between two reports of progress


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


@dataclass(frozen=True)
class Side:
    """Run in an open bag."""

    bag: BagReader
    drill: RecordedDrill

    def summary(self, topic: str) -> TopicSummary | None:
        """Return the summary of a topic of the drill; None without messages."""
        name = self.drill.topic(topic)
        found = (s for s in self.bag.readable_topics if s.topic.name == name and s.message_count)
        return next(found, None)


def compare_bits(
    reference: Side, other: Side, report: Callable[[int], object] = lambda messages: None
) -> tuple[TopicBits, ...]:
    """Return the comparison of each topic that the simulation determines, if a run holds it.

    Both bags are read side by side, so that few messages wait for their partner.
    """
    found: dict[str, TopicBits] = {}
    pairs: dict[str, _Pair] = {}
    for topic in PROVED:
        first, second = reference.summary(topic), other.summary(topic)
        if first is None and second is None:
            continue
        if first is None or second is None:
            lacking = "the reference" if first is None else "this run"
            found[topic] = TopicBits(topic, NOT_COMPARED, note=f"{lacking} does not hold it")
            continue
        try:
            [(name, definition)] = {(s.topic.type, s.definition) for s in (first, second)}
            pairs[topic] = _Pair(topic, Codec(name, definition or ""))
        except (BagFormatError, ValueError):
            note = "the definitions of its messages differ"
            found[topic] = TopicBits(topic, NOT_COMPARED, note=note)
    _read(pairs, (reference, other), report)
    found |= {topic: pair.result() for topic, pair in pairs.items()}
    return tuple(found[topic] for topic in PROVED if topic in found)


def _read(
    pairs: dict[str, _Pair], sides: tuple[Side, Side], report: Callable[[int], object]
) -> None:
    sources = [_timed(side, pairs) for side in sides]
    reached = [-1, -1]
    read = 0
    while not all(pair.done for pair in pairs.values()):
        number = int(reached[1] < reached[0])
        item = next(sources[number], None)
        if item is None:
            for topic, timed in sources[1 - number]:
                pair = pairs[topic]
                if pair.done:
                    continue
                if timed.time > reached[number]:
                    break  # the other run went on longer
                pair.add(1 - number, timed)
            break
        topic, timed = item
        reached[number] = max(reached[number], timed.time)
        if not pairs[topic].done:
            pairs[topic].add(number, timed)
        read += 1
        if read % _REPORTED == 0:
            report(_REPORTED)
    report(read % _REPORTED)


@dataclass(frozen=True)
class _Timed:
    data: bytes  # serialized
    time: int  # simulation time [ns]
    origin: int  # stamp of simulation time zero [ns]


def _timed(side: Side, pairs: dict[str, _Pair]) -> Iterator[tuple[str, _Timed]]:
    drill = side.drill
    names = {drill.topic(topic): topic for topic in pairs}
    latest = dict.fromkeys(names, b"")
    first, last = drill.bounds
    for message in side.bag.messages(names.keys()):
        topic = names[message.topic]
        if not first <= message.publish_time <= last:
            continue
        if pairs[topic].done:
            continue
        if message.data == latest[message.topic]:
            continue  # a latched message is repeated where a bag's next file begins
        latest[message.topic] = message.data
        stamp = _stamp_of(message.data)
        origin = drill.clock.offset(message.publish_time)
        yield topic, _Timed(message.data, stamp - origin, origin)


class _Pair:
    """Messages of one topic of two runs, which wait for each other."""

    def __init__(self, topic: str, codec: Codec) -> None:
        self.codec = codec  # of the topic
        self.done = False  # whether a difference is found
        self._topic = topic
        self._several_times = topic in _SEVERAL_TIMES
        self._waiting: tuple[deque[_Timed], deque[_Timed]] = (deque(), deque())
        self._sizes = [0, 0]  # of what waits [bytes]
        self._began = False
        self._equal = 0
        self._found: TopicBits | None = None

    def add(self, side: int, message: _Timed) -> None:
        self._waiting[side].append(message)
        self._sizes[side] += _size(message)
        first, second = self._waiting
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
            self._missing(side, self._waiting[side][0])

    def _take(self, side: int) -> _Timed:
        message = self._waiting[side].popleft()
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
        for waiting in self._waiting:
            waiting.clear()

    def result(self) -> TopicBits:
        if self._found:
            return self._found
        if not self._equal:
            return TopicBits(self._topic, NOT_COMPARED, note="the runs have no time in common")
        sides = [place for place, waiting in enumerate(self._waiting) if waiting]
        longer = ("the reference", "this run")[sides[0]] if sides else ""
        note = f"{longer} goes on longer" if longer else ""
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
