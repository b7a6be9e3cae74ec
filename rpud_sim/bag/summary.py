"""The summary section at the end of an MCAP file: its channels, and where everything is."""

from __future__ import annotations

import zlib
from typing import BinaryIO

from mcap.records import Channel, ChunkIndex, Footer, MetadataIndex, Schema, Statistics
from mcap.summary import Summary

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import MAGIC, RECORD, parse, read_record

SUMMARY_LIMIT = 64 * 2**20
"""Greatest summary section [bytes]; that of an hour's recording has less than one MiB."""

_REMEDY = "rpud recover makes a whole bag of it"
_FOOTER_SIZE = RECORD.size + 20


def read_summary(stream: BinaryIO, size: int) -> Summary:
    """Read the summary section of a file of `size` bytes that ends as it should.

    Raises BagFormatError where it is damaged or there is none.
    """
    end = size - len(MAGIC) - _FOOTER_SIZE
    footer = parse(read_record(stream, end, size - len(MAGIC)))
    if not isinstance(footer, Footer) or not 0 < footer.summary_start <= end:
        raise BagFormatError(f"it has no summary section; {_REMEDY}")
    if end - footer.summary_start > SUMMARY_LIMIT:
        raise BagFormatError(f"its summary section has more than {SUMMARY_LIMIT} bytes")
    stream.seek(footer.summary_start)
    # The checksum is that of all before itself, which is the footer's last field.
    content = stream.read(size - len(MAGIC) - 4 - footer.summary_start)
    if footer.summary_crc not in (0, zlib.crc32(content)):
        raise BagFormatError("the checksum of its summary section is wrong")
    summary = Summary()
    offset = footer.summary_start
    while offset < end:
        found = read_record(stream, offset, end)
        offset = found.end
        record = parse(found)
        if isinstance(record, Statistics):
            summary.statistics = record
        elif isinstance(record, Schema):
            summary.schemas[record.id] = record
        elif isinstance(record, Channel):
            summary.channels[record.id] = record
        elif isinstance(record, ChunkIndex):
            summary.chunk_indexes.append(record)
        elif isinstance(record, MetadataIndex):
            summary.metadata_indexes.append(record)
    place = 0
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        if index.chunk_start_offset < place:
            raise BagFormatError("its chunks overlap each other")
        place = index.chunk_start_offset + index.chunk_length
    if place > footer.summary_start:
        raise BagFormatError("a chunk reaches beyond the file's data")
    return summary


def complete_statistics(summary: Summary) -> Statistics:
    """Give the statistics of a summary section that names all that they count.

    The format leaves each part of it to the writer; without one, topics would be missing unnoticed.
    Raises BagFormatError where a part is not there.
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
