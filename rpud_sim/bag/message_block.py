"""Serialized messages of one topic in one buffer, for work on all of them at once."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate

import numpy as np

from rpud_sim.bag.messages import Message


@dataclass(frozen=True)
class MessageBlock:
    """Consecutive serialized messages of one topic."""

    topic: str  # its name
    # when they were received [ns since the epoch], int64, shape (n,); uint64 only if a
    # damaged file has a time that int64 cannot hold
    log_times: np.ndarray
    publish_times: np.ndarray  # when they were sent [ns since the epoch], as ``log_times``
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
        times = self.log_times[chosen], self.publish_times[chosen]
        return MessageBlock(self.topic, *times, self.data, self.starts[chosen], self.sizes[chosen])

    def packed(self) -> MessageBlock:
        """Return the same messages in a buffer that holds little else."""
        if 2 * int(self.sizes.sum()) >= len(self.data):
            return self
        data = gathered(self.data, self.starts, self.sizes)
        return replace(self, data=data, starts=np.cumsum(self.sizes) - self.sizes)


def gathered(data: np.ndarray, starts: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """Return the bytes of messages one behind the other; ``data`` is uint8, sizes are in bytes."""
    count = len(starts)
    if not count or not sizes.any():
        return np.empty(0, np.uint8)
    size = int(sizes[0])
    ends = starts + sizes
    if (starts[1:] == ends[:-1]).all():
        return data[starts[0] : ends[-1]].copy()
    if (sizes == size).all():
        return items(data, size)[starts].view(np.uint8)
    view = data.data
    pairs = zip(starts.tolist(), ends.tolist(), strict=True)
    return np.frombuffer(b"".join([view[start:end] for start, end in pairs]), np.uint8)


def items(data: np.ndarray, size: int) -> np.ndarray:
    """Return an overlapping view of bytes with an item of ``size`` bytes at each place.

    NumPy copies whole items, which is faster than byte by byte.
    """
    return np.ndarray((len(data) - size + 1,), f"V{size}", data, strides=(1,))


def joined(blocks: Sequence[MessageBlock]) -> MessageBlock:
    """Return the messages of packed blocks of one topic in one, in their order."""
    if len(blocks) == 1:
        return blocks[0]
    begins = accumulate((len(block.data) for block in blocks), initial=0)
    return MessageBlock(
        blocks[0].topic,
        same_times([block.log_times for block in blocks]),
        same_times([block.publish_times for block in blocks]),
        np.concatenate([block.data for block in blocks]),
        np.concatenate(
            [block.starts + begin for block, begin in zip(blocks, begins, strict=False)]
        ),
        np.concatenate([block.sizes for block in blocks]),
    )


def messages_of(
    blocks: Sequence[MessageBlock], due: Sequence[np.ndarray] | None = None
) -> Iterator[Message]:
    """Yield the messages of blocks in the order of their log times.

    Those of one time keep the order of the buffers, and of their places there. ``due`` has other
    times for the order.
    """
    if not blocks:
        return
    buffers: dict[int, int] = {}
    numbers = [buffers.setdefault(id(block.data), len(buffers)) for block in blocks]
    counts = [len(block) for block in blocks]
    starts = np.concatenate([block.starts for block in blocks])
    logs = same_times([block.log_times for block in blocks])
    times = logs if due is None else same_times(due)
    order = np.lexsort((starts, np.repeat(numbers, counts), times))
    own = np.repeat(np.arange(len(blocks)), counts)[order].tolist()
    ends = starts + np.concatenate([block.sizes for block in blocks])
    sent = same_times([block.publish_times for block in blocks])
    topics, contents = [block.topic for block in blocks], [block.data.data for block in blocks]
    places = zip(own, starts[order].tolist(), ends[order].tolist(), strict=True)
    yield from map(
        Message,
        map(topics.__getitem__, own),
        logs[order].tolist(),
        sent[order].tolist(),
        (bytes(contents[number][start:end]) for number, start, end in places),
    )


def same_times(times: Sequence[np.ndarray]) -> np.ndarray:
    """Return times together; int64 and uint64 would become inexact numbers."""
    kinds = {part.dtype for part in times}
    if len(kinds) > 1:
        times = [part.astype(np.uint64) for part in times]
    return np.concatenate(times)
