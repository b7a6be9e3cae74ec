"""MCAP file that is being written, and the room on the disk for its end.

The library's writer packs every field of every message by itself, which takes longer than to
compress them.
"""

from __future__ import annotations

import dataclasses
import errno
import io
import os
import struct
import zlib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Header,
    McapRecord,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
    SummaryOffset,
)

from rpud_sim.bag.chunks import COMPRESSIONS, OpenChunk, compressor, in_order
from rpud_sim.bag.errors import BagError
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.bag.metadata import FileInformation, stored_name
from rpud_sim.bag.records import MAGIC

RESERVE_NAME = "reserve.tmp"  # file that holds a bag's reserve until the bag is closed

_RESERVE_STEP = 1 << 22  # bytes by which it grows
_FULL = (errno.ENOSPC, errno.EDQUOT)
_ENTRY_SIZE = 16  # bytes of a message in the index
_END_SIZE = 16_384  # bytes at the end of a file without its lists, and of the index of times


class McapWriter:
    """New MCAP file: channels, messages in chunks, records.

    A chunk is in the file as soon as it has more than ``chunk_size`` uncompressed bytes. No thread
    compresses it: what threads of Python wait for each other takes more processor time, and saves
    little of the other. ``reserve`` is room for the file's end.
    """

    def __init__(
        self, path: Path, compression: str, chunk_size: int, reserve: Reserve | None = None
    ) -> None:
        self.path = path
        self._disk = ReservedFile(path, reserve)
        self._stream = io.BufferedWriter(self._disk)
        self._chunk_size = chunk_size
        self._compression = COMPRESSIONS[compression]
        self._compress = compressor(self._compression)
        self._chunk = OpenChunk()
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}  # messages of each channel in closed chunks
        self._chunk_indexes: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._declared_size = 0
        self._stream.write(MAGIC + _bytes_of(Header("ros2", "rpud_sim")))

    @property
    def failed(self) -> bool:
        """Whether a write has failed, after which the file cannot be completed."""
        return self._disk.failed

    @property
    def information(self) -> FileInformation:
        """Entry of the file in the bag's metadata, for what was flushed."""
        first, last = self._span
        name = stored_name(self.path)
        return FileInformation(name, first, last - first, sum(self._counts.values()))

    @property
    def unwritten(self) -> int:
        """Greatest size that is still to be written, were the file closed now [bytes]."""
        chunk = self._chunk.size + _ENTRY_SIZE * self._chunk.count
        parts = len(self._chunk_indexes) + len(self._attachments) + len(self._metadata) + 1
        return chunk + parts * (128 + 10 * len(self._channels)) + self.end_size

    @property
    def closed_size(self) -> int:
        """Greatest size of the file, were it closed now [bytes]."""
        return self._stream.tell() + self.unwritten

    @property
    def end_size(self) -> int:
        """Greatest size of declarations and the end, without the index of chunks [bytes]."""
        return 2 * self._declared_size + _END_SIZE

    def add_channel(
        self, topic: str, encoding: str, schema: Schema | None, metadata: Mapping[str, str]
    ) -> int:
        """Declare a channel and return its number; the number of ``schema`` does not matter."""
        content = b""
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            new = key not in self._schemas
            schema = self._schemas.setdefault(
                key, dataclasses.replace(schema, id=len(self._schemas) + 1)
            )
            content = _bytes_of(schema)
            if new:
                self._chunk.declare(content)
        number = len(self._channels) + 1
        channel = Channel(number, topic, encoding, dict(metadata), schema.id if schema else 0)
        self._channels.append(channel)
        self._chunk.declare(_bytes_of(channel))
        if self._chunk.size > self._chunk_size:
            self._close_chunk()
        # It is in one chunk only. If that were damaged, all other chunks would be unreadable. So
        # the declaration is outside of the chunks as well.
        content += _bytes_of(channel)
        self._stream.write(content)
        self._declared_size += 2 * len(content)  # the metadata has it too
        return number

    def write(
        self, channel: int, data: bytes, log_time: int, publish_time: int, sequence: int
    ) -> None:
        self._chunk.add(channel, data, log_time, publish_time, sequence)
        if self._chunk.size > self._chunk_size:
            self._close_chunk()

    def write_blocks(self, parts: list[tuple[int, MessageBlock, np.ndarray]]) -> None:
        """Add many messages: channel, messages, and the place of each among all of them.

        Chunks end where they would if the messages came one by one.
        """
        if not parts:
            return
        records = in_order(parts)
        done, count = 0, len(records.ends)
        while done < count:
            start = int(records.ends[done - 1]) if done else 0
            room = start + self._chunk_size - self._chunk.size
            end = min(count, int(np.searchsorted(records.ends, room, side="right")) + 1)
            end = max(end, done + 1)
            self._chunk.extend(records, done, end)
            done = end
            if self._chunk.size > self._chunk_size:
                self._close_chunk()

    def add_attachment(self, attachment: Attachment) -> None:
        content = _bytes_of(attachment)
        index = AttachmentIndex(
            offset=self._stream.tell(),
            length=len(content),
            create_time=attachment.create_time,
            log_time=attachment.log_time,
            data_size=len(attachment.data),
            name=attachment.name,
            media_type=attachment.media_type,
        )
        self._attachments.append(index)
        self._stream.write(content)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        record = _bytes_of(Metadata(name=name, metadata=dict(content)))
        self._metadata.append(MetadataIndex(self._stream.tell(), len(record), name))
        self._stream.write(record)

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything is on the disk."""
        self._close_chunk()
        self._stream.flush()
        self._disk.sync()

    def finish(self) -> None:
        """Write the index and the statistics; the file remains open."""
        self._close_chunk()
        self._stream.write(_bytes_of(DataEnd(0)))
        start = self._stream.tell()
        summary = RecordBuilder()
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [self._statistics()]),
            (Opcode.CHUNK_INDEX, [*self._chunk_indexes]),
            (Opcode.ATTACHMENT_INDEX, [*self._attachments]),
            (Opcode.METADATA_INDEX, [*self._metadata]),
        ]
        offsets = []
        for kind, members in groups:
            begin = summary.count
            for member in members:
                member.write(summary)
            offsets.append(SummaryOffset(kind, start + begin, summary.count - begin))
        offset_start = start + summary.count
        for offset in offsets:
            offset.write(summary)
        content = summary.end()
        # The checksum covers the section and the footer up to itself.
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(content + head))
        self._stream.write(content + _bytes_of(footer) + MAGIC)
        self.flush()

    def close(self) -> None:
        """Close the file, complete or not."""
        self._stream.close()

    def _close_chunk(self) -> None:
        if not self._chunk.count:
            return
        chunk, self._chunk = self._chunk, OpenChunk()
        content = chunk.data
        data = self._compress(content)
        crc, start = zlib.crc32(content), self._stream.tell()
        record = Chunk(self._compression, data, chunk.last, chunk.first, crc, len(content))
        self._stream.write(_bytes_of(record))
        end = place = self._stream.tell()
        offsets = {}
        for channel, index in chunk.indexes.items():
            offsets[channel] = place
            place += self._stream.write(index)
        for channel, messages in chunk.counts.items():
            self._counts[channel] = self._counts.get(channel, 0) + messages
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=chunk.first,
                message_end_time=chunk.last,
                chunk_start_offset=start,
                chunk_length=end - start,
                message_index_offsets=offsets,
                message_index_length=place - end,
                compression=self._compression,
                compressed_size=len(data),
                uncompressed_size=len(content),
            )
        )

    @property
    def _span(self) -> tuple[int, int]:
        """Log times of the first and the last message in closed chunks [ns]; 0 without any."""
        first = min((each.message_start_time for each in self._chunk_indexes), default=0)
        return first, max((each.message_end_time for each in self._chunk_indexes), default=0)

    def _statistics(self) -> Statistics:
        first, last = self._span
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunk_indexes),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


class Reserve:
    """File in ``folder`` that takes room on the disk until it is released.

    So a bag can be closed although another program fills the disk.
    """

    def __init__(self, folder: Path) -> None:
        self._path = folder / RESERVE_NAME
        self._size = 0
        self._released = False

    def hold(self, size: int) -> bool:
        """Reserve at least ``size`` bytes and return whether they are reserved."""
        if self._released:
            return False
        if size <= self._size:
            return True
        size = -(-size // _RESERVE_STEP) * _RESERVE_STEP
        disk = os.statvfs(self._path.parent)
        # A file system may fill itself before it says that it cannot hold so much.
        if size - self._size > disk.f_bavail * disk.f_frsize:
            return False
        descriptor = os.open(self._path, os.O_WRONLY | os.O_CREAT, 0o600)
        try:
            os.posix_fallocate(descriptor, 0, size)
        except OSError as error:
            if error.errno in _FULL:
                return False
            # Some file systems cannot reserve room, or not as much; then there is no reserve.
        finally:
            os.close(descriptor)
        self._size = size
        return True

    def release(self) -> bool:
        """Release the room for good and return whether there was any."""
        held, self._released = self._size > 0 and not self._released, True
        self._path.unlink(missing_ok=True)
        return held


class ReservedFile(io.FileIO):
    """New unbuffered file of a bag that uses the reserve when the disk is full."""

    def __init__(self, path: Path, reserve: Reserve | None) -> None:
        self.failed = False  # whether a write failed
        self._reserve = reserve
        self._bag = path.parent
        with writing(self._bag):
            super().__init__(path, "xb")

    def write(self, data: object, /) -> int:
        """Write some of the bytes and return their number; the reserve serves a full disk."""
        with self._writing():
            try:
                return super().write(data)  # type: ignore[arg-type]
            except OSError as error:
                if error.errno not in _FULL or self._reserve is None or not self._reserve.release():
                    raise
                return super().write(data)  # type: ignore[arg-type]

    def sync(self) -> None:
        """Wait until everything is on the disk."""
        with self._writing():
            os.fsync(self.fileno())

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with writing(self._bag):
                yield
        except BagError:
            self.failed = True
            raise


@contextmanager
def writing(bag: Path) -> Iterator[None]:
    """Replace errors of the disk by a BagError that names the bag."""
    try:
        yield
    except OSError as error:
        raise BagError(f"cannot write the bag {bag}: {error.strerror}") from error
