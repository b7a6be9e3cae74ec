"""MCAP file that is being written. Times are integer nanoseconds since the epoch."""

from __future__ import annotations

import dataclasses
import io
import os
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Schema

from rpud_sim.bag.mcap_writer import McapWriter
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.metadata import LATEST, FileInformation, stored_name
from rpud_sim.bag.open_chunk import COMPRESSIONS, HEAD_SIZE, in_order
from rpud_sim.bag.reserve import Reserve, ReservedFile

_MESSAGE_SIZE = HEAD_SIZE + 16  # bytes of a message without its data, and of its entry in the index
_END_SIZE = 16_384  # bytes at the end of a file without its lists, and of the index of times


class OutputFile:
    """New MCAP file: channels, messages in chunks, records.

    A chunk is closed beyond ``chunk_size`` uncompressed bytes. ``reserve`` is room for the file's
    end.
    """

    def __init__(
        self,
        path: Path,
        compression: str,
        chunk_size: int,
        reserve: Reserve | None = None,
    ) -> None:
        self.path = path
        self._stream = io.BufferedWriter(ReservedFile(path, reserve))
        self._writer = McapWriter(self._stream, chunk_size, COMPRESSIONS[compression])
        self._writer.start(profile="ros2", library="rpud_sim")
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._channel_count = 0
        self._count = 0
        self._first, self._last = LATEST, 0
        self._declared_size = 0
        self._chunk_count = 0
        self._pending = 0  # bytes in memory, at most
        self._written = 0  # bytes of the file at the last count
        self._unsafe = True  # whether something may not be on the disk yet
        self.flush()

    @property
    def information(self) -> FileInformation:
        """Entry of the file in the bag's metadata."""
        start = self._first if self._count else 0
        duration = self._last - start if self._count else 0
        return FileInformation(stored_name(self.path), start, duration, self._count)

    @property
    def unwritten(self) -> int:
        """Greatest size that is still to be written, were the file closed now [bytes]."""
        return self.closed_size - self._written

    @property
    def closed_size(self) -> int:
        """Greatest size of the file, were it closed now [bytes]."""
        size = self._written + self._pending
        return size + self._chunk_count * (128 + 10 * self._channel_count) + self.end_size

    @property
    def end_size(self) -> int:
        """Greatest size of declarations and the end, without the index of chunks [bytes]."""
        return 2 * self._declared_size + _END_SIZE

    def add_channel(
        self, topic: str, encoding: str, schema: Schema | None, metadata: Mapping
    ) -> int:
        copies = RecordBuilder()
        schema_id = 0
        if schema is not None:
            key = (schema.name, schema.encoding, schema.data)
            if key not in self._schemas:
                self._schemas[key] = self._writer.register_schema(*key)
            schema_id = self._schemas[key]
            dataclasses.replace(schema, id=schema_id).write(copies)
        number = self._writer.register_channel(topic, encoding, schema_id, metadata)
        Channel(number, topic, encoding, dict(metadata), schema_id).write(copies)
        # The writer declares it in the first chunk only. If that were damaged, all other chunks
        # would be unreadable. So the declaration is outside of the chunks as well.
        content = copies.end()
        self._stream.write(content)
        self._channel_count += 1
        self._declared_size += 2 * len(content)  # the metadata has it too
        self._pending += len(content)
        self._touch()
        return number

    def write(
        self, channel: int, data: bytes, log_time: int, publish_time: int, sequence: int
    ) -> None:
        self._writer.add_message(channel, log_time, data, publish_time, sequence)
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

    def write_blocks(self, parts: list[tuple[int, MessageBlock, np.ndarray]]) -> None:
        """Add many messages: channel, messages, and the place of each among all of them."""
        records = in_order(parts)
        if not len(records.ends):
            return
        chunks = self._writer.chunk_count
        self._writer.add_messages(records)
        self._unsafe = True
        self._count += len(records.ends)
        self._first = min(self._first, int(records.log_times.min()))
        self._last = max(self._last, int(records.log_times.max()))
        self._pending += len(records.data) + (_MESSAGE_SIZE - HEAD_SIZE) * len(records.ends)
        if self._writer.chunk_count != chunks:
            self._chunk_count += self._writer.chunk_count - chunks
            self._written = self._stream.tell()
            self._pending = self._writer.pending

    def add_attachment(self, attachment: Attachment) -> None:
        self._writer.add_attachment(attachment)
        self._touch()

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        self._writer.add_metadata(name, dict(content))
        self._touch()

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything is on the disk."""
        if not self._unsafe:
            return
        self._writer.flush()
        os.fsync(self._stream.fileno())
        self._touch()
        self._pending = 0
        self._unsafe = False

    def finish(self) -> None:
        """Write the index and the statistics; the file remains open."""
        self._writer.finish()
        self._stream.flush()
        os.fsync(self._stream.fileno())
        self._touch()

    def close(self) -> None:
        """Close the file, complete or not."""
        self._stream.close()

    def _touch(self) -> None:
        self._unsafe = True
        self._chunk_count += 1
        self._written = self._stream.tell()
