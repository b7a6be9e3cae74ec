"""MCAP records from untrusted bytes.

The ``mcap`` library parses each record from exactly its own bytes. By itself it reads as much as a
length field gives, and a few bytes of zstd may then take all memory.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path
from typing import Any, BinaryIO, NamedTuple

import lz4.frame
import numpy as np
import zstandard
from mcap import records as kinds
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk, McapRecord

from rpud_sim.bag.limits import RECORD_LIMIT
from rpud_sim.foundation.terminal import error_text
from rpud_sim.messages.encoder import items
from rpud_sim.messages.errors import DAMAGED, BagError, BagFormatError, BagNotFoundError

MAGIC = b"\x89MCAP0\r\n"
RECORD = struct.Struct("<BQ")  # opcode, length of the content
MESSAGE = struct.Struct("<HIQQ")  # channel, sequence, log time, publish time
INDEX = struct.Struct("<HI")  # channel, length of the entries [bytes]
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
ENTRY = np.dtype([("log_time", "<u8"), ("offset", "<u8")])  # entry of a message index

_ANY_LENGTH = (Opcode.CHUNK, Opcode.ATTACHMENT)  # records that are left out if they are too large
_KINDS: dict[int, Any] = {
    Opcode.CHANNEL: kinds.Channel,
    Opcode.CHUNK: Chunk,
    Opcode.CHUNK_INDEX: kinds.ChunkIndex,
    Opcode.FOOTER: kinds.Footer,
    Opcode.METADATA: kinds.Metadata,
    Opcode.METADATA_INDEX: kinds.MetadataIndex,
    Opcode.SCHEMA: kinds.Schema,
    Opcode.STATISTICS: kinds.Statistics,
}

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
        raise BagError(f"{path}: {error.strerror or error}") from error
    except BagFormatError as error:
        if str(path) in str(error):
            raise
        raise BagFormatError(f"{path}: {error}") from error
    except UNREADABLE as error:
        raise BagFormatError(f"{path} is damaged: {error_text(error)}") from error


class RawRecord(NamedTuple):
    """One record of a file: its kind, its content, and the offset of the next."""

    opcode: int
    content: bytes
    end: int


def parse(record: RawRecord) -> McapRecord | None:
    """Return the fields of a record; None for an unused kind, a ValueError for damaged values."""
    kind = _KINDS.get(record.opcode)
    if kind is None:
        return None
    parsed: McapRecord = kind.read(_Content(record.content))
    return parsed


class _Content(ReadDataStream):
    """Content of a record for the library; to read beyond its end is an error."""

    def __init__(self, content: bytes) -> None:
        super().__init__(BytesIO(content))
        self._length = len(content)

    def read(self, length: int) -> bytes:
        if length > self._length - self.count:
            raise BagFormatError("a length inside a record reaches beyond it")
        return super().read(length)


def message_index(record: RawRecord) -> tuple[int, np.ndarray]:
    """Return the channel of a message index, and its entries."""
    content = record.content
    if record.opcode == Opcode.MESSAGE_INDEX and len(content) >= INDEX.size:
        channel, length = INDEX.unpack_from(content)
        if length % ENTRY.itemsize == 0 and INDEX.size + length <= len(content):
            return channel, np.frombuffer(content, ENTRY, length // ENTRY.itemsize, INDEX.size)
    raise BagFormatError("a chunk's message index is not where it should be")


def split_records(data: bytes) -> tuple[list[RawRecord], np.ndarray, np.ndarray]:
    """Return the records of a chunk: its different declarations, and its messages.

    Of the messages these are the places, and their ``HEAD``.
    """
    unpack, head, least = RECORD.unpack_from, RECORD.size, MESSAGE.size
    offset, size, message = 0, len(data), Opcode.MESSAGE  # looked up once: chunks have thousands
    declarations = (Opcode.SCHEMA, Opcode.CHANNEL)
    declared: dict[tuple[int, bytes], RawRecord] = {}
    starts: list[int] = []
    while offset < size:
        if offset + head > size:
            raise BagFormatError("a record reaches beyond its chunk")
        opcode, length = unpack(data, offset)
        start = offset + head
        offset = start + length
        if offset > size or opcode == 0 or (length < least and opcode == message):
            raise BagFormatError("a chunk contains something that is not a record")
        if opcode == message:
            starts.append(start)
        elif opcode in declarations:
            content = data[start:offset]
            if (opcode, content) not in declared:
                declared[opcode, content] = RawRecord(opcode, content, offset)
    places = np.array(starts, np.int64) - RECORD.size
    heads = items(np.frombuffer(data, np.uint8), HEAD)[places] if starts else np.empty(0, HEAD)
    return [*declared.values()], places, heads


def uncompressed(chunk: Chunk) -> bytes:
    """Return a chunk's uncompressed data; zstd may raise a ZstdError, LZ4 a RuntimeError."""
    size, data = chunk.uncompressed_size, chunk.data
    if size > RECORD_LIMIT:
        raise BagFormatError(f"a chunk has {size} bytes; at most {RECORD_LIMIT} are read")
    if chunk.compression == "zstd":  # whose reader waits forever for the first byte
        data = zstandard.ZstdDecompressor().stream_reader(data).read(size + 1) if data else b""
    elif chunk.compression == "lz4":
        data = bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    elif chunk.compression:
        raise BagFormatError(f"a chunk has the unknown compression {chunk.compression[:40]!r}")
    if len(data) != size:
        raise BagFormatError("a chunk has another size than it gives")
    if chunk.uncompressed_crc not in (0, zlib.crc32(data)):
        raise BagFormatError("the checksum of a chunk is wrong")
    return data


