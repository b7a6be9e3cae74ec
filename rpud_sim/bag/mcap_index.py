"""Index of an MCAP file: its summary section, and the message indexes of its chunks."""

from __future__ import annotations

import zlib
from functools import cache
from typing import BinaryIO

from mcap.opcode import Opcode
from mcap.records import Channel, ChunkIndex, Footer, MetadataIndex, Schema, Statistics
from mcap.summary import Summary

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import (
    MAGIC,
    RECORD,
    message_index_times,
    parse,
    parse_chunk_index,
    read_record,
)

# Greatest summary section [bytes]; that of an hour's recording has less than one MiB.
SUMMARY_LIMIT = 64 * 2**20

_REMEDY = "rpud recover makes a whole bag of it"
_FOOTER_SIZE = RECORD.size + 20


def check_ends(stream: BinaryIO, size: int, name: object) -> None:
    """Check that a file begins and ends as a closed MCAP file; ``size`` is in bytes."""
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{name} is not an MCAP file")
    stream.seek(max(0, size - len(MAGIC)))
    if size < 2 * len(MAGIC) or stream.read() != MAGIC:
        raise BagFormatError(f"{name} is cut off: it was not closed, or lost its end; {_REMEDY}")


def read_summary(stream: BinaryIO, size: int) -> Summary:
    """Return the summary section of a file of ``size`` bytes that ends as it should."""
    end = size - len(MAGIC) - _FOOTER_SIZE
    footer = parse(read_record(stream, end, size - len(MAGIC)))
    if not isinstance(footer, Footer) or not 0 < footer.summary_start <= end:
        raise BagFormatError(f"it has no summary section; {_REMEDY}")
    if end - footer.summary_start > SUMMARY_LIMIT:
        raise BagFormatError(f"its summary section has more than {SUMMARY_LIMIT} bytes")
    stream.seek(footer.summary_start)
    # The checksum covers everything before itself; it is the footer's last field.
    content = stream.read(size - len(MAGIC) - 4 - footer.summary_start)
    if footer.summary_crc not in (0, zlib.crc32(content)):
        raise BagFormatError("the checksum of its summary section is wrong")
    summary = Summary()
    offset = footer.summary_start
    while offset < end:
        found = read_record(stream, offset, end)
        offset = found.end
        if found.opcode == Opcode.CHUNK_INDEX:
            summary.chunk_indexes.append(parse_chunk_index(found))
            continue
        record = parse(found)
        if isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, Channel):
            summary.channels[record.id] = record
        elif isinstance(record, MetadataIndex):
            summary.metadata_indexes.append(record)
    _check_chunks(summary.chunk_indexes, footer.summary_start)
    return summary


def _check_chunks(indexes: list[ChunkIndex], end: int) -> None:
    place = 0
    for index in sorted(indexes, key=lambda index: index.chunk_start_offset):
        if index.chunk_start_offset < place:
            raise BagFormatError("its chunks overlap each other")
        place = index.chunk_start_offset + index.chunk_length
    if place > end:
        raise BagFormatError("a chunk reaches beyond the file's data")


def complete_statistics(summary: Summary) -> Statistics:
    """Return the statistics of a summary section that names everything they count.

    The format makes each part of the section optional. Topics would be missing unnoticed if a part
    were absent.
    """
    statistics = summary.statistics
    if statistics is None:
        raise BagFormatError(f"its summary section has no statistics; {_REMEDY}")
    channels = summary.channels
    counted = statistics.channel_message_counts.keys()
    if statistics.channel_count > len(channels) or not counted <= channels.keys():
        raise BagFormatError(f"its summary section lacks channels; {_REMEDY}")
    if not {channel.schema_id for channel in channels.values()} <= {0, *summary.schemas}:
        raise BagFormatError(f"its summary section lacks schemas; {_REMEDY}")
    return statistics


class MessageTimes:
    """First and last log times of channels, from the message indexes of the chunks."""

    def __init__(self, stream: BinaryIO, size: int, indexes: list[ChunkIndex]) -> None:
        self._stream = stream
        self._size = size
        self._chunks_of: dict[int, list[ChunkIndex]] = {}
        for index in indexes:
            for channel in index.message_index_offsets:
                self._chunks_of.setdefault(channel, []).append(index)

    def span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Return the first and last log time of ``channels`` [ns]; None without messages.

        It reads as few message indexes as possible: files have thousands.
        """
        holding = {
            index.chunk_start_offset: index
            for channel in channels
            for index in self._chunks_of.get(channel, ())
        }
        extremes = cache(lambda place: self._extremes(holding[place], channels))
        earliest: list[int] = []
        for index in sorted(holding.values(), key=lambda index: index.message_start_time):
            if earliest and index.message_start_time >= min(earliest):
                break
            earliest += extremes(index.chunk_start_offset)[:1]
        latest: list[int] = []
        for index in sorted(holding.values(), key=lambda index: -index.message_end_time):
            if latest and index.message_end_time <= max(latest):
                break
            latest += extremes(index.chunk_start_offset)[1:]
        return min(earliest, default=None), max(latest, default=None)

    def _extremes(self, index: ChunkIndex, channels: set[int]) -> list[int]:
        """Return the first and the last log time of channels in a chunk; empty without messages."""
        extremes: list[int] = []
        offsets = index.message_index_offsets
        for channel in channels:
            if channel not in offsets:  # a set operation would visit all channels of the chunk
                continue
            _, times = message_index_times(read_record(self._stream, offsets[channel], self._size))
            for time in times:
                first, last = extremes or (time, time)
                extremes = [min(time, first), max(time, last)]
        return extremes
