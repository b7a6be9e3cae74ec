"""Messages of MCAP chunks in the order of their log times, in bounded memory.

A chunk is read when the first of its messages is due, and its messages are cut out one by one, so
that a reader neither stalls for long nor holds more than the chunks that overlap in time.
"""

from __future__ import annotations

import heapq
import struct
import zlib
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from rpud_sim.bag.errors import BagFormatError

_RECORD = struct.Struct("<BQ")  # opcode, length of the content
_MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time


@dataclass(frozen=True, slots=True)
class Message:
    """One message as it was serialized; times are integer nanoseconds since the epoch."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class Source:
    """Messages in the order of their log times, none of them before `start_time` [ns]."""

    start_time: int
    open: Callable[[], Iterator[Message]]


def chunk_messages(
    stream: BinaryIO, index: ChunkIndex, topics: Mapping[int, str], start_time: int
) -> Iterator[Message]:
    """Yield a chunk's messages from `start_time` [ns] on, in the order of their log times.

    `topics` names the wanted channels. Raises BagFormatError where the chunk is damaged.
    """
    stream.seek(index.chunk_start_offset + _RECORD.size)
    data = _uncompressed(Chunk.read(ReadDataStream(stream)))
    entries = []
    offset = 0
    while offset < len(data):
        opcode, length = _RECORD.unpack_from(data, offset)
        content = offset + _RECORD.size
        offset = content + length
        if offset > len(data):
            raise BagFormatError("a record reaches beyond its chunk")
        if opcode != Opcode.MESSAGE:
            continue
        channel, _, log_time, _ = _MESSAGE.unpack_from(data, content)
        if channel in topics and log_time >= start_time:
            entries.append((log_time, content, offset))
    entries.sort()
    for log_time, content, end in entries:
        channel, _, _, publish_time = _MESSAGE.unpack_from(data, content)
        yield Message(topics[channel], log_time, publish_time, data[content + _MESSAGE.size : end])


def merged(sources: Iterable[Source]) -> Iterator[Message]:
    """Yield the messages of all sources in the order of their log times.

    A source is opened when nothing older is left; messages of equal time keep the sources' order.
    """
    pending = deque(sorted(sources, key=lambda source: source.start_time))
    opened = 0
    queue: list[tuple[int, int, Message, Iterator[Message]]] = []
    while pending or queue:
        while pending and (not queue or pending[0].start_time <= queue[0][0]):
            messages = pending.popleft().open()
            for message in messages:
                heapq.heappush(queue, (message.log_time, opened, message, messages))
                break
            opened += 1
        if not queue:
            continue
        _, number, message, messages = queue[0]
        yield message
        for message in messages:
            heapq.heapreplace(queue, (message.log_time, number, message, messages))
            break
        else:
            heapq.heappop(queue)


def _uncompressed(chunk: Chunk) -> bytes:
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        data = zstandard.decompress(chunk.data, max_output_size=chunk.uncompressed_size)
    elif chunk.compression == "lz4":
        data = lz4.frame.decompress(chunk.data)
    else:
        raise BagFormatError(f"a chunk has the unknown compression {chunk.compression!r}")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise BagFormatError("the checksum of a chunk is wrong")
    return data