class RecordFile:
    """Records at offsets [bytes] of an open file, which several threads may read."""

    def __init__(self, stream: BinaryIO) -> None:
        self._stream = stream
        self.size = os.fstat(stream.fileno()).st_size  # [bytes]

    def content(self, offset: int, length: int) -> bytes:
        """Return the bytes from ``offset`` on, fewer at the end of the file."""
        length = min(length, self.size - offset)
        return os.pread(self._stream.fileno(), length, offset) if length > 0 else b""

    def record(self, offset: int, end: int | None = None) -> RawRecord:
        """Return the record at ``offset``, which ends at ``end`` or before."""
        room = (self.size if end is None else end) - offset - RECORD.size
        head = self.content(offset, RECORD.size) if room >= 0 else b""
        if len(head) < RECORD.size:
            raise BagFormatError("a record is not where it should be")
        opcode, length = RECORD.unpack(head)
        if length > room:
            raise BagFormatError(f"a record of {length} bytes reaches beyond its place")
        if length > RECORD_LIMIT:
            raise BagFormatError(f"a record has {length} bytes; at most {RECORD_LIMIT} are read")
        content = self.content(offset + RECORD.size, length)
        if len(content) < length:
            raise BagFormatError("the file became shorter while it was read")
        return RawRecord(opcode, content, offset + RECORD.size + length)

    def head(self, offset: int) -> tuple[int, int] | None:
        """Return kind and end of the record at ``offset``; None if they make no sense."""
        head = self.content(offset, RECORD.size)
        if len(head) < RECORD.size:
            return None
        opcode, length = RECORD.unpack(head)
        # A later version of the format, and others, may add kinds.
        if not opcode or (opcode not in _ANY_LENGTH and length > RECORD_LIMIT):
            return None
        return opcode, offset + RECORD.size + length

    def continues(self, offset: int) -> bool:
        """Return whether a record begins at ``offset``, or the file ends in the head of one.

        A file system may fill with zeros what it had no time to write.
        """
        if self.size - offset < RECORD.size:
            return offset <= self.size
        return self.head(offset) is not None or not any(self.content(offset, RECORD.size))
