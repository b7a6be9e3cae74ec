"""Whether the messages of two runs have the same bits, topic by topic, in bounded memory."""

from __future__ import annotations

import struct
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from contextlib import closing
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.encoder import Decoded
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.recorded.compare.values import OpenRun
from rpud_sim.recorded.recorded_drill import RecordedDrill
from rpud_sim.recorded.verify.messages import first_field
from rpud_sim.simulation.topics import PROVED

EQUAL, DIFFERENT, NOT_COMPARED = "equal", "different", "not compared"

_TIME = "builtin_interfaces/msg/Time"
_STAMP = slice(4, 12)  # of the header, after the four bytes that tell the encoding
_SEVERAL_TIMES = ("faults", "trajectory")  # topics with other times than the stamp


class TopicBits(NamedTuple):
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


class _Timed(NamedTuple):
    time: int  # simulation time [ns]
    data: bytes  # serialized
    origin: int  # stamp of simulation time zero [ns]


_Pair = tuple[_Timed | None, _Timed | None]
# With the simulation time of what one run holds beyond the other [ns]; None without.
Compared = tuple[TopicBits, int | None]


def bits_readers(
    reference: OpenRun, run: OpenRun, found: dict[str, Compared], report: Callable[[int], object]
) -> Iterator[Iterator[int]]:
    """Yield a reader for each topic that a run computes, for ``read_together``.

    Each puts what it finds under the topic's name.
    """
    held = [_topics(each) for each in (reference, run)]
    for topic in PROVED:
        summaries = [topics[topic] for topics in held if topic in topics]
        if len(summaries) == 1:
            lacking = "this run" if topic in held[0] else "the reference"
            found[topic] = _not_compared(topic, f"{lacking} does not hold it")
        elif summaries:
            try:
                [(name, definition)] = {(s.topic.type, s.definition) for s in summaries}
                codec = Codec(name, definition or "")
            except (BagFormatError, ValueError):
                found[topic] = _not_compared(topic, "the definitions of its messages differ")
                continue
            first, second = (
                _messages(each.recorded.blocks(each.drill.topic(topic)), each.drill, report)
                for each in (reference, run)
            )
            yield _read(_compare_topic(topic, codec, first, second), topic, found)


def _not_compared(topic: str, note: str) -> Compared:
    return TopicBits(topic, NOT_COMPARED, note=note), None


def _read(
    comparison: Generator[int, None, Compared], topic: str, found: dict[str, Compared]
) -> Iterator[int]:
    found[topic] = yield from comparison


def bits_of(found: Mapping[str, Compared], end: float) -> tuple[TopicBits, ...]:
    """Return what the readers found; both runs reach simulation time ``end`` [s]."""
    return tuple(
        bits if left is None or left <= end * SECOND else bits._replace(note="")
        for bits, left in (found[topic] for topic in PROVED if topic in found)
    )


def _topics(run: OpenRun) -> dict[str, TopicSummary]:
    found = {s.topic.name: s for s in run.bag.readable_topics if s.message_count}
    return {name: found[full] for name in PROVED if (full := run.drill.topic(name)) in found}


def _compare_topic(
    topic: str,
    codec: Codec,
    first: Generator[_Timed, None, None],
    second: Generator[_Timed, None, None],
) -> Generator[int, None, Compared]:
    equal = 0
    with closing(first), closing(second):
        one, other = yield from _common_begin(first, second)
        while one and other and one.time == other.time:
            apart = [(each.data[: _STAMP.start], each.data[_STAMP.stop :]) for each in (one, other)]
            # Both stamps are the same time in their run. Other times differ with the origin.
            same = apart[0] == apart[1]
            same &= one.origin == other.origin or topic not in _SEVERAL_TIMES
            if not same and (found := _difference(codec, one, other)):
                return TopicBits(topic, DIFFERENT, equal, one.time / SECOND, *found), None
            equal += 1
            one, other = next(first, None), next(second, None)
            if one:
                yield one.time
    if one and other:
        texts = ("a message", "nothing at this time")
        texts = texts if one.time < other.time else texts[::-1]
        time = min(one.time, other.time) / SECOND
        return TopicBits(topic, DIFFERENT, equal, time, "", *texts), None
    if not equal:
        return _not_compared(topic, "the runs have no time in common")
    if left := one or other:
        note = f"{'the reference' if one else 'this run'} goes on longer"
        return TopicBits(topic, EQUAL, equal, note=note), left.time
    return TopicBits(topic, EQUAL, equal), None


def _messages(
    blocks: Generator[MessageBlock, None, None],
    drill: RecordedDrill,
    report: Callable[[int], object],
) -> Generator[_Timed, None, None]:
    """Yield the messages of a run, without repeats."""
    first, last = drill.bounds
    latest = b""
    with closing(blocks):
        for block in blocks:
            report(len(block))
            messages = [block.message(number) for number in range(len(block))]
            stamps = np.array([_stamp_of(data) for data in messages], np.int64)
            origins = drill.clock.offsets(stamps, block.publish_times)
            times = (stamps - origins).tolist(), origins.tolist(), block.publish_times.tolist()
            for data, time, origin, published in zip(messages, *times, strict=True):
                # A latched message is repeated where a bag's next file begins.
                if first <= published <= last and data != latest:
                    latest = data
                    yield _Timed(time, data, origin)


def _common_begin(first: Iterator[_Timed], second: Iterator[_Timed]) -> Generator[int, None, _Pair]:
    """Return the first messages of both; a recorder that began later misses nothing before."""
    heads = [next(first, None), next(second, None)]
    while heads[0] and heads[1] and heads[0].time != heads[1].time:
        early = int(heads[1].time < heads[0].time)
        late = heads[1 - early]
        following = next((first, second)[early], None)
        if following and late and following.time > late.time:
            break
        heads[early] = following
        if following:
            yield following.time
    return heads[0], heads[1]


def _difference(codec: Codec, first: _Timed, second: _Timed) -> tuple[str, str, str] | None:
    """Return the first field that differs, and its value in both; None if none does."""
    try:
        pair = [_shifted(codec.decode(each.data), each.origin) for each in (first, second)]
    except BagFormatError as error:
        return None if first.data == second.data else ("", "a message", str(error))
    return first_field(*pair)


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
    if isinstance(value, list):
        return [_shifted(item, offset) for item in value]
    if not isinstance(value, Decoded):
        return value
    if value.type_name == _TIME and all(isinstance(each, int) for each in vars(value).values()):
        time = join_seconds(value["sec"], value["nanosec"])
        time -= offset if time else 0
        return Decoded(_TIME, {"sec": time // SECOND, "nanosec": time % SECOND})
    inner = {name: _shifted(item, offset) for name, item in vars(value).items()}
    return Decoded(value.type_name, inner)
