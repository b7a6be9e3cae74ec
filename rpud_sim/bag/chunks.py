"""Chunks of MCAP files: messages of a topic from one, and one that is being filled."""

from __future__ import annotations

import os
import struct
from array import array
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from io import BytesIO
from typing import BinaryIO

import lz4.frame
import numpy as np
import zstandard
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import LATEST, MessageBlock, items
from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MESSAGE,
    RECORD,
    parse,
    read_record,
    records_in,
    uncompressed,
)

# Names of the compressions in MCAP, by those in options.
COMPRESSIONS = {"none": "", "lz4": "lz4", "zstd": "zstd"}

# Bits of a drill's numbers are noise for the most part. Level 1 takes three times as long as -1,
# its bytes twice as long to read, and they are 5 % fewer.
_LEVEL = -1

# Beginning of a message's record; its bytes follow.
HEAD = np.dtype(
    [
        ("opcode", "u1"),
        ("length", "<u8"),
        ("channel", "<u2"),
        ("sequence", "<u4"),
        ("log_time", "<u8"),
        ("publish_time", "<u8"),
    ]
)
HEAD_SIZE = HEAD.itemsize  # [bytes]

_HEAD = struct.Struct("<BQHIQQ")  # the same for one message
_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])  # of a message index
_INDEX = struct.Struct("<HI")  # channel, length of the entries [bytes]
# Messages of at most this size are moved all at once, larger ones one by one [bytes].
_SMALL = 2048


def chunk_blocks(
    stream: BinaryIO, index: ChunkIndex, topics: Mapping[int, str]
) -> list[MessageBlock]:
    """Return a chunk's messages, a block for each topic in the order of log times.

    The position of ``stream`` stays as it is, so threads may read one file. ``topics`` has the
    names of the channels to read, by their numbers.
    """
    place, length = index.chunk_start_offset, index.chunk_length
    found = os.pread(stream.fileno(), min(length, RECORD.size + CONTENT_LIMIT), place)
    chunk = parse(read_record(BytesIO(found), 0, length))
    if not isinstance(chunk, Chunk) or chunk.uncompressed_size != index.uncompressed_size:
        raise BagFormatError("a chunk is not what its index says")
    content = uncompressed(chunk)
    data = np.frombuffer(content, np.uint8)
    size = min(max(0, index.message_index_length), CONTENT_LIMIT)
    offsets = _indexed_offsets(memoryview(os.pread(stream.fileno(), size, place + length)))
    places = None if offsets is None else _checked_places(data, offsets)
    return _blocks(data, _walked_places(content) if places is None else places, topics)


def stretch_blocks(
    stream: BinaryIO, start: int, end: int, topics: Mapping[int, str]
) -> list[MessageBlock]:
    """Return the messages of records outside of chunks, as ``chunk_blocks`` does."""
    content = os.pread(stream.fileno(), end - start, start)
    return _blocks(np.frombuffer(content, np.uint8), _walked_places(content), topics)


def _indexed_offsets(section: memoryview) -> np.ndarray | None:
    """Return the places that a chunk's message indexes name; None if they are damaged."""
    found: list[np.ndarray] = []
    place = 0
    while place < len(section):
        if place + RECORD.size + _INDEX.size > len(section):
            return None
        opcode, length = RECORD.unpack_from(section, place)
        place += RECORD.size
        _, size = _INDEX.unpack_from(section, place)
        if opcode != Opcode.MESSAGE_INDEX or size % _ENTRY.itemsize or _INDEX.size + size > length:
            return None
        if place + length > len(section):
            return None
        entries = np.frombuffer(section, _ENTRY, size // _ENTRY.itemsize, place + _INDEX.size)
        found.append(entries["offset"])
        place += length
    return np.concatenate(found) if found else None


def _checked_places(data: np.ndarray, offsets: np.ndarray) -> np.ndarray | None:
    """Return the places of all messages in the order of the chunk, from those in its indexes.

    None unless a walk along the records would find the same: indexes may be wrong.
    """
    if len(data) < HEAD_SIZE or (len(offsets) and offsets.max() > len(data) - HEAD_SIZE):
        return None
    places = np.sort(offsets.astype(np.int64))
    heads = _heads(data, places)
    lengths = heads["length"]
    if (heads["opcode"] != Opcode.MESSAGE).any():
        return None
    if (lengths < MESSAGE.size).any() or (lengths > len(data)).any():
        return None
    before = np.concatenate([[0], places + RECORD.size + lengths.astype(np.int64)])
    behind = np.concatenate([places, [len(data)]])
    # What lies between must be other records.
    for start, end in zip(before[before != behind], behind[before != behind], strict=True):
        try:
            between = records_in(data[start:end].tobytes())
            if start > end or any(opcode == Opcode.MESSAGE for opcode, _, _ in between):
                return None
        except BagFormatError:
            return None
    return places


def _walked_places(content: bytes) -> np.ndarray:
    found = [start for opcode, start, _ in records_in(content) if opcode == Opcode.MESSAGE]
    return np.array(found, np.int64) - RECORD.size


def _heads(data: np.ndarray, places: np.ndarray) -> np.ndarray:
    return items(data, HEAD)[places] if len(places) else np.empty(0, HEAD)


def _blocks(data: np.ndarray, places: np.ndarray, topics: Mapping[int, str]) -> list[MessageBlock]:
    heads = _heads(data, places)
    held = np.bincount(heads["channel"])
    numbers = np.full(len(held), -1)  # of the topic of each channel; -1 if it is not wanted
    names: dict[str, int] = {}
    for channel in np.flatnonzero(held).tolist():
        if channel in topics:
            numbers[channel] = names.setdefault(topics[channel], len(names))
    of_message = numbers[heads["channel"]]
    order = np.argsort(of_message, kind="stable")
    ends = np.cumsum(np.bincount(of_message + 1, minlength=len(names) + 1))
    blocks = []
    for number, name in enumerate(names):
        rows = order[ends[number] : ends[number + 1]]
        times = heads["log_time"][rows]
        if (times[1:] < times[:-1]).any():
            rows = rows[np.argsort(times, kind="stable")]
        found = heads[rows]
        blocks.append(
            MessageBlock(
                name,
                _times(found["log_time"]),
                _times(found["publish_time"]),
                data,
                places[rows] + HEAD_SIZE,
                found["length"].astype(np.int64) - MESSAGE.size,
            )
        )
    return blocks


def _times(times: np.ndarray) -> np.ndarray:
    return times.astype(np.uint64 if (times > np.uint64(LATEST)).any() else np.int64)


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
            head = RECORD.pack(Opcode.MESSAGE_INDEX, _INDEX.size + len(content))
            indexes[channel] = head + _INDEX.pack(channel, len(content)) + content
        return indexes

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


def compressor(name: str) -> Callable[[bytes], bytes]:
    """Return what compresses chunks, by MCAP's name; threads must not share it."""
    if name == "zstd":
        return zstandard.ZstdCompressor(level=_LEVEL).compress
    compress: Callable[[bytes], bytes] = lz4.frame.compress if name else bytes
    return compress
