"""MCAP file that is being written, and its chunk in progress.

The library's writer packs every field of every message by itself, which takes longer than to
compress them.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import zstandard
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
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

from rpud_sim.bag.metadata import FileInformation, stored_name
from rpud_sim.bag.records import ENTRY, HEAD, INDEX, MAGIC, MESSAGE, RECORD
from rpud_sim.foundation.user_files import named_errors
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.encoder import items
from rpud_sim.messages.errors import BagError

# Names of the compressions in MCAP, by those in options.
COMPRESSIONS = {"none": "", "zstd": "zstd"}

# Bits of a drill's numbers are noise for the most part. Level 1 takes three times as long as -1,
# its bytes twice as long to read, and they are 5 % fewer.
LEVEL = -1
_ENTRY_SIZE = 16  # bytes of a message in the index
_END_SIZE = 16_384  # bytes at the end of a file without its lists, and of the index of times
# Messages of at most this size are moved all together, larger ones one by one [bytes].
_SMALL = 2048


class McapWriter:
    """New MCAP file: channels, messages in chunks, records.

    A chunk is in the file as soon as it has more than ``chunk_size`` uncompressed bytes. No thread
    compresses it: Python threads that wait for each other take more processor time, and save
    little wall time. A disk that fails is a BagError.
    """

    def __init__(self, path: Path, compression: str, chunk_size: int) -> None:
        self.path = path
        self.failed = False  # whether a write has failed, after which the file stays incomplete
        with self._writing():
            self._stream = path.open("xb")
        self._chunk_size = chunk_size
        self._compression = COMPRESSIONS[compression]
        zstd = zstandard.ZstdCompressor(level=LEVEL)  # threads must not share it
        self._compress: Callable[[bytes], bytes] = zstd.compress if self._compression else bytes
        self._chunk = OpenChunk()
        self._schemas: dict[tuple[str, str, bytes], Schema] = {}
        self._channels: list[Channel] = []
        self._counts: dict[int, int] = {}  # messages of each channel in closed chunks
        self._chunk_indexes: list[ChunkIndex] = []
        self._metadata: list[MetadataIndex] = []
        self._declared_size = 0
        self._put(MAGIC + _bytes_of(Header("ros2", "rpud_sim")))

    @property
    def information(self) -> FileInformation:
        """Entry of the file in the bag's metadata, for what was flushed."""
        first, last = self._span
        name = stored_name(self.path)
        return FileInformation(name, first, last - first, sum(self._counts.values()))

    @property
    def closed_size(self) -> int:
        """Greatest size of the file, were it closed now [bytes]."""
        chunk = self._chunk.size + _ENTRY_SIZE * self._chunk.count
        lists = len(self._chunk_indexes) + len(self._metadata) + 1
        index = lists * (128 + 10 * len(self._channels))
        return self._stream.tell() + chunk + index + self.end_size

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
            schema = self._schemas.setdefault(key, replace(schema, id=len(self._schemas) + 1))
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
        self._put(content)
        self._declared_size += 2 * len(content)  # the metadata has it too
        return number

    def add(self, channel: int, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message."""
        self._chunk.add(channel, data, log_time, publish_time)
        if self._chunk.size > self._chunk_size:
            self._close_chunk()

    def write(self, records: MessageRecords) -> None:
        """Add many messages; chunks end where they would if they came one by one."""
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

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        record = _bytes_of(Metadata(name=name, metadata=dict(content)))
        self._metadata.append(MetadataIndex(self._stream.tell(), len(record), name))
        self._put(record)

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything is on the disk."""
        self._close_chunk()
        with self._writing():
            self._stream.flush()
            os.fsync(self._stream.fileno())

    def finish(self) -> None:
        """Write the index and the statistics; the file remains open."""
        self._close_chunk()
        self._put(_bytes_of(DataEnd(0)))
        start = self._stream.tell()
        first, last = self._span
        statistics = Statistics(
            attachment_count=0,
            channel_count=len(self._channels),
            channel_message_counts=self._counts,
            chunk_count=len(self._chunk_indexes),
            message_count=sum(self._counts.values()),
            message_end_time=last,
            message_start_time=first,
            metadata_count=len(self._metadata),
            schema_count=len(self._schemas),
        )
        summary = RecordBuilder()
        groups: list[tuple[Opcode, list[McapRecord]]] = [
            (Opcode.SCHEMA, [*self._schemas.values()]),
            (Opcode.CHANNEL, [*self._channels]),
            (Opcode.STATISTICS, [statistics]),
            (Opcode.CHUNK_INDEX, [*self._chunk_indexes]),
            (Opcode.ATTACHMENT_INDEX, []),
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
        self._put(content + _bytes_of(footer) + MAGIC)
        self.flush()

    def close(self) -> None:
        """Close the file, complete or not."""
        self._stream.close()

    def _put(self, content: bytes) -> int:
        with self._writing():
            return self._stream.write(content)

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            with named_errors(self.path.parent, BagError):
                yield
        except BagError:
            self.failed = True
            raise

    def _close_chunk(self) -> None:
        if not self._chunk.count:
            return
        content, log_times, indexes = self._chunk.finish()
        self._chunk = OpenChunk()
        first, last = int(log_times.min()), int(log_times.max())
        data, start = self._compress(content), self._stream.tell()
        crc = zlib.crc32(content)
        self._put(_bytes_of(Chunk(self._compression, data, last, first, crc, len(content))))
        end = place = self._stream.tell()
        offsets = {}
        for channel, entries in indexes.items():
            offsets[channel] = place
            length = entries.nbytes
            head = RECORD.pack(Opcode.MESSAGE_INDEX, INDEX.size + length)
            place += self._put(head + INDEX.pack(channel, length) + entries.tobytes())
            self._counts[channel] = self._counts.get(channel, 0) + len(entries)
        self._chunk_indexes.append(
            ChunkIndex(
                message_start_time=first,
                message_end_time=last,
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


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return builder.end()


@dataclass(frozen=True)
class MessageRecords:
    """Message records one behind the other, as a chunk holds them."""

    data: np.ndarray  # their bytes, uint8
    ends: np.ndarray  # where each ends in ``data``, int64, shape (n,)
    channels: np.ndarray  # number of the channel of each, shape (n,)
    log_times: np.ndarray  # log time of each [ns], shape (n,)


def interleaved(batches: Sequence[tuple[int, Batch]]) -> MessageRecords:
    """Return the records of batches, each with its channel, in the order of their group.

    Messages with equal places in the group, or without a group, keep the order of the batches.
    """
    places = [
        np.full(len(batch), number) if batch.order is None else batch.order
        for number, (_, batch) in enumerate(batches)
    ]
    order = np.argsort(np.concatenate(places), kind="stable")
    sizes = np.concatenate([batch.sizes for _, batch in batches])[order] + HEAD.itemsize
    ends = np.cumsum(sizes)
    begins = np.empty_like(ends)
    begins[order] = ends - sizes
    data = np.empty(int(ends[-1]), np.uint8)
    first = 0
    for channel, batch in batches:
        _place(data, begins[first : first + len(batch)], channel, batch)
        first += len(batch)
    channels = np.concatenate([np.full(len(batch), channel) for channel, batch in batches])
    log_times = np.concatenate([batch.log_times for _, batch in batches])
    return MessageRecords(data, ends, channels[order], log_times[order])


def _place(data: np.ndarray, begins: np.ndarray, channel: int, batch: Batch) -> None:
    heads = _heads(channel, batch.sizes, batch.log_times, batch.publish_times)
    items(data, f"V{HEAD.itemsize}")[begins] = heads.view(f"V{HEAD.itemsize}")
    size = int(batch.sizes[0])
    if 0 < size <= _SMALL and (batch.sizes == size).all():
        items(data, f"V{size}")[begins + HEAD.itemsize] = items(batch.data, f"V{size}")[
            batch.starts
        ]
        return
    places = zip(begins.tolist(), batch.starts.tolist(), batch.sizes.tolist(), strict=True)
    for begin, start, length in places:
        begin += HEAD.itemsize
        data[begin : begin + length] = batch.data[start : start + length]


def _heads(channels: Any, sizes: np.ndarray, log_times: Any, publish_times: Any) -> np.ndarray:
    heads = np.zeros(len(sizes), HEAD)
    heads["opcode"] = Opcode.MESSAGE
    heads["length"] = sizes + MESSAGE.size
    heads["channel"] = channels
    heads["log_time"] = log_times
    heads["publish_time"] = publish_times
    return heads


class OpenChunk:
    """Chunk in progress."""

    def __init__(self) -> None:
        self.size = 0  # uncompressed [bytes]
        self.count = 0  # number of the messages
        self._parts: list[bytes | memoryview] = []
        # Of the messages in them: channels, log times, and places in the chunk.
        self._entries: list[tuple[np.ndarray, np.ndarray, np.ndarray]] = []
        # Messages that came one by one. They become records together: to make arrays of each takes
        # ten times as long.
        self._single: list[tuple[int, bytes, int, int]] = []

    def finish(self) -> tuple[bytes, np.ndarray, dict[int, np.ndarray]]:
        """Return content, all log times, and the entries of each channel's index."""
        self._settle()
        channels, log_times, places = map(np.concatenate, zip(*self._entries, strict=True))
        entries = np.empty(len(places), ENTRY)
        entries["log_time"], entries["offset"] = log_times, places
        found, firsts = np.unique(channels, return_index=True)
        in_order = found[np.argsort(firsts)].tolist()
        indexes = {channel: entries[channels == channel] for channel in in_order}
        return b"".join(self._parts), log_times, indexes

    def declare(self, record: bytes) -> None:
        self._settle()
        self._parts.append(record)
        self.size += len(record)

    def add(self, channel: int, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message."""
        self._single.append((channel, data, log_time, publish_time))
        self.size += HEAD.itemsize + len(data)
        self.count += 1

    def extend(self, records: MessageRecords, first: int, end: int) -> None:
        """Add the records from number ``first`` to ``end``."""
        self._settle()
        start = int(records.ends[first - 1]) if first else 0
        ends = records.ends[first:end]
        places = np.concatenate([[start], ends[:-1]]) + (self.size - start)
        self._entries.append((records.channels[first:end], records.log_times[first:end], places))
        self._parts.append(records.data[start : int(ends[-1])].data)
        self.size += int(ends[-1]) - start
        self.count += end - first

    def _settle(self) -> None:
        """Make records of the messages that were added one by one."""
        if not self._single:
            return
        channels, contents, log_times, publish_times = zip(*self._single, strict=True)
        self._single = []
        sizes = np.array([len(content) for content in contents], np.int64)
        heads = _heads(channels, sizes, log_times, publish_times).tobytes()
        parts: list[bytes] = [b""] * (2 * len(contents))
        parts[::2] = [heads[k : k + HEAD.itemsize] for k in range(0, len(heads), HEAD.itemsize)]
        parts[1::2] = contents
        data, ends = np.frombuffer(b"".join(parts), np.uint8), np.cumsum(sizes + HEAD.itemsize)
        self.size -= len(data)
        self.count -= len(contents)
        logs = np.array(log_times, np.int64)
        self.extend(MessageRecords(data, ends, np.array(channels), logs), 0, len(contents))
