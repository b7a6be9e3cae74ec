"""Scan of an MCAP file from its beginning, past all damage, in bounded memory."""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_left
from collections.abc import Generator, Iterator
from dataclasses import dataclass
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema

from rpud_sim.bag.record_finder import UNREADABLE, RecordFinder
from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MAGIC,
    MESSAGE,
    Record,
    message_index_times,
    parse,
    records_in,
)

_BLOCK = 1 << 20


@dataclass(frozen=True, slots=True)
class Found:
    """A readable record, and whether a checksum covers it."""

    record: McapRecord
    checked: bool


@dataclass(frozen=True, slots=True)
class Damage:
    """Lost bytes of the file, and the reason."""

    offset: int
    size: int
    reason: str


@dataclass(frozen=True, slots=True)
class Missing:
    """Number of messages that a lost chunk had in one channel, from its message index."""

    channel: int
    count: int


Item = Found | Damage | Missing


class Scan:
    """Everything readable in a file, to be iterated over once."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self.position = 0  # offset of the scan in the file [bytes]
        self.closed = False  # at the end, whether the file has the end of a closed one
        self._finder = RecordFinder(stream, size)
        self._size = size
        self._index_lost = False  # whether the next message indexes are those of a lost chunk
        self._chunked = False

    @property
    def begins(self) -> bool:
        return self._finder.content(0, len(MAGIC)) == MAGIC

    def __iter__(self) -> Iterator[Item]:
        """Yield records and damages in the order of the file. Raise OSError if the disk fails."""
        offset = len(MAGIC) if self.begins else 0
        while offset < self._size:
            self.position = offset
            if self._finder.content(offset, len(MAGIC) + 1) == MAGIC:
                return
            self.closed = False
            end = yield from self._record(offset)
            if end is None:
                end = self._finder.next(offset + 1, messages=not self._chunked)
                yield Damage(offset, end - offset, "holds no whole record")
            offset = end
        self.position = self._size
        self.closed = False

    def _record(self, offset: int) -> Generator[Item, None, int | None]:
        """Yield the content of the record at ``offset``; return its end, None without a record."""
        head = self._finder.head(offset)
        if head is None:
            return None
        opcode, end = head
        if opcode == Opcode.CHUNK:
            return (yield from self._chunk(offset, end))
        size = end - offset
        if opcode == Opcode.ATTACHMENT and size > CONTENT_LIMIT and self._finder.continues(end):
            yield Damage(offset, size, f"is an attachment of more than {CONTENT_LIMIT} bytes")
            return end
        record = self._finder.record(offset)
        if record is None:
            return None
        if opcode == Opcode.MESSAGE_INDEX:
            if self._index_lost:
                channel, times = message_index_times(record)
                yield Missing(channel, sum(1 for _ in times))
            return end
        self._index_lost = False
        self.closed = opcode == Opcode.FOOTER
        if opcode == Opcode.MESSAGE:
            yield Found(_message(record.content, 0, len(record.content)), False)
        elif opcode == Opcode.ATTACHMENT and not _attachment_checks(record):
            yield Damage(offset, size, "is an attachment whose checksum is wrong")
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT):
            parsed = parse(record)
            assert parsed is not None
            yield Found(parsed, opcode == Opcode.ATTACHMENT)
        return end

    def _chunk(self, offset: int, end: int) -> Generator[Item, None, int | None]:
        place = self._finder.chunk(offset)
        if place is None:
            return None
        chunk, start, inner_end = place
        self._chunked = self._index_lost = True
        # One of the two lengths may be damaged; the checksum shows which is right.
        for candidate in {end: None, inner_end: None}:
            data = self._finder.chunk_data(chunk, start, candidate)
            if data is not None:
                self._index_lost = False
                if not (yield from _found(data, chunk.uncompressed_crc != 0)):
                    yield Damage(offset, candidate - offset, "is a chunk with what is no record")
                return candidate
        if end != inner_end:
            return None
        if end > self._size:
            yield from self._cut_off(chunk, offset, start)
            return self._size
        if not self._finder.continues(end):
            return None
        if end - offset > CONTENT_LIMIT or chunk.uncompressed_size > CONTENT_LIMIT:
            yield Damage(offset, end - offset, f"is a chunk of more than {CONTENT_LIMIT} bytes")
        else:
            # A doubtful declaration is better than none: other chunks may need it.
            for found in _found(self._salvaged(chunk, start, end), False):
                if isinstance(found.record, Schema | Channel):
                    yield found
            yield Damage(offset, end - offset, "is a chunk whose checksum is wrong")
        return end

    def _cut_off(self, chunk: Chunk, offset: int, start: int) -> Iterator[Item]:
        """Yield the readable beginning of a chunk that reaches beyond the end of the file."""

        def salvaged(end: int) -> Iterator[Found]:
            return _found(self._salvaged(chunk, start, end), False)

        found = count = 0
        for item in salvaged(self._size):
            found += 1
            count += isinstance(item.record, Message)
            yield item
        if found:  # what is saved ends where a shorter file would have less
            places = range(start, self._size)
            offset = start + bisect_left(
                places, found, key=lambda end: sum(1 for _ in salvaged(end))
            )
        yield Damage(
            offset,
            self._size - offset,
            f"is of a chunk that is cut off; {count} messages of it were saved, without a checksum",
        )

    def _salvaged(self, chunk: Chunk, start: int, end: int) -> bytes:
        data = self._finder.content(start, min(end - start, CONTENT_LIMIT))
        if not data:
            return b""  # for which the reader of zstd waits forever
        most = min(chunk.uncompressed_size, CONTENT_LIMIT)
        parts = bytearray()
        try:
            if chunk.compression == "":
                return data[:most]
            if chunk.compression == "lz4":
                return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=most))
            if chunk.compression == "zstd":
                with zstandard.ZstdDecompressor().stream_reader(data) as reader:
                    while len(parts) < most and (part := reader.read1(min(most, _BLOCK))):
                        parts += part
        except UNREADABLE:
            pass
        return bytes(parts[:most])


def _found(data: bytes, checked: bool) -> Generator[Found, None, bool]:
    try:
        for opcode, start, end in records_in(data):
            if opcode == Opcode.MESSAGE:
                yield Found(_message(data, start, end), checked)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                record = parse(Record(opcode, data[start:end], end))
                assert record is not None
                yield Found(record, checked)
    except UNREADABLE:
        return False
    return True


def _message(data: bytes, start: int, end: int) -> Message:
    channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, start)
    return Message(channel, log_time, data[start + MESSAGE.size : end], publish_time, sequence)


def _attachment_checks(record: Record) -> bool:
    (checksum,) = struct.unpack_from("<I", record.content, len(record.content) - 4)
    return checksum in (0, zlib.crc32(record.content[:-4]))
