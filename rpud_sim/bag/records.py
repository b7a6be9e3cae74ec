"""MCAP records from untrusted bytes: every length is checked before it is used.

The ``mcap`` library parses each record from exactly its own bytes. By itself it reads as much as a
length field says, and a few bytes of zstd may then take all memory.

Records follow each other by their lengths. After damage the next record must be searched. A chunk
proves itself by its checksum; any other record by the lengths inside it and by the next record.
"""

from __future__ import annotations

import re
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO

import lz4.frame
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from rpud_sim.bag.errors import DAMAGED, BagError, BagFormatError, BagNotFoundError

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content
_CHUNK_INDEX = struct.Struct("<QQQQI")  # times, offset, length, length of the message indexes
_CHUNK_HEAD = struct.Struct("<QQQII")  # start, end, size, checksum, length of the compression
_LENGTH = struct.Struct("<Q")
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
CONTENT_LIMIT = 128 * 2**20  # greatest record, and greatest uncompressed chunk [bytes]

# Greatest record without messages, their index, or an attachment [bytes].
DECLARATION_LIMIT = 16 * 2**20

_LARGE = {Opcode.ATTACHMENT, Opcode.CHUNK, Opcode.MESSAGE, Opcode.MESSAGE_INDEX}
_KINDS: dict[int, Any] = {
    Opcode.ATTACHMENT: Attachment,
    Opcode.CHANNEL: Channel,
    Opcode.CHUNK: Chunk,
    Opcode.CHUNK_INDEX: ChunkIndex,
    Opcode.FOOTER: Footer,
    Opcode.METADATA: Metadata,
    Opcode.METADATA_INDEX: MetadataIndex,
    Opcode.SCHEMA: Schema,
    Opcode.STATISTICS: Statistics,
}

_BLOCK = 1 << 20
# A record that is worth finding: its kind, and a length below 4 GiB.
_BEGINNING = re.compile(rb"[\x03-\x07\x09\x0c\x0f](?=.{4}\x00{4})", re.DOTALL)
_ANY_LENGTH = (Opcode.CHUNK, Opcode.ATTACHMENT)  # to be left out if they are too large
_PRIVATE = 0x80  # kinds from here on are for others to define

