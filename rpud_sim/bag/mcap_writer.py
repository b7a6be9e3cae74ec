"""Writer of an MCAP file with chunks, for single messages and for many at once.

The library's writer packs every field of every message by itself, which takes longer than to
compress them.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Mapping
from typing import BinaryIO

import numpy as np
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
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

from rpud_sim.bag.open_chunk import Compressor, OpenChunk, Records
from rpud_sim.bag.records import MAGIC


class McapWriter:
    """Writer of a new MCAP file; options as of ``OutputFile``, but compressions by MCAP's names.

    A chunk is in the stream as soon as it is full. No thread compresses it: what threads of Python
    wait for each other takes more processor time, and saves little of the other.
    """

    def __init__(self, stream: BinaryIO, chunk_size: int, compression: str) -> None:
        self._stream = stream
        self._chunk_size = chunk_size
        self._compressor = Compressor(compression)
        self._chunk = OpenChunk()
        self._schemas: list[Schema] = []
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}
        self._first = self._last = 0
        self._chunk_indexes: list[ChunkIndex] = []
        self._attachments: list[AttachmentIndex] = []
        self._metadata: list[MetadataIndex] = []
        self.chunk_count = 0  # chunks that were closed so far

    @property
    def pending(self) -> int:
        """Greatest size of the chunk in progress and its indexes [bytes]."""
        return self._chunk.size + 16 * self._chunk.count

    def start(self, profile: str, library: str) -> None:
        self._stream.write(MAGIC + _bytes_of(Header(profile, library)))

    def register_schema(self, name: str, encoding: str, data: bytes) -> int:
        schema = Schema(id=len(self._schemas) + 1, data=data, encoding=encoding, name=name)
        self._schemas.append(schema)
        self._declare(schema)
        return schema.id

    def register_channel(
        self, topic: str, encoding: str, schema_id: int, metadata: Mapping[str, str]
    ) -> int:
        number = len(self._channels) + 1
        channel = Channel(number, topic, encoding, dict(metadata), schema_id)
        self._channels.append(channel)
        self._declare(channel)
        self._close_full_chunk()
        return number

    def add_message(
        self, channel: int, log_time: int, data: bytes, publish_time: int, number: int
    ) -> None:
        self._count(channel, 1, log_time, log_time)
        self._chunk.add(channel, log_time, data, publish_time, number)
        self._close_full_chunk()

    def add_messages(self, records: Records) -> None:
        """Add many messages; chunks end where they would if they came one by one."""
        count = len(records.ends)
        if not count:
            return
        first, last = int(records.log_times.min()), int(records.log_times.max())
        numbers, firsts, counts = np.unique(records.channels, return_index=True, return_counts=True)
        for place in np.argsort(firsts).tolist():
            self._count(int(numbers[place]), int(counts[place]), first, last)
        done = 0
        while done < count:
            start = int(records.ends[done - 1]) if done else 0
            room = start + self._chunk_size - self._chunk.size
            end = min(count, int(np.searchsorted(records.ends, room, side="right")) + 1)
            end = max(end, done + 1)
            self._chunk.extend(records, done, end)
            done = end
            self._close_full_chunk()

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

    def add_metadata(self, name: str, content: dict[str, str]) -> None:
        record = _bytes_of(Metadata(name=name, metadata=content))
        self._metadata.append(MetadataIndex(self._stream.tell(), len(record), name))
        self._stream.write(record)

    def flush(self) -> None:
        """Close the chunk in progress, and pass everything on to the file."""
        self._close_chunk()
        self._stream.flush()

    def finish(self) -> None:
        """Write what is left, and the summary section; the stream remains open."""
        self._close_chunk()
        self._stream.write(_bytes_of(DataEnd(0)))
        start = self._stream.tell()
        summary = RecordBuilder()
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas]),
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
        self._stream.write(content)
        # The checksum covers the section and the footer up to itself.
        head = struct.pack("<BQQQ", Opcode.FOOTER, 20, start, offset_start)
        footer = Footer(start, offset_start, zlib.crc32(content + head))
        self._stream.write(_bytes_of(footer) + MAGIC)

    def _declare(self, record: McapRecord) -> None:
        self._chunk.declare(_bytes_of(record))

    def _count(self, channel: int, more: int, first: int, last: int) -> None:
        self._first = min(self._first, first) if self._counts else first
        self._last = max(self._last, last)
        self._counts[channel] = self._counts.get(channel, 0) + more

    def _close_full_chunk(self) -> None:
        if self._chunk.size > self._chunk_size:
            self._close_chunk()

    def _close_chunk(self) -> None:
        if not self._chunk.count:
            return
        chunk, self._chunk = self._chunk.close(), OpenChunk()
        self.chunk_count += 1
        head, data = self._compressor.record(chunk)
        start = self._stream.tell()
        self._stream.write(head)
        self._stream.write(data)
        end = start + len(head) + len(data)
        indexes = chunk.indexes
        offsets, place = {}, end
        for channel, index in indexes.items():
            offsets[channel] = place
            place += len(index)
        self._stream.write(b"".join(indexes.values()))
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=chunk.first,
                message_end_time=chunk.last,
                chunk_start_offset=start,
                chunk_length=end - start,
                message_index_offsets=offsets,
                message_index_length=place - end,
                compression=self._compressor.name,
                compressed_size=len(data),
                uncompressed_size=len(chunk.data),
            )
        )

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=len(self._attachments),
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=self.chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=self._last,
            message_start_time=self._first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()
