"""Serialized messages: one by one, in batches of a topic, and in the order of log times."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np

from rpud_sim.bag.errors import BagFormatError

if TYPE_CHECKING:
    from rpud_sim.bag.mcap_reader import BagChunk

LATEST = 2**63 - 1  # greatest time in a bag of rosbag2 [ns since the epoch]

# Greatest size of the chunks that are open at once, because they overlap in time [bytes].
OVERLAP_LIMIT = 256 * 2**20


class Message(NamedTuple):
    """One serialized message; a tuple, as it is made three times as fast as a data class."""

    topic: str  # its name
    log_time: int  # when it was received [ns since the epoch]
    publish_time: int  # when it was sent [ns since the epoch]
    data: bytes  # its bytes (CDR)


@dataclass(frozen=True)
class SerializedBatch:
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

    def part(self, chosen: slice | np.ndarray) -> SerializedBatch:
        """Return some of the messages, in the same buffer."""
        if isinstance(chosen, slice) and chosen.indices(len(self)) == (0, len(self), 1):
            return self
        times = self.log_times[chosen], self.publish_times[chosen]
        return SerializedBatch(
            self.topic, *times, self.data, self.starts[chosen], self.sizes[chosen]
        )

    def packed(self) -> SerializedBatch:
        """Return the same messages in a buffer that holds little else."""
        if 2 * int(self.sizes.sum()) >= len(self.data):
            return self
        data = gathered(self.data, self.starts, self.sizes)
        return replace(self, data=data, starts=np.cumsum(self.sizes) - self.sizes)


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
    return np.frombuffer(bytearray().join([view[start:end] for start, end in pairs]), np.uint8)


def joined(batches: Sequence[SerializedBatch]) -> SerializedBatch:
    """Return the messages of batches of one topic in one, in their order."""
    if len(batches) == 1:
        return batches[0]
    batches = [batch.packed() for batch in batches]
    begins = accumulate((len(batch.data) for batch in batches), initial=0)
    starts = [batch.starts + begin for batch, begin in zip(batches, begins, strict=False)]
    return SerializedBatch(
        batches[0].topic,
        np.concatenate([batch.log_times for batch in batches]),
        np.concatenate([batch.publish_times for batch in batches]),
        np.concatenate([batch.data for batch in batches]),
        np.concatenate(starts),
        np.concatenate([batch.sizes for batch in batches]),
    )


def messages_of(batches: Sequence[SerializedBatch]) -> Iterator[Message]:
    """Yield the messages of batches in the order of their log times.

    Those of one time keep the order of the buffers, and of their places there.
    """
    if not batches:
        return
    buffers: dict[int, int] = {}
    numbers = [buffers.setdefault(id(batch.data), len(buffers)) for batch in batches]
    counts = [len(batch) for batch in batches]
    starts = np.concatenate([batch.starts for batch in batches])
    logs = np.concatenate([batch.log_times for batch in batches])
    order = np.lexsort((starts, np.repeat(numbers, counts), logs))
    own = np.repeat(np.arange(len(batches)), counts)[order].tolist()
    ends = starts + np.concatenate([batch.sizes for batch in batches])
    sent = np.concatenate([batch.publish_times for batch in batches])
    topics, contents = [batch.topic for batch in batches], [batch.data.data for batch in batches]
    places = zip(own, starts[order].tolist(), ends[order].tolist(), strict=True)
    yield from map(
        Message,
        map(topics.__getitem__, own),
        logs[order].tolist(),
        sent[order].tolist(),
        (bytes(contents[number][start:end]) for number, start, end in places),
    )


def ordered_by_topic(batches: Iterable[SerializedBatch]) -> Iterator[SerializedBatch]:
    """Yield batches of which those of each topic have the order of log times."""
    by_topic: dict[str, list[SerializedBatch]] = {}
    for batch in batches:
        by_topic.setdefault(batch.topic, []).append(batch)
    for parts in by_topic.values():
        if all(a.log_times[-1] <= b.log_times[0] for a, b in pairwise(parts)):
            yield from parts
        else:
            batch = joined(parts)
            yield batch.part(np.argsort(batch.log_times, kind="stable"))


def due_batches(
    chunks: Iterable[BagChunk],
    topics: Collection[str] | None = None,
    start: int = 0,
    end: int | None = None,
) -> Iterator[list[SerializedBatch]]:
    """Yield the batches that are due before each chunk, and the rest at the end.

    No later one has an earlier message. A chunk is read when none before it holds earlier ones.
    ``topics`` is None for all. ``start`` is the log time of the first message that counts, ``end``
    that of the first that does not count any more [ns].
    """
    chosen = [
        chunk
        for chunk in chunks
        if chunk.end_time >= start
        and (end is None or chunk.start_time < end)
        and (topics is None or not chunk.topics.isdisjoint(topics))
    ]
    waiting: list[SerializedBatch] = []
    opened: list[tuple[int, int]] = []  # last time and size of chunks
    for chunk in sorted(chosen, key=lambda chunk: chunk.start_time):
        due, waiting = _parted(waiting, chunk.start_time)
        yield due
        opened = [each for each in opened if each[0] >= chunk.start_time]
        if opened and chunk.size + sum(size for _, size in opened) > OVERLAP_LIMIT:
            raise BagFormatError(
                f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
                "too much to put their messages in order"
            )
        last = -1
        for batch in chunk.batches(topics):
            first = _count_before(batch.log_times, start)
            behind = len(batch) if end is None else _count_before(batch.log_times, end)
            batch = batch.part(slice(first, behind))
            if len(batch):
                waiting.append(batch)
                last = max(last, int(batch.log_times[-1]))
        if last >= 0:
            opened.append((last, chunk.size))
    yield waiting


def _parted(
    waiting: Iterable[SerializedBatch], until: int
) -> tuple[list[SerializedBatch], list[SerializedBatch]]:
    """Return what is due up to a time [ns], which no later chunk precedes, and the rest."""
    due, rest = [], []
    for batch in waiting:
        count = _count_before(batch.log_times, until, "right")
        if count:
            due.append(batch.part(slice(0, count)))
        if count < len(batch):
            rest.append(batch.part(slice(count, None)))
    return due, rest


def _count_before(times: np.ndarray, time: int, side: Literal["left", "right"] = "left") -> int:
    if not len(times) or times[-1] < time:
        return len(times)
    return int(np.searchsorted(times, time, side))
