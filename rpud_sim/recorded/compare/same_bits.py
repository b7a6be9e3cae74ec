"""Whether the messages of two runs have the same bits, topic by topic, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.compare.values import OpenRun
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.recorded.streams import (
    Cursor,
    KeyedMessages,
    TopicStream,
    difference,
    matched,
)
from rpud_sim.simulation.topics import PROVED

EQUAL, DIFFERENT, NOT_COMPARED = "equal", "different", "not compared"

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


# With the simulation time of what one run holds beyond the other [ns]; None without.
Compared = tuple[TopicBits, int | None]


def bits_readers(
    reference: OpenRun, run: OpenRun, found: dict[str, Compared], report: Callable[[int], object]
) -> Iterator[tuple[Iterator[object], Sequence[TopicStream]]]:
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
            streams = [each.recorded.stream(each.drill.topic(topic)) for each in (reference, run)]
            cursors = [
                Cursor(_keyed(stream, each.drill, report), codec)
                for stream, each in zip(streams, (reference, run), strict=True)
            ]
            yield _read(topic, streams, cursors, found), streams


def _not_compared(topic: str, note: str) -> Compared:
    return TopicBits(topic, NOT_COMPARED, note=note), None


def bits_of(found: Mapping[str, Compared], end: float) -> tuple[TopicBits, ...]:
    """Return what the readers found; both runs reach simulation time ``end`` [s]."""
    return tuple(
        bits if left is None or left <= end * SECOND else bits._replace(note="")
        for bits, left in (found[topic] for topic in PROVED if topic in found)
    )


def _topics(run: OpenRun) -> dict[str, TopicSummary]:
    found = {s.topic.name: s for s in run.bag.readable_topics if s.message_count}
    return {name: found[full] for name in PROVED if (full := run.drill.topic(name)) in found}


def _keyed(
    stream: TopicStream, run: RecordedRun, report: Callable[[int], object]
) -> Iterator[KeyedMessages | None]:
    """Yield the messages of a run with their simulation times."""
    for batches in stream:
        for batch in batches:
            report(len(batch))
            own = batch.part(run.holds(batch.publish_times))
            runs = np.zeros(len(own), np.int64)
            yield KeyedMessages(own, runs, run.origins(own.publish_times))
        if not batches:
            yield None


def _read(
    topic: str,
    streams: Sequence[TopicStream],
    cursors: Sequence[Cursor],
    found: dict[str, Compared],
) -> Iterator[None]:
    found[topic] = yield from _compare_topic(topic, *cursors)
    for stream in streams:
        stream.close()


def _compare_topic(topic: str, first: Cursor, second: Cursor) -> Generator[None, None, Compared]:
    """Compare up to the first difference."""
    equal = 0
    for step in matched(first, second, several_times=topic in _SEVERAL_TIMES):
        one, other = step.first, step.second
        if step.equal:
            equal += step.equal
            yield
        elif one and other:
            if different := difference(one, other):
                return TopicBits(topic, DIFFERENT, equal, one.time / SECOND, *different), None
            equal += 1
            yield
        elif only := one or other:
            left = (second if one else first).head() is None
            if left and equal:
                note = f"{'the reference' if one else 'this run'} goes on longer"
                return TopicBits(topic, EQUAL, equal, note=note), only.time
            if equal:
                texts = ("a message", "nothing at this time")
                texts = texts if one else texts[::-1]
                return TopicBits(topic, DIFFERENT, equal, only.time / SECOND, "", *texts), None
            yield  # a recorder that began later misses nothing before
        else:
            yield
    if not equal:
        return _not_compared(topic, "the runs have no time in common")
    return TopicBits(topic, EQUAL, equal), None
