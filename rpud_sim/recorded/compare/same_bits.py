"""Whether the messages of two runs have the same bits, topic by topic, in bounded memory."""

from __future__ import annotations

from collections.abc import Callable, Collection, Generator, Iterator, Sequence
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader, Batch, TopicSummary
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.encoder import Decoded
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.recorded.streams import (
    Head,
    StreamHead,
    TopicStream,
    TopicStreams,
    difference,
    first_field,
    matched,
    read_together,
)
from rpud_sim.simulation.topics import PROVED

EQUAL, DIFFERENT, NOT_COMPARED = "equal", "different", "not compared"

_SEVERAL_TIMES = ("faults", "trajectory")  # topics with other times than the stamp
_BLOCKS = ("trajectory", "waveform")  # topics whose last message a run's end may cut off
_LONGER = ("this run continues longer", "the reference continues longer")


class TopicBits(NamedTuple):
    """Comparison of one topic's messages with the reference, bit for bit.

    Stamps count from the beginning of each run, since wall clocks differ.
    """

    topic: str  # its relative name
    state: str  # equal, different, or not compared
    messages: int = 0  # number of messages that are equal before the first difference or the end
    time: float | None = None  # simulation time of the first difference [s]; None without one
    field: str = ""  # in which both differ first; empty where a message is missing
    reference: str = ""  # reference, other: the field's values as texts, or what there is instead
    other: str = ""
    note: str = ""  # why it is not compared, or which run continues longer; empty otherwise


def compare_bits(
    bags: Sequence[BagReader],
    runs: Sequence[RecordedRun],
    end: float,
    report: Callable[[int], object],
) -> tuple[TopicBits, ...]:
    """Compare the topics that a drill computes; both runs reach simulation time ``end`` [s]."""
    held = [_topics(bag, run) for bag, run in zip(bags, runs, strict=True)]
    sources = [
        TopicStreams(partial(_own, bag, run, report)) for bag, run in zip(bags, runs, strict=True)
    ]
    found: dict[str, TopicBits] = {}
    readers = []
    for topic in PROVED:
        summaries = [topics[topic] for topics in held if topic in topics]
        if len(summaries) == 1:
            lacking = "this run" if topic in held[0] else "the reference"
            found[topic] = TopicBits(topic, NOT_COMPARED, note=f"{lacking} does not hold it")
        elif summaries:
            try:
                [(name, definition)] = {(s.topic.type, s.definition) for s in summaries}
                codec = Codec(name, definition or "")
            except (BagFormatError, ValueError):
                note = "the definitions of its messages differ"
                found[topic] = TopicBits(topic, NOT_COMPARED, note=note)
                continue
            streams = [
                source.stream(run.topic(topic)) for source, run in zip(sources, runs, strict=True)
            ]
            readers.append((_read(topic, streams, codec, end, found), streams))
    read_together(readers)
    return tuple(found[topic] for topic in PROVED if topic in found)


def _topics(bag: BagReader, run: RecordedRun) -> dict[str, TopicSummary]:
    found = {s.topic.name: s for s in bag.readable_topics if s.message_count}
    return {name: found[full] for name in PROVED if (full := run.topic(name)) in found}


def _own(
    bag: BagReader, run: RecordedRun, report: Callable[[int], object], topics: Collection[str]
) -> Iterator[Batch]:
    for batch in run.of(bag.batches(topics)):
        report(len(batch))
        yield replace(batch, run=0)  # the numbers of the two runs may differ


def _read(
    topic: str,
    streams: Sequence[TopicStream],
    codec: Codec,
    end: float,
    found: dict[str, TopicBits],
) -> Iterator[None]:
    first, second = (StreamHead(stream, codec) for stream in streams)
    found[topic] = yield from _compare_topic(topic, first, second, end)
    for stream in streams:
        stream.close()


def _compare_topic(
    topic: str, first: StreamHead, second: StreamHead, end: float
) -> Generator[None, None, TopicBits]:
    """Compare up to the first difference."""
    equal = 0
    begun = [False, False]  # whether each run has had a message
    for step in matched(first, second, several_times=topic in _SEVERAL_TIMES):
        one, other = step.first, step.second
        if step.equal:
            equal += step.equal
            yield
        elif one and other:
            if different := difference(one, other):
                cut = _shorter(one, other) if topic in _BLOCKS and different[0] else None
                if cut is not None and equal and (first, second)[cut].head() is None:
                    return TopicBits(topic, EQUAL, equal, note=_LONGER[cut])
                return TopicBits(topic, DIFFERENT, equal, one.time / SECOND, *different)
            equal += 1
            yield
        elif only := one or other:
            left = (second if one else first).head() is None
            if left and equal:
                longer = _LONGER[bool(one)]
                return TopicBits(
                    topic, EQUAL, equal, note=longer if only.time > end * SECOND else ""
                )
            if equal or (begun[bool(one)] and not left):
                texts = ("a message", "nothing at this time")
                texts = texts if one else texts[::-1]
                return TopicBits(topic, DIFFERENT, equal, only.time / SECOND, "", *texts)
            begun[not one] = True
            yield  # a recorder that began later misses nothing before
        else:
            yield
    if not equal:
        return TopicBits(topic, NOT_COMPARED, note="the runs have no time in common")
    return TopicBits(topic, EQUAL, equal)


def _shorter(one: Head, other: Head) -> int | None:
    """Return which of two blocks ends before the other, and is equal until then; else None.

    The segment in which it ends is cut off.
    """
    blocks = [vars(each.shifted()) for each in (one, other)]
    sizes = [max(map(len, filter(_is_array, each.values())), default=0) for each in blocks]
    count = max(0, min(sizes) - 1)
    parts = (
        Decoded(
            "", {name: each[:count] if _is_array(each) else each for name, each in block.items()}
        )
        for block in blocks
    )
    return None if sizes[0] == sizes[1] or first_field(*parts) else int(sizes[1] < sizes[0])


def _is_array(value: Any) -> bool:
    return isinstance(value, list | np.ndarray)
