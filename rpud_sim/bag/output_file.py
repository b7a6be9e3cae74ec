"""One MCAP file that is being written. Times are integer nanoseconds since the epoch."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Mapping
from pathlib import Path

from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Schema
from mcap.writer import CompressionType, Writer

from rpud_sim.bag.metadata import FileInformation, stored_name
from rpud_sim.bag.reserve import Reserve, ReservedFile

COMPRESSIONS = {
    "none": CompressionType.NONE,
    "lz4": CompressionType.LZ4,
    "zstd": CompressionType.ZSTD,
}
LATEST = 2**63 - 1
"""Greatest time that rosbag2 knows [ns since the epoch]."""

_MESSAGE_SIZE = 31 + 16  # bytes of a message beside its data, and of its entry in the index
_END_SIZE = 16_384  # bytes at the end of a file beside its lists, and of what names its times


class OutputFile:
    """A new file: channels, messages in chunks, records. Raises OSError where the disk fails."""

    def __init__(
        self, path: Path, compression: str, chunk_size: int, reserve: Reserve | None = None
    ) -> None:
        self._path = path
        self._stream = io.BufferedWriter(ReservedFile(path, reserve))
        self._writer = Writer(
            self._stream, chunk_size=chunk_size, compression=COMPRESSIONS[compression]
        )
        self._writer.start(profile="ros2", library="rpud_sim")
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channel_count = 0
        self._count = 0
        self._first, self._last = LATEST, 0
        self._declared_size = 0
        self._chunk_count = 0
        self._pending = 0  # bytes that are in memory at most
        self._written = 0  # bytes of the file when they were counted last
        self._unsafe = True  # whether anything may not be on the disk yet
        self.flush()

    @property
    def path(self) -> Path:
        """Where it is."""
        return self._path

    @property
    def information(self) -> FileInformation:
        """What the bag's metadata tells of it."""
        start = self._first if self._count else 0
        duration = self._last - start if self._count else 0
        return FileInformation(stored_name(self._path), start, duration, self._count)

    @property
    def size(self) -> int:
        """Bytes of the file so far, with what is in memory: at most, were it written now."""
        return self._written + self._pending

    @property
    def unwritten(self) -> int:
        """Bytes at most that are still to be written, were it closed now."""
        return self.closed_size - self._written

    @property
    def closed_size(self) -> int:
        """Bytes of the file at most, were it closed now."""
        return self.size + self._chunk_count * (128 + 10 * self._channel_count) + self.end_size

    @property
    def end_size(self) -> int:
        """Bytes at most that declarations and the end take, without the index of chunks."""
        return 2 * self._declared_size + _END_SIZE

    def add_channel(
        self, topic: str, encoding: str, schema: Schema | None, metadata: Mapping
    ) -> int:
        """Declare a channel; give its number."""
        copies = RecordBuilder()
        schema_id = 0
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(*key)
            schema_id = self._schemas[key]
            dataclasses.replace(schema, id=schema_id).write(copies)
        number = self._writer.register_channel(topic, encoding, schema_id, dict(metadata))
        Channel(
            id=number,
            schema_id=schema_id,
            topic=topic,
            message_encoding=encoding,
            metadata=dict(metadata),
        ).write(copies)
        # The library declares it in the first chunk alone, and when that is damaged, nobody
        # knows what all the others hold. Here it stands outside of the chunks as well.
        content = copies.end()
        self._stream.write(content)
        self._channel_count += 1
        self._declared_size += 2 * len(content)  # it stands in the metadata too
        self._pending += len(content)
        self._touch()
        return number

    def write(
        self, channel: int, data: bytes, log_time: int, publish_time: int, sequence: int
    ) -> None:
        """Add one message."""
        self._writer.add_message(
            channel_id=channel,
            log_time=log_time,
            data=data,
            publish_time=publish_time,
            sequence=sequence,
        )
        self._unsafe = True
        self._count += 1
        if log_time < self._first:
            self._first = log_time
        if log_time > self._last:
            self._last = log_time
        self._pending += len(data) + _MESSAGE_SIZE
        if self._stream.tell() != self._written:
            self._touch()
            self._pending = 0

    def add_attachment(self, attachment: Attachment) -> None:
        """Keep a file."""
        self._writer.add_attachment(
            attachment.create_time,
            attachment.log_time,
            attachment.name,
            attachment.media_type,
            attachment.data,
        )
        self._touch()

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Keep named text."""
        self._writer.add_metadata(name, dict(content))
        self._touch()

    def flush(self) -> None:
        """Close the chunk in progress and wait until all is on the disk."""
        if not self._unsafe:
            return
        self._writer.flush()
        os.fsync(self._stream.fileno())
        self._touch()
        self._pending = 0
        self._unsafe = False

    def finish(self) -> None:
        """Complete it with its index and statistics; it is still open."""
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._touch()

    def close(self) -> None:
        """Release it, complete or not."""
        self._stream.close()

    def _touch(self) -> None:
        self._unsafe = True
        self._chunk_count += 1
        self._written = self._stream.tell()
