"""Messages of pieces in the order of log times, in bounded memory: in blocks, or one by one."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np

from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.message_block import MessageBlock, joined, messages_of, same_times
from rpud_sim.bag.messages import Message, Piece

# Greatest size of the pieces that are open at once, because they overlap in time [bytes].
OVERLAP_LIMIT = 256 * 2**20

_GATHERED_SIZE = 1 << 20  # bytes of messages that become blocks together
_GATHERED_COUNT = 8192
_LARGEST = 2**63 - 1


@dataclass(frozen=True)
class _Part:
    block: MessageBlock  # the messages
    times: np.ndarray  # from which they may be passed on [ns]: not before their piece was due
    piece: int  # number of their piece

    def cut(self, first: int, end: int | None) -> _Part:
        chosen = slice(first, end)
        return _Part(self.block.part(chosen), self.times[chosen], self.piece)


class PiecesInOrder:
    """Messages of topics in pieces: a piece is read when none before it holds earlier ones.

    ``topics`` is None for all. ``start`` is the log time of the first message that counts, ``end``
    that of the first that does not count any more [ns].
    """

    def __init__(
        self,
        pieces: Iterable[Piece],
        topics: Collection[str] | None = None,
        start: int = 0,
        end: int | None = None,
    ) -> None:
        chosen = [
            piece
            for piece in pieces
            if piece.end_time >= start
            and (end is None or piece.start_time < end)
            and (topics is None or not piece.topics.isdisjoint(topics))
        ]
        self._pieces = sorted(chosen, key=lambda piece: piece.start_time)
        self._topics, self._start, self._end = topics, start, end

    def blocks(self) -> Iterator[MessageBlock]:
        """Yield blocks of one topic; within each topic they have the order of ``messages``."""
        for due in self._steps():
            for parts in due.values():
                if all(a.times[-1] <= b.times[0] for a, b in pairwise(parts)):
                    yield from (part.block for part in parts)
                else:
                    block = joined([part.block.packed() for part in parts])
                    times = same_times([part.times for part in parts])
                    yield block.part(np.argsort(times, kind="stable"))

    def messages(self) -> Iterator[Message]:
        """Yield messages in the order of their log times, those of one time in that of pieces."""
        for due in self._steps():
            parts = [part for parts in due.values() for part in parts]
            parts.sort(key=lambda part: part.piece)
            yield from messages_of([part.block for part in parts], [part.times for part in parts])

    def _steps(self) -> Iterator[dict[str, list[_Part]]]:
        """Yield what is due before each piece, by topic, and what is left at the end."""
        waiting: dict[str, list[_Part]] = {}
        opened: list[tuple[int, int]] = []  # last time and size of pieces
        for number, piece in enumerate(self._pieces):
            yield _due(waiting, piece.start_time)
            opened = [each for each in opened if each[0] >= piece.start_time]
            if opened and piece.size + sum(size for _, size in opened) > OVERLAP_LIMIT:
                raise BagFormatError(
                    f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
                    "too much to put their messages in order"
                )
            last = -1
            for block in piece.blocks(self._topics):
                part = self._part(block, number, piece.start_time)
                if len(part.times):
                    waiting.setdefault(block.topic, []).append(part)
                    last = max(last, int(part.times[-1]))
            if last >= 0:
                opened.append((last, piece.size))
        yield waiting

    def _part(self, block: MessageBlock, number: int, due: int) -> _Part:
        first = _count_before(block.log_times, self._start)
        end = None if self._end is None else _count_before(block.log_times, self._end)
        if first or end is not None:
            block = block.part(slice(first, end))
        times = block.log_times
        if len(times) and times[0] < due:  # the piece's index is wrong
            times = np.maximum(times, times.dtype.type(min(due, _LARGEST)))
        return _Part(block, times, number)


def gathered_blocks(messages: Iterable[Message]) -> Iterator[MessageBlock]:
    """Yield messages in blocks, in their order; what was read before an error comes before it."""
    found: dict[str, list[Message]] = {}
    count = size = 0
    try:
        for message in messages:
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


def _count_before(times: np.ndarray, time: int, side: Literal["left", "right"] = "left") -> int:
    if time > np.iinfo(times.dtype).max:
        return len(times)
    return int(np.searchsorted(times, times.dtype.type(time), side))


def _due(waiting: dict[str, list[_Part]], until: int) -> dict[str, list[_Part]]:
    """Take what waits up to a time, which no later piece precedes [ns]."""
    due: dict[str, list[_Part]] = {}
    for topic, parts in list(waiting.items()):
        ready, rest = [], []
        for part in parts:
            count = _count_before(part.times, until, "right")
            if count == len(part.times):
                ready.append(part)
                continue
            if count:
                ready.append(part.cut(0, count))
            rest.append(part.cut(count, None))
        if ready:
            due[topic] = ready
        if rest:
            waiting[topic] = rest
        else:
            del waiting[topic]
    return due
