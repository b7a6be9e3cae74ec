"""Messages of an MCAP file in the order of their log times, in bounded memory.

A chunk is read when its first message is due, and its messages are cut out one by one. Thus a
reader neither stalls for long nor holds more than the chunks that overlap in time.
"""

from __future__ import annotations

import heapq
import os
import struct
from array import array
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import (
    MAGIC,
    MESSAGE,
    RECORD,
    parse,
    read_record,
    records_in,
    uncompressed,
)

if TYPE_CHECKING:
    from rpud_sim.bag.message_block import MessageBlock

_HEAD = struct.Struct("<BQHIQQ")  # a message's record up to its data

# Greatest size of the chunks that are open at once, because they overlap in time [bytes].
OVERLAP_LIMIT = 256 * 2**20


class Message(NamedTuple):
    """One serialized message; a tuple, as it is made three times as fast as a data class."""

    topic: str  # its name
    log_time: int  # when it was received [ns since the epoch]
    publish_time: int  # when it was sent [ns since the epoch]
    data: bytes  # its bytes (CDR)


@dataclass(frozen=True)
class Source:
    """Messages in the order of their log times."""

    start_time: int  # no message is earlier [ns]
    size: int  # memory that they take while they are open [bytes]
    open: Callable[[], Iterator[Message]]  # begins to read them
    # returns all of them as blocks; None if there may be too many
    blocks: Callable[[], list[MessageBlock]] | None = None


@dataclass(frozen=True)
class Piece:
    """Part of a bag that can be read by itself, such as a chunk."""

    start_time: int  # no message is earlier [ns]
    end_time: int  # no message is later [ns]
    size: int  # memory that its messages take [bytes]
    topics: frozenset[str]  # names of the topics that it may hold
    # yields the messages of topics in the order of their log times; None for all. It raises
    # BagFormatError if the part is damaged.
    read: Callable[[Collection[str] | None], Iterator[Message]]
    # returns the same in blocks, one for each topic; None if only ``read`` can
    blocks: Callable[[Collection[str] | None], list[MessageBlock]] | None = None


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


def read_chunk(stream: BinaryIO, index: ChunkIndex) -> bytes:
    """Return a chunk's uncompressed data; the position of ``stream`` stays as it is."""
    start = index.chunk_start_offset
    chunk = parse(read_record(_Place(stream), start, start + index.chunk_length))
    if not isinstance(chunk, Chunk) or chunk.uncompressed_size != index.uncompressed_size:
        raise BagFormatError("a chunk is not what its index says")
    return uncompressed(chunk)


def chunk_messages(
    stream: BinaryIO, index: ChunkIndex, topics: Mapping[int, str], start_time: int
) -> Iterator[Message]:
    """Yield a chunk's messages from ``start_time`` [ns] on, in the order of their log times."""
    yield from messages_in(read_chunk(stream, index), topics, start_time)


def unchunked_messages(
    path: Path,
    size: int,
    topics: Mapping[int, str],
    start_time: int,
    first: int = 0,
    end: int | None = None,
) -> Iterator[Message]:
    """Yield the messages of a file without an index of chunks, in the order of the file.

    ``topics`` are by channel, times in ns, ``size``, ``first`` and ``end`` in bytes; by default
    those of a closed file.
    """
    offset = first or len(MAGIC)
    with path.open("rb") as stream:
        while end is None or offset < end:
            record = read_record(stream, offset, size - len(MAGIC) if end is None else end)
            offset = record.end
            if record.opcode == Opcode.DATA_END:
                return
            if record.opcode == Opcode.CHUNK:
                chunk = parse(record)
                assert isinstance(chunk, Chunk)
                yield from messages_in(uncompressed(chunk), topics, start_time)
            if record.opcode == Opcode.MESSAGE:
                channel, _, log_time, publish_time = MESSAGE.unpack_from(record.content)
                if channel in topics and log_time >= start_time:
                    data = record.content[MESSAGE.size :]
                    yield Message(topics[channel], log_time, publish_time, data)


def messages_in(data: bytes, topics: Mapping[int, str], start_time: int) -> Iterator[Message]:
    """Yield the messages of a chunk's uncompressed data, in the order of their log times."""
    times, places = _places(data, topics, start_time)
    if any(before > after for before, after in pairwise(times)):
        order = sorted(range(len(times)), key=times.__getitem__)
        places = array("Q", [places[number] for number in order])
    unpack = _HEAD.unpack_from
    for place in places:
        _, length, channel, _, log_time, publish_time = unpack(data, place)
        content = data[place + _HEAD.size : place + RECORD.size + length]
        yield Message(topics[channel], log_time, publish_time, content)


def _places(data: bytes, topics: Mapping[int, str], start_time: int) -> tuple[array, array]:
    """Return log times and offsets of messages, checked as ``records_in`` does.

    All is in one loop, which is paid for each message of every bag that is read.
    """
    times, places = array("Q"), array("Q")  # tuples would take more than the messages
    note_time, note_place, unpack = times.append, places.append, _HEAD.unpack_from
    message, size = int(Opcode.MESSAGE), len(data)
    offset, last = 0, size - _HEAD.size
    while offset <= last:
        opcode, length, channel, _, log_time, _ = unpack(data, offset)
        end = offset + RECORD.size + length
        if end > size or opcode == 0 or (opcode == message and length < MESSAGE.size):
            break
        if opcode == message and log_time >= start_time and channel in topics:
            note_time(log_time)
            note_place(offset)
        offset = end
    for opcode, _, _ in records_in(data[offset:]):  # it is too short for a message, or damaged
        assert opcode != Opcode.MESSAGE
    return times, places


def merged(sources: Iterable[Source]) -> Iterator[Message]:
    """Yield the messages of all sources in the order of their log times.

    A source is opened when no earlier message is left. Messages of equal time keep the order of
    their sources.
    """
    pending = deque(sorted(sources, key=lambda source: source.start_time))
    sizes: list[int] = []  # of all opened sources, by their numbers
    total = 0
    queue: list[tuple[int, int, Message, Iterator[Message]]] = []
    while pending or queue:
        while pending and (not queue or pending[0].start_time <= queue[0][0]):
            source = pending.popleft()
            if queue and total + source.size > OVERLAP_LIMIT:
                raise overlap_error()
            messages = source.open()
            for message in messages:
                heapq.heappush(queue, (message.log_time, len(sizes), message, messages))
                total += source.size
                break
            sizes.append(source.size)
        if not queue:
            continue
        _, number, message, messages = queue[0]
        yield message
        # While nothing else is open, messages need no order until the next source begins.
        alone = len(queue) == 1
        until = (pending[0].start_time if pending else inf) if alone else -inf
        for message in messages:
            if message.log_time >= until:
                heapq.heapreplace(queue, (message.log_time, number, message, messages))
                break
            yield message
        else:
            heapq.heappop(queue)
            total -= sizes[number]


def overlap_error() -> BagFormatError:
    """Return the error of sources that are too large to be open at once."""
    return BagFormatError(
        f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
        "too much to put their messages in order"
    )
