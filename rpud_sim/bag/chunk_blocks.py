"""Messages of an MCAP file by the block: a chunk's messages of a topic in one buffer."""

from __future__ import annotations

import os
import struct
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.record_walk import Stretch
from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MESSAGE,
    RECORD,
    parse,
    read_record,
    records_in,
    uncompressed,
)

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

_ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])
_INDEX = struct.Struct("<HI")  # channel, length of the entries [bytes]
_LARGEST = np.uint64(2**63 - 1)


def chunk_blocks(
    stream: BinaryIO, index: ChunkIndex, topics: Mapping[int, str]
) -> list[MessageBlock]:
    """Return a chunk's messages, a block for each topic in the order of log times.

    The position of ``stream`` stays as it is. ``topics`` has the names of the channels to read, by
    their numbers.
    """
    start = index.chunk_start_offset
    end = start + index.chunk_length
    chunk = parse(read_record(_Place(stream), start, end))
    if not isinstance(chunk, Chunk) or chunk.uncompressed_size != index.uncompressed_size:
        raise BagFormatError("a chunk is not what its index says")
    content = uncompressed(chunk)
    data = np.frombuffer(content, np.uint8)
    length = min(max(0, index.message_index_length), CONTENT_LIMIT)
    entries = _entries(memoryview(os.pread(stream.fileno(), length, end)))
    places = _indexed_places(data, entries)
    if places is None:
        places = _walked_places(content)
    return _blocks(data, places, topics)


def stretch_blocks(
    stream: BinaryIO, stretch: Stretch, topics: Mapping[int, str]
) -> list[MessageBlock]:
    """Return the messages of a stretch of records outside of chunks, as ``chunk_blocks`` does."""
    content = os.pread(stream.fileno(), stretch.end - stretch.start, stretch.start)
    return _blocks(np.frombuffer(content, np.uint8), _walked_places(content), topics)


class _Place:
    """Place in a file of its own, so that threads may read the same file."""

    def __init__(self, stream: BinaryIO) -> None:
        self._descriptor = stream.fileno()
        self._offset = 0

    def seek(self, offset: int) -> None:
        self._offset = offset

    def read(self, length: int) -> bytes:
        found = os.pread(self._descriptor, length, self._offset)
        self._offset += len(found)
        return found


def _entries(section: memoryview) -> np.ndarray | None:
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


def _indexed_places(data: np.ndarray, offsets: np.ndarray | None) -> np.ndarray | None:
    """Return the places of all messages in the order of the chunk, from those in its indexes.

    None unless a walk along the records would find the same: indexes may be wrong.
    """
    if offsets is None or len(data) < HEAD.itemsize:
        return None
    if len(offsets) and offsets.max() > len(data) - HEAD.itemsize:
        return None
    places = np.sort(offsets.astype(np.int64))
    heads = _heads(data, places)
    lengths = heads["length"]
    if (heads["opcode"] != Opcode.MESSAGE).any() or (lengths < MESSAGE.size).any():
        return None
    if (lengths > len(data)).any():
        return None
    ends = places + RECORD.size + lengths.astype(np.int64)
    before = np.concatenate([[0], ends])
    behind = np.concatenate([places, [len(data)]])
    # What lies between must be other records.
    for start, end in zip(before[before != behind], behind[before != behind], strict=True):
        if start > end or not _holds_no_message(data[start:end].tobytes()):
            return None
    return places


def _holds_no_message(data: bytes) -> bool:
    try:
        return all(opcode != Opcode.MESSAGE for opcode, _, _ in records_in(data))
    except BagFormatError:
        return False


def _walked_places(content: bytes) -> np.ndarray:
    found = [start for opcode, start, _ in records_in(content) if opcode == Opcode.MESSAGE]
    return np.array(found, np.int64) - RECORD.size


def _heads(data: np.ndarray, places: np.ndarray) -> np.ndarray:
    if not len(places):
        return np.empty(0, HEAD)
    found: np.ndarray = np.ndarray((len(data) - HEAD.itemsize + 1,), HEAD, data, strides=(1,))[
        places
    ]
    return found


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
    counts = np.bincount(of_message + 1, minlength=len(names) + 1)
    blocks = []
    end = counts[0]
    for name, number in names.items():
        rows = order[end : end + counts[number + 1]]
        end += len(rows)
        if not len(rows):
            continue
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
                places[rows] + HEAD.itemsize,
                found["length"].astype(np.int64) - MESSAGE.size,
            )
        )
    return blocks


def _times(times: np.ndarray) -> np.ndarray:
    return times.astype(np.uint64 if (times > _LARGEST).any() else np.int64)
