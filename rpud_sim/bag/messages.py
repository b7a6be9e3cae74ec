"""Serialized messages: one by one, in blocks of a topic, and in the order of log times."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from rpud_sim.bag.errors import BagError, BagFormatError

if TYPE_CHECKING:
    from rpud_sim.bag.metadata import Topic

LATEST = 2**63 - 1  # greatest time in a bag of rosbag2 [ns since the epoch]

# Channel metadata of messages that a file repeats of the previous one.
REPEATED_KEY = "rpud_repeated"

# Greatest size of the segments that are open at once, because they overlap in time [bytes].
OVERLAP_LIMIT = 256 * 2**20

_GROUP_SIZE = 1 << 20  # bytes of messages that become blocks together
_GROUP_COUNT = 8192


class Message(NamedTuple):
    """One serialized message; a tuple, as it is made three times as fast as a data class."""

    topic: str  # its name
    log_time: int  # when it was received [ns since the epoch]
    publish_time: int  # when it was sent [ns since the epoch]
    data: bytes  # its bytes (CDR)


@dataclass(frozen=True)
class MessageBlock:
    """Consecutive serialized messages of one topic."""

    topic: str  # its name
    log_times: np.ndarray  # when they were received [ns since the epoch], int64, shape (n,)
    publish_times: np.ndarray  # when they were sent [ns since the epoch], int64, shape (n,)
    data: np.ndarray  # bytes (CDR) of all messages, uint8; they may have other bytes between them
    starts: np.ndarray  # where each message begins in ``data``, int64, shape (n,)
    sizes: np.ndarray  # of each message [bytes], int64, shape (n,)

    def __len__(self) -> int:
        return len(self.starts)

    def message(self, number: int) -> bytes:
        start = int(self.starts[number])
        return self.data[start : start + int(self.sizes[number])].tobytes()

    def part(self, chosen: slice | np.ndarray) -> MessageBlock:
        """Return some of the messages, in the same buffer."""
        if isinstance(chosen, slice) and chosen.indices(len(self)) == (0, len(self), 1):
            return self
        times = self.log_times[chosen], self.publish_times[chosen]
        return MessageBlock(self.topic, *times, self.data, self.starts[chosen], self.sizes[chosen])

    def packed(self) -> MessageBlock:
        """Return the same messages in a buffer that holds little else."""
        if 2 * int(self.sizes.sum()) >= len(self.data):
            return self
        data = gathered(self.data, self.starts, self.sizes)
        return replace(self, data=data, starts=np.cumsum(self.sizes) - self.sizes)


@dataclass(frozen=True)
class BagSegment:
    """Part of a bag that can be read by itself, such as a chunk."""

    start_time: int  # no message is earlier [ns]
    end_time: int  # no message is later [ns]
    size: int  # memory that its messages take [bytes]
    topics: frozenset[str]  # names of the topics that it may hold
    # returns the messages of topics in blocks, each in the order of log times; None for all. It
    # raises BagFormatError if the part is damaged.
    blocks: Callable[[Collection[str] | None], Iterable[MessageBlock]]


class LatchedMessages:
    """Last messages of each topic with a transient local publisher, one for each publisher."""

    def __init__(self) -> None:
        self._messages: dict[str, deque[Message]] = {}

    def declare(self, topic: Topic) -> None:
        """Add a topic; it is ignored if it is not latched."""
        if any(offer.durability == "transient_local" for offer in topic.offered_qos):
            self._messages.setdefault(topic.name, deque(maxlen=len(topic.offered_qos)))

    def __contains__(self, topic: str) -> bool:
        return topic in self._messages

    @property
    def size(self) -> int:
        """Size of the messages, with an overhead for each [bytes]."""
        return sum(len(message.data) + 64 for each in self._messages.values() for message in each)

    def note(self, message: Message) -> None:
        if message.topic in self._messages:
            self._messages[message.topic].append(message)

    def at(self, log_time: int) -> list[Message]:
        """Return the messages in their order, as if they were received at ``log_time`` [ns]."""
        kept = [message for messages in self._messages.values() for message in messages]
        kept.sort(key=lambda message: message.log_time)
        return [message._replace(log_time=log_time) for message in kept]

    def clear(self) -> None:
        for messages in self._messages.values():
            messages.clear()


def items(data: np.ndarray, dtype: np.dtype | str) -> np.ndarray:
    """Return an overlapping view of bytes with an item at each place, which need not be aligned.

    NumPy copies whole items, which is faster than byte by byte.
    """
    dtype = np.dtype(dtype)
    return np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, strides=(1,))


def gathered(data: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the bytes of messages one behind the other; ``data`` is uint8, sizes are in bytes."""
    if not len(starts) or not sizes.any():
        return np.empty(0, np.uint8)
    ends = starts + sizes
    if (starts[1:] == ends[:-1]).all():
        return data[starts[0] : ends[-1]].copy()
    if (sizes == sizes[0]).all():
        return items(data, f"V{sizes[0]}")[starts].view(np.uint8)
    view = data.data
    pairs = zip(starts.tolist(), ends.tolist(), strict=True)
    return np.frombuffer(b"".join([view[start:end] for start, end in pairs]), np.uint8)


def joined(blocks: Sequence[MessageBlock]) -> MessageBlock:
    """Return the messages of packed blocks of one topic in one, in their order."""
    if len(blocks) == 1:
        return blocks[0]
    begins = accumulate((len(block.data) for block in blocks), initial=0)
    return MessageBlock(
        blocks[0].topic,
        np.concatenate([block.log_times for block in blocks]),
        np.concatenate([block.publish_times for block in blocks]),
        np.concatenate([block.data for block in blocks]),
        np.concatenate(
            [block.starts + begin for block, begin in zip(blocks, begins, strict=False)]
        ),
        np.concatenate([block.sizes for block in blocks]),
    )


