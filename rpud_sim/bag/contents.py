"""Content of an MCAP file: from its summary section, or from a walk along its records."""

from __future__ import annotations

import zlib
from collections import Counter
from contextlib import suppress
from dataclasses import dataclass, field

from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    ChunkIndex,
    Footer,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.records import (
    ENTRY,
    INDEX,
    MAGIC,
    MESSAGE,
    RECORD,
    UNREADABLE,
    RawRecord,
    RecordFile,
    parse,
    records_in,
)

# Greatest summary section [bytes]; that of an hour's recording has less than one MiB.
SUMMARY_LIMIT = 64 * 2**20

_STRETCH_SIZE = 1 << 20  # size of the messages outside of chunks that are read together [bytes]
_FOOTER_SIZE = RECORD.size + 20
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)
_REMEDY = "rpud recover makes a whole bag of it"


@dataclass
class Part:
    """Chunk, or consecutive messages outside of chunks."""

    start: int  # offsets in the file [bytes]
    end: int
    size: int  # without compression [bytes]
    first: int  # log times [ns]
    last: int
    compression: str | None  # None outside of chunks
    indexes: dict[int, int] = field(default_factory=dict)  # offsets of message indexes by channel
    counts: Counter[int] = field(default_factory=Counter)  # messages by channel, from a walk


