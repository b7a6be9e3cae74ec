"""Everything readable in an MCAP file that may be damaged, in bounded memory.

Records follow each other by their lengths. After damage the next record must be searched. A chunk
proves itself by its checksum; any other record by the lengths inside it and by the next record.
"""

from __future__ import annotations

import re
from bisect import bisect_left
from collections.abc import Generator, Iterator
from contextlib import suppress
from typing import NamedTuple

from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord, Message

from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MAGIC,
    MESSAGE,
    RECORD,
    UNREADABLE,
    RawRecord,
    RecordFile,
    inflated,
    message_index,
    parse,
    records_in,
)

_BLOCK = 1 << 20
# A record that is worth finding: its kind, and a length below 4 GiB.
_BEGINNING = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{4}\x00{4})", re.DOTALL)
_KEPT = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)


class Found(NamedTuple):
    """A readable record, and whether a checksum covers it."""

    record: McapRecord
    checked: bool


class Damage(NamedTuple):
    """Lost bytes of the file, and the reason."""

    offset: int
    size: int
    reason: str


class UnreadMessages(NamedTuple):
    """Number of messages that a lost chunk had in one channel, from its message index."""

    channel: int
    messages: int


Item = Found | Damage | UnreadMessages


class Scan:
    """Everything readable in a file, to be iterated over once."""

    def __init__(self, file: RecordFile) -> None:
        self.position = 0  # offset of the scan in the file [bytes]
        self.closed = False  # at the end, whether the file has the end of a closed one
        self._file = file
        self._effort = 4 * file.size + 2**30  # bytes that the search for chunks may read
        self._index_lost = False  # whether the next message indexes are those of a lost chunk
        self._chunked = False

    @property
    def begins(self) -> bool:
        return self._file.content(0, len(MAGIC)) == MAGIC

    def __iter__(self) -> Iterator[Item]:
        """Yield records and damages in the order of the file. Raise OSError if the disk fails."""
        offset = len(MAGIC) if self.begins else 0
        while offset < self._file.size:
            self.position = offset
            if self._file.content(offset, len(MAGIC) + 1) == MAGIC:
                return
            self.closed = False
            end = yield from self._record(offset)
            if end is None:
                end = self._next(offset + 1)
                yield Damage(offset, end - offset, "holds no whole record")
            offset = end
        self.position = self._file.size
        self.closed = False

    def _record(self, offset: int) -> Generator[Item, None, int | None]:
        """Yield the content of the record at ``offset``; return its end, None without a record."""
        head = self._file.head(offset)
        if head is None:
            return None
        opcode, end = head
        if opcode == Opcode.CHUNK:
            return (yield from self._chunk(offset, end))
        if opcode == Opcode.ATTACHMENT and self._file.continues(end):
            yield Damage(offset, end - offset, "is an attachment, which is left out")
            return end
        record = self._file.sound(offset)
        if record is None:
            return None
        if opcode == Opcode.MESSAGE_INDEX:
            if self._index_lost:
                channel, entries = message_index(record)
                yield UnreadMessages(channel, len(entries))
            return end
        self._index_lost = False
        self.closed = opcode == Opcode.FOOTER
        if opcode == Opcode.MESSAGE:
            yield Found(_message(record.content, 0, len(record.content)), False)
        elif opcode in _KEPT:
            parsed = parse(record)
            assert parsed is not None
            yield Found(parsed, False)
        return end

    def _chunk(self, offset: int, end: int) -> Generator[Item, None, int | None]:
        place = self._file.chunk(offset)
        if place is None:
            return None
        chunk, start, inner_end = place
        self._chunked = self._index_lost = True
        # One of the two lengths may be damaged; the checksum shows which is right.
        for candidate in {end: None, inner_end: None}:
            data = self._file.chunk_data(chunk, start, candidate)
            if data is not None:
                self._index_lost = False
                if not (yield from _found(data, chunk.uncompressed_crc != 0)):
                    yield Damage(offset, candidate - offset, "is a chunk with what is no record")
                return candidate
        if end != inner_end:
            return None
        if end > self._file.size:
            yield from self._cut_off(chunk, offset, start)
            return self._file.size
        if not self._file.continues(end):
            return None
        large = max(end - offset, chunk.uncompressed_size) > CONTENT_LIMIT
        reason = f"of more than {CONTENT_LIMIT} bytes" if large else "whose checksum is wrong"
        yield Damage(offset, end - offset, f"is a chunk {reason}")
        return end

    def _cut_off(self, chunk: Chunk, offset: int, start: int) -> Iterator[Item]:
        """Yield the readable beginning of a chunk that reaches beyond the end of the file."""

        def saved(end: int) -> Iterator[Found]:
            data = self._file.content(start, min(end - start, CONTENT_LIMIT))
            most = min(chunk.uncompressed_size, CONTENT_LIMIT)
            with suppress(*UNREADABLE):
                yield from _found(inflated(chunk.compression, data, most), False)

        found = count = 0
        for item in saved(self._file.size):
            found += 1
            count += isinstance(item.record, Message)
            yield item
        if found:  # what is saved ends where a shorter file would have less
            places = range(start, self._file.size)
            offset = start + bisect_left(places, found, key=lambda end: sum(1 for _ in saved(end)))
        yield Damage(
            offset,
            self._file.size - offset,
            f"is of a chunk that is cut off; {count} messages of it were saved, without a checksum",
        )

    def _next(self, start: int) -> int:
        """Return the offset of the next record that proves itself, or the end of the file."""
        for offset in range(start, self._file.size, _BLOCK):
            block = self._file.content(offset, _BLOCK + RECORD.size - 1)
            for match in _BEGINNING.finditer(block):
                if match.start() >= _BLOCK or self._effort < 0:
                    break
                if self._proves_itself(offset + match.start()):
                    return offset + match.start()
        return self._file.size

    def _proves_itself(self, offset: int) -> bool:
        head = self._file.head(offset)
        if head is None or head[1] > self._file.size:
            return False
        opcode, end = head
        self._effort -= end - offset
        if opcode == Opcode.CHUNK:
            place = self._file.chunk(offset)
            if place is None or place[2] != end or not place[0].uncompressed_crc:
                return False
            return self._file.chunk_data(*place) is not None
        if opcode == Opcode.MESSAGE and self._chunked:  # it is one of a damaged chunk
            return False
        return self._file.sound(offset) is not None


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
