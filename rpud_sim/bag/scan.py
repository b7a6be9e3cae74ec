"""Walk through an MCAP file from its beginning, past whatever is damaged, in bounded memory.

Records follow each other by their lengths. Where that leads to something that is no record, the
walk looks for the next place at which one begins: a chunk proves itself by its checksum, anything
else by the lengths in it and by the record after it.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace
from typing import BinaryIO

import lz4.frame
import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, McapRecord, Message, Schema

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MAGIC,
    MESSAGE,
    RECORD,
    Record,
    fills,
    limit,
    message_index_times,
    parse,
    read_record,
    records_in,
    uncompressed,
)

DAMAGED = (
    BagFormatError,
    McapError,
    MemoryError,
    RuntimeError,
    ValueError,
    EOFError,
    struct.error,
    zstandard.ZstdError,
)
"""What damaged bytes raise in the libraries that read them."""

_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, size, checksum, length of the compression
_LENGTH = struct.Struct("<Q")
_BLOCK = 1 << 20
# A record that is worth finding: its kind, and a length below 4 GiB.
_BEGINNING = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{4}\x00{4})", re.DOTALL)
_ANY_LENGTH = (Opcode.CHUNK, Opcode.ATTACHMENT)  # to be left out where they are too large
_PRIVATE = 0x80  # kinds from here on are for others to define


@dataclass(frozen=True, slots=True)
class Found:
    """A record that was found, and whether a checksum vouches for it."""

    record: McapRecord
    checked: bool


@dataclass(frozen=True, slots=True)
class Damage:
    """Bytes of the file that are lost, and why."""

    offset: int
    size: int
    reason: str


@dataclass(frozen=True, slots=True)
class Missing:
    """Messages that a chunk had which is lost, by what its index says."""

    channel: int
    count: int


Item = Found | Damage | Missing


class Scan:
    """All that can be found in `stream`, a file of `size` bytes.

    Iterate over it once. `position` is how far it has come [bytes]; `closed` tells at the end
    whether the file ends as one that was closed.
    """

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self.position = 0
        self.closed = False
        self._stream = stream
        self._size = size
        self._index_lost = False  # whether the message indexes here are those of a lost chunk
        self._chunked = False
        self._effort = 4 * size + 2**30  # bytes that looking for a chunk may read

    @property
    def begins(self) -> bool:
        """Whether the file begins as an MCAP file does."""
        return self._bytes(0, len(MAGIC)) == MAGIC

    def __iter__(self) -> Iterator[Item]:
        """Yield what is found, in the order of the file. Raises OSError."""
        offset = len(MAGIC) if self.begins else 0
        while offset < self._size:
            self.position = offset
            if self._bytes(offset, len(MAGIC) + 1) == MAGIC:
                return
            self.closed = False
            end = yield from self._record(offset)
            if end is None:
                end = self._next(offset + 1)
                yield Damage(offset, end - offset, "holds no whole record")
            offset = end
        self.position = self._size
        self.closed = False

    def _record(self, offset: int) -> Generator[Item, None, int | None]:
        """Yield what the record at `offset` holds; return where it ends, None if it is none."""
        head = self._head(offset)
        if head is None:
            return None
        opcode, end = head
        if opcode == Opcode.CHUNK:
            return (yield from self._chunk(offset, end))
        if opcode == Opcode.ATTACHMENT and end - offset > CONTENT_LIMIT and self._follows(end):
            yield Damage(
                offset, end - offset, f"is an attachment of more than {CONTENT_LIMIT} bytes"
            )
            return end
        record = self._whole(offset)
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
            yield Damage(offset, end - offset, "is an attachment whose checksum is wrong")
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA, Opcode.ATTACHMENT):
            parsed = parse(record)
            assert parsed is not None
            yield Found(parsed, opcode == Opcode.ATTACHMENT)
        return end

    def _chunk(self, offset: int, end: int) -> Generator[Item, None, int | None]:
        place = self._chunk_place(offset)
        if place is None:
            return None
        chunk, start, inner_end = place
        self._chunked = self._index_lost = True
        # One of the two lengths may be damaged; the checksum tells which is right.
        for candidate in {end: None, inner_end: None}:
            data = self._chunk_data(chunk, start, candidate)
            if data is not None:
                self._index_lost = False
                if not (yield from _found(data, chunk.uncompressed_crc != 0)):
                    yield Damage(offset, candidate - offset, "is a chunk with what is no record")
                return candidate
        if end != inner_end:
            return None
        if end <= self._size:
            if not self._follows(end):
                return None
            if end - offset > CONTENT_LIMIT or chunk.uncompressed_size > CONTENT_LIMIT:
                yield Damage(offset, end - offset, f"is a chunk of more than {CONTENT_LIMIT} bytes")
            else:
                yield from self._declared(chunk, start, end)
                yield Damage(offset, end - offset, "is a chunk whose checksum is wrong")
            return end
        count = 0
        for found in _found(self._salvaged(chunk, start, self._size), False):
            count += isinstance(found.record, Message)
            yield found
        yield Damage(
            offset,
            self._size - offset,
            f"is a chunk that is cut off; {count} messages of it were saved, without a checksum",
        )
        return self._size

    def _declared(self, chunk: Chunk, start: int, end: int) -> Iterator[Found]:
        """Yield the channels that a damaged chunk declares: better a doubtful name than none."""
        for found in _found(self._salvaged(chunk, start, end), False):
            if isinstance(found.record, Schema | Channel):
                yield found

    def _salvaged(self, chunk: Chunk, start: int, end: int) -> bytes:
        """Give as much of a chunk's data as can be uncompressed."""
        data = self._bytes(start, min(end - start, CONTENT_LIMIT))
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
        except DAMAGED:
            pass
        return bytes(parts[:most])

    def _chunk_place(self, offset: int) -> tuple[Chunk, int, int] | None:
        """Give a chunk's fields without its data, and where by its own length that is."""
        head = self._bytes(offset + RECORD.size, _CHUNK_HEAD.size + 32 + _LENGTH.size)
        if len(head) < _CHUNK_HEAD.size:
            return None
        start_time, end_time, size, checksum, length = _CHUNK_HEAD.unpack_from(head)
        data_length = _CHUNK_HEAD.size + length
        if length > 32 or len(head) < data_length + _LENGTH.size:
            return None
        name = head[_CHUNK_HEAD.size : data_length].decode("ascii", "replace")
        chunk = Chunk(name, b"", end_time, start_time, checksum, size)
        start = offset + RECORD.size + data_length + _LENGTH.size
        return chunk, start, start + _LENGTH.unpack_from(head, data_length)[0]

    def _chunk_data(self, chunk: Chunk, start: int, end: int) -> bytes | None:
        """Give a chunk's data; None where it is damaged, or nothing vouches for it."""
        if end > self._size or not 0 <= end - start <= CONTENT_LIMIT:
            return None
        try:
            content = self._bytes(start, end - start)
            data = uncompressed(replace(chunk, data=content))
        except DAMAGED:
            return None
        return data if chunk.uncompressed_crc or self._follows(end) else None

    def _head(self, offset: int) -> tuple[int, int] | None:
        """Give the kind of the record at `offset` and its end, where these make sense."""
        head = self._bytes(offset, RECORD.size)
        if len(head) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(head)
        known = 0 < opcode <= max(Opcode) or opcode >= _PRIVATE
        if not known or (opcode not in _ANY_LENGTH and length > limit(opcode)):
            return None
        return opcode, offset + RECORD.size + length

    def _whole(self, offset: int) -> Record | None:
        """Give the record at `offset` if its lengths agree and another one follows it."""
        try:
            record = read_record(self._stream, offset, self._size)
            if not fills(record):
                return None
            if record.opcode == Opcode.MESSAGE_INDEX:
                message_index_times(record)
        except DAMAGED:
            return None
        if record.opcode == Opcode.MESSAGE and len(record.content) < MESSAGE.size:
            return None
        return record if self._follows(record.end) else None

    def _follows(self, offset: int) -> bool:
        """Tell whether the file ends at `offset`, within a record's head, or goes on with one.

        A file system may fill with zeros what it had no time to write.
        """
        if self._size - offset < RECORD.size:
            return offset <= self._size
        return self._head(offset) is not None or not any(self._bytes(offset, RECORD.size))

    def _next(self, start: int) -> int:
        """Find the next place where a record begins; the file's end if there is none."""
        for offset in range(start, self._size, _BLOCK):
            block = self._bytes(offset, _BLOCK + RECORD.size - 1)
            for match in _BEGINNING.finditer(block):
                if match.start() >= _BLOCK or self._effort < 0:
                    break
                if self._begins(offset + match.start()):
                    return offset + match.start()
        return self._size

    def _begins(self, offset: int) -> bool:
        """Tell whether a record that proves itself begins at `offset`."""
        head = self._head(offset)
        if head is None or head[1] > self._size:
            return False
        opcode, end = head
        self._effort -= end - offset
        if opcode == Opcode.CHUNK:
            place = self._chunk_place(offset)
            if place is None or place[2] != end or not place[0].uncompressed_crc:
                return False
            return self._chunk_data(place[0], place[1], end) is not None
        if opcode == Opcode.MESSAGE and self._chunked:
            return False  # one out of a chunk that is damaged
        return self._whole(offset) is not None

    def _bytes(self, offset: int, length: int) -> bytes:
        self._stream.seek(offset)
        return self._stream.read(max(0, min(length, self._size - offset)))


def _found(data: bytes, checked: bool) -> Generator[Found, None, bool]:
    """Yield declarations and messages out of a chunk's data; return whether it ends with one."""
    try:
        for opcode, start, end in records_in(data):
            if opcode == Opcode.MESSAGE:
                yield Found(_message(data, start, end), checked)
            elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                record = parse(Record(opcode, data[start:end], end))
                assert record is not None
                yield Found(record, checked)
    except DAMAGED:
        return False
    return True


def _message(data: bytes, start: int, end: int) -> Message:
    channel, sequence, log_time, publish_time = MESSAGE.unpack_from(data, start)
    return Message(channel, log_time, data[start + MESSAGE.size : end], publish_time, sequence)


def _attachment_checks(record: Record) -> bool:
    (checksum,) = struct.unpack_from("<I", record.content, len(record.content) - 4)
    return checksum in (0, zlib.crc32(record.content[:-4]))
