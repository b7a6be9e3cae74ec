"""Serialized messages: one by one, in batches of a topic, and in the order of log times."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np

LATEST = 2**63 - 1  # greatest time in a bag of rosbag2 [ns since the epoch]


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
    run: int = 0  # number of their run, given by their source; 0 if it is not known
    origin: int = 0  # stamp of zero in the time of that run [ns]

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
        places = self.starts[chosen], self.sizes[chosen]
        return SerializedBatch(self.topic, *times, self.data, *places, self.run, self.origin)

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
    """Return the messages of batches of one topic and run in one, in their order."""
    if len(batches) == 1:
        return batches[0]
    batches = [batch.packed() for batch in batches]
    begins = accumulate((len(batch.data) for batch in batches), initial=0)
    starts = [batch.starts + begin for batch, begin in zip(batches, begins, strict=False)]
    return replace(
        batches[0],
        log_times=np.concatenate([batch.log_times for batch in batches]),
        publish_times=np.concatenate([batch.publish_times for batch in batches]),
        data=np.concatenate([batch.data for batch in batches]),
        starts=np.concatenate(starts),
        sizes=np.concatenate([batch.sizes for batch in batches]),
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