# Errors that damaged bytes raise, here and in the libraries.
UNREADABLE = (BagFormatError, *DAMAGED, McapError, zstandard.ZstdError)


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Replace errors that a missing or damaged file causes by a BagError that names the file."""
    try:
        yield
    except FileNotFoundError as error:
        raise BagNotFoundError(f"{path} does not exist") from error
    except OSError as error:
        raise BagError(f"cannot read {path}: {error.strerror or error}") from error
    except BagFormatError as error:
        text = str(error)
        raise BagFormatError(text if str(path) in text else f"{path}: {text}") from error
    except UNREADABLE as error:
        raise BagFormatError(f"{path} is damaged: {error or type(error).__name__}") from error


@dataclass(frozen=True, slots=True)
class RawRecord:
    """One record of a file: its kind, its content, and the offset of the next."""

    opcode: int
    content: bytes
    end: int


def limit(opcode: int) -> int:
    """Return the greatest length of a record of this kind [bytes]."""
    return CONTENT_LIMIT if opcode in _LARGE else DECLARATION_LIMIT


def read_record(stream: BinaryIO, offset: int, end: int) -> RawRecord:
    """Return the record at ``offset``, which ends at ``end`` or before."""
    stream.seek(offset)
    head = stream.read(RECORD.size) if offset + RECORD.size <= end else b""
    if len(head) < RECORD.size:
        raise BagFormatError("a record is not where it should be")
    opcode, length = RECORD.unpack(head)
    if length > end - offset - RECORD.size:
        raise BagFormatError(f"a record of {length} bytes reaches beyond its place")
    if length > limit(opcode):
        raise BagFormatError(
            f"a record of kind {opcode} has {length} bytes; at most {limit(opcode)} are read"
        )
    content = stream.read(length)
    if len(content) < length:
        raise BagFormatError("the file became shorter while it was read")
    return RawRecord(opcode, content, offset + RECORD.size + length)


def parse(record: RawRecord) -> McapRecord | None:
    """Return the fields of a record; None for an unused kind, a ValueError for damaged values."""
    kind = _KINDS.get(record.opcode)
    parsed: McapRecord | None = kind.read(_Content(record.content)) if kind else None
    return parsed


def parse_chunk_index(record: RawRecord) -> ChunkIndex:
    """Return the fields of a chunk's index; as ``parse`` does, and ten times as fast.

    An hour's bag has thousands of these, and is not open before all of them are read.
    """
    content = record.content
    try:
        start, end, offset, length, entries = _CHUNK_INDEX.unpack_from(content)
        place = _CHUNK_INDEX.size + entries
        offsets = dict(struct.iter_unpack("<HQ", content[_CHUNK_INDEX.size : place]))
        index_length, name_length = struct.unpack_from("<QI", content, place)
        place += 12 + name_length
        compressed, size = struct.unpack_from("<QQ", content, place)
        if len(offsets) * 10 == entries:
            name = content[place - name_length : place].decode()
            return ChunkIndex(
                chunk_length=length,
                chunk_start_offset=offset,
                compression=name,
                compressed_size=compressed,
                message_end_time=end,
                message_index_length=index_length,
                message_index_offsets=offsets,
                message_start_time=start,
                uncompressed_size=size,
            )
    except struct.error:
        pass
    parsed = parse(record)  # which names what is damaged
    assert isinstance(parsed, ChunkIndex)
    return parsed


def fills(record: RawRecord) -> bool:
    """Return whether a record is exactly as long as the lengths inside it say."""
    kind = _KINDS.get(record.opcode)
    if kind is None:
        return True
    stream = _Content(record.content)
    kind.read(stream)
    return stream.count == len(record.content)


def message_index_times(record: RawRecord) -> tuple[int, Iterator[int]]:
    """Return the channel of a message index, and the log times of its messages [ns]."""
    content = record.content
    if record.opcode == Opcode.MESSAGE_INDEX and len(content) >= 6:
        channel, length = struct.unpack_from("<HI", content)
        if length % 16 == 0 and 6 + length <= len(content):
            entries = struct.iter_unpack("<QQ", memoryview(content)[6 : 6 + length])
            return channel, (log_time for log_time, _ in entries)
    raise BagFormatError("a chunk's message index is not where it should be")


def records_in(data: bytes) -> Iterator[tuple[int, int, int]]:
    """Yield kind, and start and end of the content, of each record in a chunk's data."""
    offset = 0
    while offset < len(data):
        if offset + RECORD.size > len(data):
            raise BagFormatError("a record reaches beyond its chunk")
        opcode, length = RECORD.unpack_from(data, offset)
        start = offset + RECORD.size
        offset = start + length
        short = opcode == Opcode.MESSAGE and length < MESSAGE.size
        if offset > len(data) or opcode == 0 or short:
            raise BagFormatError("a chunk holds what is no record")
        yield opcode, start, offset


def uncompressed(chunk: Chunk) -> bytes:
    """Return a chunk's uncompressed data; zstd has a ZstdError, LZ4 a RuntimeError of its own."""
    size = chunk.uncompressed_size
    if size > CONTENT_LIMIT:
        raise BagFormatError(f"a chunk has {size} bytes; at most {CONTENT_LIMIT} are read")
    if chunk.compression == "":
        data = chunk.data
    elif chunk.compression == "zstd":
        # The library prefers the size in the frame to any limit.
        if zstandard.frame_content_size(chunk.data) not in (-1, size):
            raise BagFormatError("a chunk is not as large as it says")
        data = zstandard.decompress(chunk.data, max_output_size=size) if size else b""
    elif chunk.compression == "lz4":
        data = lz4.frame.LZ4FrameDecompressor().decompress(chunk.data, max_length=size + 1)
    else:
        raise BagFormatError(f"a chunk has the unknown compression {chunk.compression[:40]!r}")
    if len(data) != size:
        raise BagFormatError("a chunk is not as large as it says")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise BagFormatError("the checksum of a chunk is wrong")
    return data


class _Content(ReadDataStream):
    """Content of a record for the library; to read beyond its end is an error."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._left = len(content)

    def read(self, length: int) -> bytes:
        if length > self._left:
            raise BagFormatError("a length inside a record reaches beyond it")
        self._left -= length
        return super().read(length)


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

    def record(self, offset: int) -> RawRecord | None:
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