@dataclass
class Contents:
    """What a file says that it holds."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    parts: list[Part] = field(default_factory=list)
    metadata: list[tuple[str, int]] = field(default_factory=list)  # names and offsets of records
    counts: dict[int, int] = field(default_factory=dict)  # messages by channel
    message_count: int = 0
    first: int = 0  # log times [ns]
    last: int = 0
    end: int = len(MAGIC)  # offset behind the last whole record of a walk [bytes]
    whole: bool = True  # whether there is nothing behind it but the end of a closed file

    def add(self, record: object, offset: int) -> None:
        """Add a declaration, or the place of a metadata record; the first of a number stays."""
        if isinstance(record, Schema):
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        elif isinstance(record, Metadata):
            self.metadata.append((record.name, offset))


def contents_of_closed(file: RecordFile, name: object) -> Contents:
    """Return the content of a closed file from its summary section; ``name`` is for errors.

    The format makes each part of the section optional. Topics would be missing unnoticed if a part
    were absent.
    """
    if file.content(0, len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{name} is not an MCAP file")
    ending = file.size - len(MAGIC)
    if ending < len(MAGIC) or file.content(ending, len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{name} is cut off: it was not closed, or lost its end; {_REMEDY}")
    end = ending - _FOOTER_SIZE
    footer = parse(file.record(end, ending))
    if not isinstance(footer, Footer) or not 0 < footer.summary_start <= end:
        raise BagFormatError(f"it has no summary section; {_REMEDY}")
    offset = start = footer.summary_start
    if end - start > SUMMARY_LIMIT:
        raise BagFormatError(f"its summary section has more than {SUMMARY_LIMIT} bytes")
    # The checksum covers everything before itself; it is the footer's last field.
    if footer.summary_crc not in (0, zlib.crc32(file.content(start, ending - 4 - start))):
        raise BagFormatError("the checksum of its summary section is wrong")
    found = Contents()
    statistics = None
    while offset < end:
        raw = file.record(offset, end)
        offset, record = raw.end, parse(raw)
        found.add(record, offset)
        if isinstance(record, Statistics):
            statistics = record
        elif isinstance(record, MetadataIndex):
            found.metadata.append((record.name, record.offset))
        elif isinstance(record, ChunkIndex):
            place = record.chunk_start_offset
            part = Part(
                start=place,
                end=place + record.chunk_length,
                size=record.uncompressed_size,
                first=record.message_start_time,
                last=record.message_end_time,
                compression=record.compression,
                indexes=record.message_index_offsets,
            )
            found.parts.append(part)
    place = 0
    for part in sorted(found.parts, key=lambda part: part.start):
        if part.start < place:
            raise BagFormatError("its chunks overlap each other")
        place = part.end
    if place > start:
        raise BagFormatError("a chunk reaches beyond the file's data")
    if statistics is None:
        raise BagFormatError(f"its summary section has no statistics; {_REMEDY}")
    known, found.counts = found.channels.keys(), statistics.channel_message_counts
    if statistics.channel_count > len(known) or not found.counts.keys() <= known:
        raise BagFormatError(f"its summary section lacks channels; {_REMEDY}")
    if not {each.schema_id for each in found.channels.values()} <= {0, *found.schemas}:
        raise BagFormatError(f"its summary section lacks schemas; {_REMEDY}")
    found.message_count = statistics.message_count
    found.first, found.last = statistics.message_start_time, statistics.message_end_time
    return found


def walked_contents(file: RecordFile) -> Contents:
    """Return the content of a file without an index, up to its last whole record.

    The content of chunks is not read, unless their indexes do not say what they hold.
    """
    found = Contents()
    chunks: list[Part] = []
    while head := file.head(found.end):
        (opcode, end), offset = head, found.end
        if opcode in _ENDS or end > file.size:
            break
        content = file.content(offset + RECORD.size, MESSAGE.size)
        if opcode == Opcode.CHUNK:
            place = file.chunk(offset)
            if place is None or place[2] != end:
                break
            chunk = place[0]
            times = chunk.message_start_time, chunk.message_end_time
            chunks.append(Part(offset, end, chunk.uncompressed_size, *times, chunk.compression))
            found.parts.append(chunks[-1])
        elif opcode == Opcode.MESSAGE_INDEX and chunks and len(content) >= INDEX.size:
            channel, length = INDEX.unpack_from(content)
            chunks[-1].indexes[channel] = offset
            chunks[-1].counts[channel] += length // ENTRY.itemsize
        elif opcode == Opcode.MESSAGE and len(content) == MESSAGE.size:
            channel, _, time, _ = MESSAGE.unpack(content)
            part = found.parts[-1] if found.parts else None
            joins = part is not None and part.compression is None and part.end == offset
            if part is None or not joins or end - part.start > _STRETCH_SIZE:
                part = Part(offset, end, 0, time, time, None)
                found.parts.append(part)
            part.end, part.size = end, end - part.start
            part.first, part.last = min(part.first, time), max(part.last, time)
            part.counts[channel] += 1
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.METADATA):
            with suppress(*UNREADABLE):
                found.add(parse(file.record(offset)), offset)
        found.end = end
    found.whole = head is not None and head[0] in _ENDS
    for part in chunks:
        # Of the last one, indexes may be missing.
        known = part.indexes and part.indexes.keys() <= found.channels.keys()
        if part is chunks[-1] or not known:
            _read_chunk(file, part, found)
    filled = [part for part in found.parts if part.size]
    counts: Counter[int] = Counter()
    for part in found.parts:
        counts.update(part.counts)
    found.counts = {number: counts[number] for number in found.channels}
    found.message_count = counts.total()
    found.first = min((part.first for part in filled), default=0)
    found.last = max((part.last for part in filled), default=0)
    return found


def _read_chunk(file: RecordFile, part: Part, found: Contents) -> None:
    """Add what a chunk declares, and count its messages."""
    place = file.chunk(part.start)
    data = (file.chunk_data(*place) if place else None) or b""
    counts: Counter[int] = Counter()
    with suppress(*UNREADABLE):
        for opcode, start, end in records_in(data):
            if opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
                found.add(parse(RawRecord(opcode, data[start:end], end)), start)
            elif opcode == Opcode.MESSAGE:
                counts[MESSAGE.unpack_from(data, start)[0]] += 1
    if not counts.keys() <= part.indexes.keys():
        part.indexes.clear()
    part.counts = counts or part.counts
