"""Walks along the records of an MCAP file that is damaged, or has no index, in bounded memory."""

from __future__ import annotations

import struct
import zlib
from bisect import bisect_left
from collections import Counter
from collections.abc import Generator, Iterator
from dataclasses import dataclass, field
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    McapRecord,
    Message,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary

from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MAGIC,
    MESSAGE,
    RECORD,
    UNREADABLE,
    RawRecord,
    RecordFinder,
    message_index_times,
    parse,
    read_record,
    records_in,
)

STRETCH_SIZE = 1 << 20  # size of the messages outside of chunks that are read together [bytes]

_BLOCK = 1 << 20
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of its entries
_ENTRY_SIZE = 16
_DECLARATIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)


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
class MissingMessages:
    """Number of messages that a lost chunk had in one channel, from its message index."""

    channel: int
    count: int


Item = Found | Damage | MissingMessages


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
                yield MissingMessages(channel, sum(1 for _ in times))
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
                record = parse(RawRecord(opcode, data[start:end], end))
                assert record is not None
                yield Found(record, checked)
    except UNREADABLE:
        return False
    return True


def _message(data: bytes, start: int, end: int) -> Message:
    channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, start)
    return Message(channel, log_time, data[start + MESSAGE.size : end], publish_time, sequence)


def _attachment_checks(record: RawRecord) -> bool:
    (checksum,) = struct.unpack_from("<I", record.content, len(record.content) - 4)
    return checksum in (0, zlib.crc32(record.content[:-4]))


@dataclass
class Stretch:
    """Consecutive records outside of chunks."""

    start: int  # offset of the first record [bytes]
    end: int  # offset behind the last one [bytes]
    first: int  # log time of the earliest message [ns]
    last: int  # log time of the latest message [ns]
    channels: set[int] = field(default_factory=set)  # of the messages


class RecordWalk:
    """Walk along the records of a file that lacks an index, up to the last whole one.

    The content of chunks is not read, unless their indexes do not say what they hold.
    """

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._finder = RecordFinder(stream, size)
        self.summary = Summary()  # what the summary section of a closed file holds
        self.stretches: list[Stretch] = []  # messages outside of chunks
        self._counts: Counter[int] = Counter()
        self._first, self._last = 2**64 - 1, 0
        self._chunk: ChunkIndex | None = None
        self.end = len(MAGIC)  # offset behind the last whole record [bytes]
        while (end := self._record(self.end)) is not None:
            self.end = end
        head = self._finder.head(self.end)
        self.whole = head is not None and head[0] in _ENDS  # whether it met the file's end
        self._complete_chunk()
        channels, total = self.summary.channels, self._counts.total()
        self.summary.statistics = Statistics(
            attachment_count=0,
            channel_count=len(channels),
            channel_message_counts={
                number: count for number, count in self._counts.items() if number in channels
            },
            chunk_count=len(self.summary.chunk_indexes),
            message_count=total,
            message_end_time=self._last,
            message_start_time=self._first if total else 0,
            metadata_count=len(self.summary.metadata_indexes),
            schema_count=len(self.summary.schemas),
        )

    def _record(self, offset: int) -> int | None:
        """Note the record at an offset and return its end; None if there is no whole one."""
        head = self._finder.head(offset)
        if head is None or head[0] in _ENDS or head[1] > self._size:
            return None
        opcode, end = head
        if opcode == Opcode.MESSAGE_INDEX:
            self._note_index(offset)
        elif opcode == Opcode.CHUNK:
            self._complete_chunk()
            self._note_chunk(offset, end)
        elif opcode == Opcode.MESSAGE:
            self._note_message(offset, end)
        elif opcode in _DECLARATIONS:
            self._declare(read_record(self._stream, offset, self._size), offset)
        return end

    def _note_chunk(self, offset: int, end: int) -> None:
        found = self._finder.chunk(offset)
        if found is None or found[2] != end:
            return
        chunk, start, _ = found
        self._chunk = ChunkIndex(
            chunk_length=end - offset,
            chunk_start_offset=offset,
            compression=chunk.compression,
            compressed_size=end - start,
            message_end_time=chunk.message_end_time,
            message_index_length=0,
            message_index_offsets={},
            message_start_time=chunk.message_start_time,
            uncompressed_size=chunk.uncompressed_size,
        )

    def _note_index(self, offset: int) -> None:
        head = self._finder.content(offset, _INDEX_HEAD.size)
        if self._chunk is None or len(head) < _INDEX_HEAD.size:
            return
        _, _, channel, length = _INDEX_HEAD.unpack(head)
        if length:
            self._chunk.message_index_offsets[channel] = offset
            self._counts[channel] += length // _ENTRY_SIZE

    def _complete_chunk(self) -> None:
        """Add the chunk whose indexes have been passed; without them its content shows them."""
        chunk, self._chunk = self._chunk, None
        if chunk is None:
            return
        offsets = chunk.message_index_offsets
        if not offsets or not offsets.keys() <= self.summary.channels.keys():
            self._read_chunk(chunk, count=not offsets)
        self.summary.chunk_indexes.append(chunk)
        if chunk.uncompressed_size:
            self._note_times(chunk.message_start_time, chunk.message_end_time)

    def _read_chunk(self, index: ChunkIndex, *, count: bool) -> None:
        found = self._finder.chunk(index.chunk_start_offset)
        data = (self._finder.chunk_data(*found) if found else None) or b""
        try:
            for opcode, first, last in records_in(data):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._declare(RawRecord(opcode, data[first:last], last), first)
                elif opcode == Opcode.MESSAGE and count:
                    channel, *_ = MESSAGE.unpack_from(data, first)
                    self._counts[channel] += 1
        except UNREADABLE:
            return

    def _note_message(self, offset: int, end: int) -> None:
        content = self._finder.content(offset + RECORD.size, MESSAGE.size)
        if len(content) < MESSAGE.size:
            return
        channel, _, log_time, _ = MESSAGE.unpack(content)
        self._counts[channel] += 1
        self._note_times(log_time, log_time)
        last = self.stretches[-1] if self.stretches else None
        if last is None or last.end != offset or end - last.start > STRETCH_SIZE:
            last = Stretch(offset, end, log_time, log_time)
            self.stretches.append(last)
        last.end = end
        last.first, last.last = min(last.first, log_time), max(last.last, log_time)
        last.channels.add(channel)

    def _note_times(self, first: int, last: int) -> None:
        self._first, self._last = min(self._first, first), max(self._last, last)

    def _declare(self, record: RawRecord, offset: int) -> None:
        try:
            parsed = parse(record)
        except UNREADABLE:
            return
        if isinstance(parsed, Schema):
            self.summary.schemas.setdefault(parsed.id, parsed)
        elif isinstance(parsed, Channel):
            self.summary.channels.setdefault(parsed.id, parsed)
        elif isinstance(parsed, Metadata):
            index = MetadataIndex(offset, record.end - offset, parsed.name)
            self.summary.metadata_indexes.append(index)
