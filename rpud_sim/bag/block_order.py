"""Blocks of messages in the order of log times within each topic, in bounded memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag.errors import BagError
from rpud_sim.bag.message_block import MessageBlock, joined
from rpud_sim.bag.messages import OVERLAP_LIMIT, Message, Source, overlap_error

_GATHERED_SIZE = 1 << 20  # bytes of messages that become blocks together
_GATHERED_COUNT = 8192
_LARGEST = 2**63 - 1


@dataclass(frozen=True)
class _Part:
    block: MessageBlock  # the messages
    times: np.ndarray  # from which they may be passed on [ns]: not before their source was due

    def cut(self, first: int, end: int | None) -> _Part:
        chosen = slice(first, end)
        return _Part(self.block.part(chosen), self.times[chosen])


def ordered_blocks(sources: Iterable[Source], end: int | None = None) -> Iterator[MessageBlock]:
    """Yield the messages of sources in blocks; within each topic they have the order of ``merged``.

    ``end`` is the log time of the first message that does not count [ns].
    """
    pending = sorted(sources, key=lambda source: source.start_time)
    if end is not None:
        pending = [source for source in pending if source.start_time < end]
    waiting: dict[str, list[_Part]] = {}
    opened: list[tuple[int, int]] = []  # last time and size of sources
    for source in pending:
        assert source.blocks is not None
        for topic in list(waiting):
            yield from _due(waiting, topic, source.start_time)
        opened = [each for each in opened if each[0] >= source.start_time]
        if opened and source.size + sum(size for _, size in opened) > OVERLAP_LIMIT:
            raise overlap_error()
        last = -1
        for block in source.blocks():
            times = block.log_times
            if times[0] < source.start_time:  # its index is wrong
                times = np.maximum(times, times.dtype.type(min(source.start_time, _LARGEST)))
            part = _Part(block, times)
            if end is not None and times[-1] >= end:
                part = part.cut(0, int(np.searchsorted(times, times.dtype.type(end))))
            if len(part.times):
                waiting.setdefault(block.topic, []).append(part)
                last = max(last, int(part.times[-1]))
        if last >= 0:
            opened.append((last, source.size))
    for topic in list(waiting):
        yield from _due(waiting, topic, None)


def gathered_blocks(messages: Iterable[Message], end: int | None = None) -> Iterator[MessageBlock]:
    """Yield messages in blocks, in their order; what was read before an error comes before it.

    ``end`` is the log time of the first message that does not count [ns].
    """
    found: dict[str, list[Message]] = {}
    count = size = 0
    try:
        for message in messages:
            if end is not None and message.log_time >= end:
                break
            found.setdefault(message.topic, []).append(message)
            count, size = count + 1, size + len(message.data)
            if count >= _GATHERED_COUNT or size >= _GATHERED_SIZE:
                group, found, count, size = found, {}, 0, 0
                yield from map(_gathered, group.values())
    except BagError:
        yield from map(_gathered, found.values())
        raise
    yield from map(_gathered, found.values())


def _gathered(messages: Sequence[Message]) -> MessageBlock:
    sizes = np.array([len(message.data) for message in messages], np.int64)
    return MessageBlock(
        messages[0].topic,
        _times([message.log_time for message in messages]),
        _times([message.publish_time for message in messages]),
        np.frombuffer(b"".join([message.data for message in messages]), np.uint8),
        np.cumsum(sizes) - sizes,
        sizes,
    )


def _times(times: list[int]) -> np.ndarray:
    return np.array(times, np.int64 if max(times) <= _LARGEST else np.uint64)


def _due(waiting: dict[str, list[_Part]], topic: str, until: int | None) -> Iterator[MessageBlock]:
    """Yield the waiting messages of a topic up to a time, which no later source precedes [ns]."""
    ready, rest = [], []
    for part in waiting[topic]:
        count = len(part.times)
        if until is not None and part.times[-1] > until:
            limit = part.times.dtype.type(until)
            count = int(np.searchsorted(part.times, limit, side="right"))
        if count == len(part.times):
            ready.append(part)
            continue
        if count:
            ready.append(part.cut(0, count))
        rest.append(part.cut(count, None))
    if rest:
        waiting[topic] = rest
    else:
        del waiting[topic]
    if all(ready[i].times[-1] <= ready[i + 1].times[0] for i in range(len(ready) - 1)):
        yield from (part.block for part in ready)
        return
    block = joined([part.block.packed() for part in ready])
    order = np.argsort(np.concatenate([part.times for part in ready]), kind="stable")
    yield block.part(order)