def messages_of(blocks: Sequence[MessageBlock]) -> Iterator[Message]:
    """Yield the messages of blocks in the order of their log times.

    Those of one time keep the order of the buffers, and of their places there.
    """
    if not blocks:
        return
    buffers: dict[int, int] = {}
    numbers = [buffers.setdefault(id(block.data), len(buffers)) for block in blocks]
    counts = [len(block) for block in blocks]
    starts = np.concatenate([block.starts for block in blocks])
    logs = np.concatenate([block.log_times for block in blocks])
    order = np.lexsort((starts, np.repeat(numbers, counts), logs))
    own = np.repeat(np.arange(len(blocks)), counts)[order].tolist()
    ends = starts + np.concatenate([block.sizes for block in blocks])
    sent = np.concatenate([block.publish_times for block in blocks])
    topics, contents = [block.topic for block in blocks], [block.data.data for block in blocks]
    places = zip(own, starts[order].tolist(), ends[order].tolist(), strict=True)
    yield from map(
        Message,
        map(topics.__getitem__, own),
        logs[order].tolist(),
        sent[order].tolist(),
        (bytes(contents[number][start:end]) for number, start, end in places),
    )


def blocks_of(messages: Iterable[Message]) -> Iterator[MessageBlock]:
    """Yield messages in blocks, in their order; what was read before an error comes before it."""
    group: list[Message] = []
    size = 0
    try:
        for message in messages:
            group.append(message)
            size += len(message.data)
            if len(group) >= _GROUP_COUNT or size >= _GROUP_SIZE:
                full, group, size = group, [], 0
                yield from _grouped(full)
    except BagError:
        yield from _grouped(group)
        raise
    yield from _grouped(group)


def _grouped(messages: Sequence[Message]) -> Iterator[MessageBlock]:
    """Yield a block for each topic of some messages; all are in one buffer in their order."""
    data = np.frombuffer(b"".join([message.data for message in messages]), np.uint8)
    ends = accumulate(len(message.data) for message in messages)
    found: dict[str, list[tuple[Message, int]]] = {}
    for message, end in zip(messages, ends, strict=True):
        found.setdefault(message.topic, []).append((message, end))
    for topic, pairs in found.items():
        sizes = np.array([len(message.data) for message, _ in pairs], np.int64)
        logs = np.array([message.log_time for message, _ in pairs], np.int64)
        sent = np.array([message.publish_time for message, _ in pairs], np.int64)
        starts = np.array([end for _, end in pairs], np.int64) - sizes
        yield MessageBlock(topic, logs, sent, data, starts, sizes)


def ordered_by_topic(blocks: Iterable[MessageBlock]) -> Iterator[MessageBlock]:
    """Yield blocks of which those of each topic have the order of log times."""
    by_topic: dict[str, list[MessageBlock]] = {}
    for block in blocks:
        by_topic.setdefault(block.topic, []).append(block)
    for parts in by_topic.values():
        if all(a.log_times[-1] <= b.log_times[0] for a, b in pairwise(parts)):
            yield from parts
        else:
            block = joined([part.packed() for part in parts])
            yield block.part(np.argsort(block.log_times, kind="stable"))


def due_blocks(
    segments: Iterable[BagSegment],
    topics: Collection[str] | None = None,
    start: int = 0,
    end: int | None = None,
) -> Iterator[list[MessageBlock]]:
    """Yield the blocks that are due before each segment, and the rest at the end.

    No later one has an earlier message. A segment is read when none before it holds earlier ones.
    ``topics`` is None for all. ``start`` is the log time of the first message that counts, ``end``
    that of the first that does not count any more [ns].
    """
    chosen = [
        segment
        for segment in segments
        if segment.end_time >= start
        and (end is None or segment.start_time < end)
        and (topics is None or not segment.topics.isdisjoint(topics))
    ]
    waiting: list[MessageBlock] = []
    opened: list[tuple[int, int]] = []  # last time and size of segments
    for segment in sorted(chosen, key=lambda segment: segment.start_time):
        due, waiting = _parted(waiting, segment.start_time)
        yield due
        opened = [each for each in opened if each[0] >= segment.start_time]
        if opened and segment.size + sum(size for _, size in opened) > OVERLAP_LIMIT:
            raise BagFormatError(
                f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
                "too much to put their messages in order"
            )
        last = -1
        for block in segment.blocks(topics):
            first = _count_before(block.log_times, start)
            behind = len(block) if end is None else _count_before(block.log_times, end)
            block = block.part(slice(first, behind))
            if len(block):
                waiting.append(block)
                last = max(last, int(block.log_times[-1]))
        if last >= 0:
            opened.append((last, segment.size))
    yield waiting


def _parted(
    waiting: Iterable[MessageBlock], until: int
) -> tuple[list[MessageBlock], list[MessageBlock]]:
    """Return what is due up to a time [ns], which no later segment precedes, and the rest."""
    due, rest = [], []
    for block in waiting:
        count = _count_before(block.log_times, until, "right")
        if count:
            due.append(block.part(slice(0, count)))
        if count < len(block):
            rest.append(block.part(slice(count, None)))
    return due, rest


def _count_before(times: np.ndarray, time: int, side: Literal["left", "right"] = "left") -> int:
    if not len(times) or times[-1] < time:
        return len(times)
    return int(np.searchsorted(times, time, side))
