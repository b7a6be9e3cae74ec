"""Messages of MCAP chunks in the order of their log times, in bounded memory.

A chunk is read when the first of its messages is due, and its messages are cut out one by one, so
that a reader neither stalls for long nor holds more than the chunks that overlap in time.
"""

from __future__ import annotations

import heapq
from array import array
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Chunk, ChunkIndex

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import (
    MESSAGE,
    RECORD,
    parse,
    read_record,
    records_in,
    uncompressed,
)

OVERLAP_LIMIT = 256 * 2**20
"""Bytes of chunks that may be open at once, because they overlap in time."""


@dataclass(frozen=True, slots=True)
class Message:
    """One message as it was serialized; times are integer nanoseconds since the epoch."""

    topic: str
    log_time: int
    publish_time: int
    data: bytes


@dataclass(frozen=True)
class Source:
    """Messages in the order of their log times, none of them before `start_time` [ns].

    `size` is what they take in memory while they are open [bytes].
    """

    start_time: int
    size: int
    open: Callable[[], Iterator[Message]]


def chunk_messages(
    stream: BinaryIO, index: ChunkIndex, topics: Mapping[int, str], start_time: int
) -> Iterator[Message]:
    """Yield a chunk's messages from `start_time` [ns] on, in the order of their log times.

    `topics` names the wanted channels. Raises BagFormatError where the chunk is damaged.
    """
    start = index.chunk_start_offset
    chunk = parse(read_record(stream, start, start + index.chunk_length))
    if not isinstance(chunk, Chunk) or chunk.uncompressed_size != index.uncompressed_size:
        raise BagFormatError("a chunk is not what its index says")
    data = uncompressed(chunk)
    del chunk
    yield from messages_in(data, topics, start_time)


def messages_in(data: bytes, topics: Mapping[int, str], start_time: int) -> Iterator[Message]:
    """Yield the messages of a chunk's data from `start_time` [ns] on, by their log times.

    Raises BagFormatError where the data is damaged.
    """
    times, places = array("Q"), array("Q")  # a tuple for each message would weigh more than it
    for opcode, start, _ in records_in(data):
        if opcode == Opcode.MESSAGE:
            channel, _, log_time, _ = MESSAGE.unpack_from(data, start)
            if channel in topics and log_time >= start_time:
                times.append(log_time)
                places.append(start)
    order: Sequence[int] = range(len(times))
    if any(before > after for before, after in pairwise(times)):
        order = sorted(order, key=times.__getitem__)
    for number in order:
        start = places[number]
        channel, _, log_time, publish_time = MESSAGE.unpack_from(data, start)
        _, length = RECORD.unpack_from(data, start - RECORD.size)
        content = data[start + MESSAGE.size : start + length]
        yield Message(topics[channel], log_time, publish_time, content)


def merged(sources: Iterable[Source]) -> Iterator[Message]:
    """Yield the messages of all sources in the order of their log times.

    A source is opened when nothing older is left; messages of equal time keep the sources' order.
    Raises BagFormatError where more than OVERLAP_LIMIT would be open at once.
    """
    pending = deque(sorted(sources, key=lambda source: source.start_time))
    sizes: list[int] = []  # of all that were opened, by their numbers
    total = 0
    queue: list[tuple[int, int, Message, Iterator[Message]]] = []
    while pending or queue:
        while pending and (not queue or pending[0].start_time <= queue[0][0]):
            source = pending.popleft()
            if queue and total + source.size > OVERLAP_LIMIT:
                raise BagFormatError(
                    f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
                    "too much to put their messages in order"
                )
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
        for message in messages:
            heapq.heapreplace(queue, (message.log_time, number, message, messages))
            break
        else:
            heapq.heappop(queue)
            total -= sizes[number]
