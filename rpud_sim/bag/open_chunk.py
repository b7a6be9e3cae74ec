"""Chunk of an MCAP file that is being filled, and its compression."""

from __future__ import annotations

import struct
import zlib
from array import array
from collections.abc import Mapping
from dataclasses import dataclass

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode

from rpud_sim.bag.chunk_blocks import HEAD
from rpud_sim.bag.message_block import MessageBlock, items

# Names of the compressions in MCAP, by those in options.
COMPRESSIONS = {"none": "", "lz4": "lz4", "zstd": "zstd"}

HEAD_SIZE = HEAD.itemsize  # size of a message's record before its data [bytes]

# Bits of a drill's numbers are noise for the most part. Level 1 takes three times as long as -1,
# its bytes twice as long to read, and they are 5 % fewer.
_LEVEL = -1
_HEAD = struct.Struct("<BQHIQQ")  # kind, length, channel, number, log and publish time
_INDEX = struct.Struct("<BQHI")  # kind, length, channel, size of the entries
# Messages of at most this size are moved all at once, larger ones one by one [bytes].
_SMALL = 2048


@dataclass(frozen=True)
class Records:
    """Message records one behind the other, as a chunk holds them."""

    data: np.ndarray  # their bytes, uint8
    ends: np.ndarray  # where each ends in ``data``, int64, shape (n,)
    channels: np.ndarray  # number of the channel of each, shape (n,)
    log_times: np.ndarray  # of each [ns], int64, shape (n,)


def in_order(parts: list[tuple[int, MessageBlock, np.ndarray]]) -> Records:
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
    return Records(data, ends, channels[order], log_times[order])


def _place(data: np.ndarray, begins: np.ndarray, channel: int, block: MessageBlock) -> None:
    count = len(block)
    heads = np.zeros(count, HEAD)
    heads["opcode"] = Opcode.MESSAGE
    heads["length"] = block.sizes + (HEAD_SIZE - 9)
    heads["channel"] = channel
    heads["log_time"] = block.log_times
    heads["publish_time"] = block.publish_times
    items(data, HEAD_SIZE)[begins] = heads.view(f"V{HEAD_SIZE}")
    size = int(block.sizes[0]) if count else 0
    if 0 < size <= _SMALL and (block.sizes == size).all():
        items(data, size)[begins + HEAD_SIZE] = items(block.data, size)[block.starts]
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
        self._parts: list[bytes | memoryview] = []
        self._first = self._last = 0
        self._entries: dict[int, array[int]] = {}  # log time and place of each, by channel

    def declare(self, record: bytes) -> None:
        self._parts.append(record)
        self.size += len(record)

    def add(self, channel: int, log_time: int, data: bytes, publish_time: int, number: int) -> None:
        self._widen(log_time, log_time)
        entries = self._entries.get(channel)
        if entries is None:
            entries = self._entries[channel] = array("Q")
        entries.append(log_time)
        entries.append(self.size)
        self.count += 1
        length = _HEAD.size - 9 + len(data)
        head = _HEAD.pack(Opcode.MESSAGE, length, channel, number, log_time, publish_time)
        self._parts += head, data
        self.size += len(head) + len(data)

    def extend(self, records: Records, first: int, end: int) -> None:
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
        self._first = min(first, self._first) if self.count else first
        self._last = max(last, self._last)

    def close(self) -> ClosedChunk:
        """Return the chunk as it is, ready to be compressed."""
        return ClosedChunk(b"".join(self._parts), self._first, self._last, self._entries)


@dataclass(frozen=True)
class ClosedChunk:
    """Chunk that is full, uncompressed."""

    data: bytes  # its bytes
    first: int  # log time of its earliest message [ns]
    last: int  # log time of its latest one [ns]
    entries: Mapping[int, array[int]]  # log time and place of each message in turn, by channel

    @property
    def indexes(self) -> dict[int, bytes]:
        """Records of the message indexes, by channel."""
        indexes = {}
        for channel, entries in self.entries.items():
            content = np.frombuffer(entries, np.uint64).astype("<u8").tobytes()
            size = len(content)
            indexes[channel] = _INDEX.pack(Opcode.MESSAGE_INDEX, 6 + size, channel, size) + content
        return indexes


class Compressor:
    """Compressor of chunks with zstd, lz4 or, if empty, none; threads must not use it at once."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._zstd = zstandard.ZstdCompressor(level=_LEVEL) if name == "zstd" else None

    def record(self, chunk: ClosedChunk) -> tuple[bytes, bytes]:
        """Return the record of a chunk, in two parts: its head and its compressed data."""
        data = chunk.data
        if self._zstd is not None:
            data = self._zstd.compress(chunk.data)
        elif self.name:
            data = lz4.frame.compress(chunk.data)
        name = self.name.encode()
        head = struct.pack(
            "<QQQI", chunk.first, chunk.last, len(chunk.data), zlib.crc32(chunk.data)
        )
        head += struct.pack(f"<I{len(name)}sQ", len(name), name, len(data))
        return struct.pack("<BQ", Opcode.CHUNK, len(head) + len(data)) + head, data
