"""Finder of records in a damaged MCAP file.

Records follow each other by their lengths. After damage the next record must be searched. A chunk
proves itself by its checksum; any other record by the lengths inside it and by the next record.
"""

from __future__ import annotations

import re
import struct
from dataclasses import replace
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Chunk

from rpud_sim.bag.errors import DAMAGED, BagFormatError
from rpud_sim.bag.records import (
    CONTENT_LIMIT,
    MESSAGE,
    RECORD,
    Record,
    fills,
    limit,
    message_index_times,
    read_record,
    uncompressed,
)

_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, size, checksum, length of the compression
_LENGTH = struct.Struct("<Q")
_BLOCK = 1 << 20
# A record that is worth finding: its kind, and a length below 4 GiB.
_BEGINNING = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{4}\x00{4})", re.DOTALL)
_ANY_LENGTH = (Opcode.CHUNK, Opcode.ATTACHMENT)  # to be left out if they are too large
_PRIVATE = 0x80  # kinds from here on are for others to define

# Errors that damaged bytes raise, here and in the libraries.
UNREADABLE = (BagFormatError, *DAMAGED)


class RecordFinder:
    """Finder of records at offsets [bytes] of ``stream``, a file of ``size`` bytes."""

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream = stream
        self._size = size
        self._effort = 4 * size + 2**30  # bytes that the search for chunks may read

    def content(self, offset: int, length: int) -> bytes:
        """Return the bytes from ``offset`` on, fewer at the end of the file."""
        self._stream.seek(offset)
        return self._stream.read(max(0, min(length, self._size - offset)))

    def head(self, offset: int) -> tuple[int, int] | None:
        """Return kind and end of the record at ``offset``; None if they make no sense."""
        head = self.content(offset, RECORD.size)
        if len(head) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(head)
        known = 0 < opcode <= max(Opcode) or opcode >= _PRIVATE
        if not known or (opcode not in _ANY_LENGTH and length > limit(opcode)):
            return None
        return opcode, offset + RECORD.size + length

    def record(self, offset: int) -> Record | None:
        """Return the record at ``offset`` if its lengths agree and another record follows."""
        try:
            record = read_record(self._stream, offset, self._size)
            if not fills(record):
                return None
            if record.opcode == Opcode.MESSAGE_INDEX:
                message_index_times(record)
        except UNREADABLE:
            return None
        if record.opcode == Opcode.MESSAGE and len(record.content) < MESSAGE.size:
            return None
        return record if self.continues(record.end) else None

    def continues(self, offset: int) -> bool:
        """Return whether a record begins at ``offset``, or the file ends in the head of one.

        A file system may fill with zeros what it had no time to write.
        """
        if self._size - offset < RECORD.size:
            return offset <= self._size
        return self.head(offset) is not None or not any(self.content(offset, RECORD.size))

    def chunk(self, offset: int) -> tuple[Chunk, int, int] | None:
        """Return the fields of the chunk at ``offset`` without its data, and start and end of that.

        The end follows from the length inside the chunk. None if there is no chunk.
        """
        head = self.content(offset + RECORD.size, _CHUNK_HEAD.size + 32 + _LENGTH.size)
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

    def chunk_data(self, chunk: Chunk, start: int, end: int) -> bytes | None:
        """Return a chunk's uncompressed data; None if it is damaged or cannot be checked."""
        if end > self._size or not 0 <= end - start <= CONTENT_LIMIT:
            return None
        try:
            data = uncompressed(replace(chunk, data=self.content(start, end - start)))
        except UNREADABLE:
            return None
        return data if chunk.uncompressed_crc or self.continues(end) else None

    def next(self, start: int, messages: bool) -> int:
        """Return the offset of the next record that proves itself, or the end of the file.

        ``messages`` says whether messages count: in a file with chunks, they are those of a damaged
        chunk.
        """
        for offset in range(start, self._size, _BLOCK):
            block = self.content(offset, _BLOCK + RECORD.size - 1)
            for match in _BEGINNING.finditer(block):
                if match.start() >= _BLOCK or self._effort < 0:
                    break
                if self._proves_itself(offset + match.start(), messages):
                    return offset + match.start()
        return self._size

    def _proves_itself(self, offset: int, messages: bool) -> bool:
        head = self.head(offset)
        if head is None or head[1] > self._size:
            return False
        opcode, end = head
        self._effort -= end - offset
        if opcode == Opcode.CHUNK:
            place = self.chunk(offset)
            if place is None or place[2] != end or not place[0].uncompressed_crc:
                return False
            return self.chunk_data(place[0], place[1], end) is not None
        if opcode == Opcode.MESSAGE and not messages:
            return False
        return self.record(offset) is not None
