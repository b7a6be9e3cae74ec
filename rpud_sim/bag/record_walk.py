"""Index of an MCAP file that lacks one: it was not closed, or its messages are not in chunks."""

from __future__ import annotations

import struct
from dataclasses import dataclass, field
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary

from rpud_sim.bag.errors import DAMAGED, BagFormatError
from rpud_sim.bag.record_finder import RecordFinder
from rpud_sim.bag.records import MAGIC, MESSAGE, RECORD, Record, parse, read_record, records_in

STRETCH_SIZE = 1 << 20  # size of the messages outside of chunks that are read together [bytes]
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, length of its entries
_ENTRY_SIZE = 16
_DECLARATIONS = (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA)
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)


@dataclass
class Stretch:
    """Consecutive records outside of chunks."""

    start: int  # offset of the first record [bytes]
    end: int  # offset behind the last one [bytes]
    first: int  # log time of the earliest message [ns]
    last: int  # log time of the latest message [ns]
    channels: set[int] = field(default_factory=set)  # of the messages


class RecordWalk:
    """Walk along the records of a file, from its beginning to the last whole one.

    The content of chunks is not read, unless their indexes do not say what they hold.
    """

    def __init__(self, stream: BinaryIO, size: int) -> None:
        self._stream, self._size = stream, size
        self._finder = RecordFinder(stream, size)
        self.summary = Summary()  # what the summary section of a closed file holds
        self.stretches: list[Stretch] = []  # messages outside of chunks
        self._counts: dict[int, int] = {}
        self._first, self._last = 2**64 - 1, 0
        self._chunk: ChunkIndex | None = None
        self.end = len(MAGIC)  # offset behind the last whole record [bytes]
        while (end := self._record(self.end)) is not None:
            self.end = end
        head = self._finder.head(self.end)
        self.whole = head is not None and head[0] in _ENDS  # whether it met the file's end
        self._complete_chunk()
        channels, total = self.summary.channels, sum(self._counts.values())
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
            return end
        if opcode == Opcode.CHUNK:
            self._complete_chunk()
            self._note_chunk(offset, end)
            return end
        if opcode == Opcode.MESSAGE:
            self._note_message(offset, end)
        elif opcode in _DECLARATIONS:
            self._declare(read_record(self._stream, offset, self._size), offset)
        return end

    def _note_chunk(self, offset: int, end: int) -> None:
        found = self._finder.chunk(offset)
        if found is None or found[2] != end:
            return
        chunk = found[0]
        self._chunk = ChunkIndex(
            chunk_length=end - offset,
            chunk_start_offset=offset,
            compression=chunk.compression,
            compressed_size=found[2] - found[1],
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
            self._counts[channel] = self._counts.get(channel, 0) + length // _ENTRY_SIZE

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
        if found is None:
            return
        chunk, start, end = found
        data = self._finder.chunk_data(chunk, start, end)
        if data is None:
            return
        try:
            for opcode, first, last in records_in(data):
                if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                    self._declare(Record(opcode, data[first:last], last), first)
                elif opcode == Opcode.MESSAGE and count:
                    channel, *_ = MESSAGE.unpack_from(data, first)
                    self._counts[channel] = self._counts.get(channel, 0) + 1
        except (BagFormatError, *DAMAGED):
            return

    def _note_message(self, offset: int, end: int) -> None:
        content = self._finder.content(offset + RECORD.size, MESSAGE.size)
        if len(content) < MESSAGE.size:
            return
        channel, _, log_time, _ = MESSAGE.unpack(content)
        self._counts[channel] = self._counts.get(channel, 0) + 1
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

    def _declare(self, record: Record, offset: int) -> None:
        try:
            parsed = parse(record)
        except (BagFormatError, *DAMAGED):
            return
        if isinstance(parsed, Schema):
            self.summary.schemas.setdefault(parsed.id, parsed)
        elif isinstance(parsed, Channel):
            self.summary.channels.setdefault(parsed.id, parsed)
        elif isinstance(parsed, Metadata):
            length = record.end - offset
            self.summary.metadata_indexes.append(MetadataIndex(offset, length, parsed.name))
