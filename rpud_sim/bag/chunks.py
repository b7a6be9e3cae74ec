"""Chunks of MCAP files that are being filled."""

from __future__ import annotations

import struct
from array import array
from dataclasses import dataclass

import numpy as np
from mcap.opcode import Opcode

from rpud_sim.bag.messages import MessageBlock, items
from rpud_sim.bag.records import HEAD, INDEX, MESSAGE, RECORD

HEAD_SIZE = HEAD.itemsize  # [bytes]

_HEAD = struct.Struct("<BQHIQQ")  # the same for one message
# Messages of at most this size are moved all at once, larger ones one by one [bytes].
_SMALL = 2048


@dataclass(frozen=True)
class MessageRecords:
    """Message records one behind the other, as a chunk holds them."""

    data: np.ndarray  # their bytes, uint8
    ends: np.ndarray  # where each ends in ``data``, int64, shape (n,)
    channels: np.ndarray  # number of the channel of each, shape (n,)
    log_times: np.ndarray  # of each [ns], int64, shape (n,)


def in_order(parts: list[tuple[int, MessageBlock, np.ndarray]]) -> MessageRecords:
    """Return the records of blocks of messages in one order.

    Each part has a channel, its messages, and the place of each among those of all parts. Those of
    equal place follow each other as the parts do.
    """
    order = np.argsort(np.concatenate([places for _, _, places in parts]), kind="stable")
    sizes = np.concatenate([block.sizes for _, block, _ in parts])[order] + HEAD_SIZE
    ends = np.cumsum(sizes)
    begins = np.empty_like(ends)
    begins[order] = ends - sizes
    data = np.empty(int(ends[-1]) if len(ends) else 0, np.uint8)
    first = 0
    for channel, block, _ in parts:
        _place(data, begins[first : first + len(block)], channel, block)
        first += len(block)
    channels = np.concatenate([np.full(len(block), channel) for channel, block, _ in parts])
    log_times = np.concatenate([block.log_times for _, block, _ in parts])
    return MessageRecords(data, ends, channels[order], log_times[order])


def _place(data: np.ndarray, begins: np.ndarray, channel: int, block: MessageBlock) -> None:
    heads = np.zeros(len(block), HEAD)
    heads["opcode"] = Opcode.MESSAGE
    heads["length"] = block.sizes + MESSAGE.size
    heads["channel"] = channel
    heads["log_time"] = block.log_times
    heads["publish_time"] = block.publish_times
    items(data, f"V{HEAD_SIZE}")[begins] = heads.view(f"V{HEAD_SIZE}")
    size = int(block.sizes[0]) if len(block) else 0
    if 0 < size <= _SMALL and (block.sizes == size).all():
        items(data, f"V{size}")[begins + HEAD_SIZE] = items(block.data, f"V{size}")[block.starts]
        return
    places = zip(begins.tolist(), block.starts.tolist(), block.sizes.tolist(), strict=True)
    for begin, start, length in places:
        begin += HEAD_SIZE
        data[begin : begin + length] = block.data[start : start + length]


class OpenChunk:
    """Chunk in progress."""

    def __init__(self) -> None:
        self.size = 0  # uncompressed [bytes]
        self.count = 0  # number of the messages
        self.first = self.last = 0  # log times of the earliest and the latest message [ns]
        self._parts: list[bytes | memoryview] = []
        self._entries: dict[int, array[int]] = {}  # log time and place of each, by channel

    @property
    def data(self) -> bytes:
        return b"".join(self._parts)

    @property
    def indexes(self) -> dict[int, bytes]:
        """Records of the message indexes, by channel."""
        indexes = {}
        for channel, entries in self._entries.items():
            content = np.frombuffer(entries, np.uint64).astype("<u8").tobytes()
            head = RECORD.pack(Opcode.MESSAGE_INDEX, INDEX.size + len(content))
            indexes[channel] = head + INDEX.pack(channel, len(content)) + content
        return indexes

    @property
    def counts(self) -> dict[int, int]:
        """Numbers of messages, by channel."""
        return {channel: len(entries) // 2 for channel, entries in self._entries.items()}

    def declare(self, record: bytes) -> None:
        self._parts.append(record)
        self.size += len(record)

    def add(self, channel: int, data: bytes, log_time: int, publish_time: int, number: int) -> None:
        self._widen(log_time, log_time)
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = array("Q")
        entries.append(log_time)
        entries.append(self.size)
        self.count += 1
        length = MESSAGE.size + len(data)
        self._parts += (
            _HEAD.pack(Opcode.MESSAGE, length, channel, number, log_time, publish_time),
            data,
        )
        self.size += RECORD.size + length

    def extend(self, records: MessageRecords, first: int, end: int) -> None:
        """Add the records from number ``first`` to ``end``."""
        start = int(records.ends[first - 1]) if first else 0
        ends = records.ends[first:end]
        places = np.empty((end - first, 2), np.uint64)
        places[:, 0] = log_times = records.log_times[first:end]
        places[:, 1] = np.concatenate([[start], ends[:-1]]) + (self.size - start)
        channels = records.channels[first:end]
        found, firsts = np.unique(channels, return_index=True)
        for channel in found[np.argsort(firsts)].tolist():
            entries = self._entries.setdefault(channel, array("Q"))
            entries.frombytes(places[channels == channel].tobytes())
        self._widen(int(log_times.min()), int(log_times.max()))
        self.count += end - first
        self._parts.append(records.data[start : int(ends[-1])].data)
        self.size += int(ends[-1]) - start

    def _widen(self, first: int, last: int) -> None:
        self.first = min(first, self.first) if self.count else first
        self.last = max(last, self.last)
