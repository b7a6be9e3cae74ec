"""Contents of a closed MCAP file: declarations, counts, and the places of its messages.

The summary section of a file is a hint, and each of its parts is optional. Where it is missing or
contradicts itself, one walk over all records gives the contents.
"""

from __future__ import annotations

import zlib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)

from rpud_sim.bag.limits import RECORD_LIMIT, TOPICS_LIMIT
from rpud_sim.bag.records import (
    HEAD,
    MAGIC,
    MESSAGE,
    RECORD,
    UNREADABLE,
    RecordFile,
    parse,
    split_records,
    uncompressed,
)
from rpud_sim.foundation.terminal import error_text
from rpud_sim.messages.errors import BagFormatError

REMEDY = "rpud recover makes a whole bag of it"

_LOOSE_SIZE = 1 << 20  # size of the messages outside of chunks that are read together [bytes]
_FOOTER_SIZE = RECORD.size + 20
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)


@dataclass
class ChunkPlace:
    """Place of a chunk in a file, or of consecutive messages outside of chunks."""

    start_time: int  # no message is earlier, by the record of the file [ns]
    end_time: int  # no message is later, by the record of the file [ns]
    size: int  # memory that its messages take [bytes]
    start: int  # offsets in the file [bytes]
    end: int
    behind: int = 0  # offset behind its message indexes; 0 outside of chunks [bytes]
    compression: str = ""
    loose: bool = False  # whether it is outside of chunks
    # Offsets of message indexes by channel, 0 where they are not needed; empty if the channels are
    # not known.
    indexes: dict[int, int] = field(default_factory=dict)


@dataclass
class Contents:
    """Declarations of a file, and the places of its messages."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)
    chunks: list[ChunkPlace] = field(default_factory=list)
    metadata: list[tuple[str, int]] = field(default_factory=list)  # names and offsets of records
    counts: Mapping[int, int] = field(default_factory=dict)  # messages by channel
    # log times of messages, the first and last ones [ns]
    times: list[int] = field(default_factory=list)
    # Log times of the first and last message by channel [ns]; None without a walk.
    spans: dict[int, tuple[int, int]] | None = None
    # Messages outside of chunks; None until they are looked for.
    loose: list[ChunkPlace] | None = None
    lacks: str = ""  # why the summary is not enough, and the whole file is read; empty if it is

    def declare(self, record: object) -> None:
        """Add a schema or a channel; the first one of a number counts."""
        if isinstance(record, Schema) and record.id:
            self.schemas.setdefault(record.id, record)
        elif isinstance(record, Channel):
            self.channels.setdefault(record.id, record)
        check_declared(self.schemas, self.channels)


def check_declared(schemas: Mapping[int, Schema], channels: Mapping[int, Channel]) -> None:
    """Raise a BagFormatError if a file declares too many topics."""
    if max(len(schemas), len(channels)) > TOPICS_LIMIT:
        raise BagFormatError(f"it declares more than {TOPICS_LIMIT} topics")


def contents_of(file: RecordFile, path: Path) -> Contents:
    """Return the contents of the file at ``path``, from its summary or else by a walk.

    A file without its end, or with damaged parts, is a BagFormatError.
    """
    if file.content(0, len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{path} is {'not an MCAP file' if file.size else 'empty'}")
    ending = file.size - len(MAGIC)
    if ending < len(MAGIC) or file.content(ending, len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{path} is cut off: it was not closed, or lost its end; {REMEDY}")
    found = summary_of(file)
    if not found.lacks:
        return found
    try:
        walked = _walked(file)
    except UNREADABLE as error:
        text = error_text(error)
        raise BagFormatError(text if REMEDY in text else f"{text}; {REMEDY}") from error
    walked.lacks = found.lacks
    return walked


def summary_of(file: RecordFile) -> Contents:
    """Return the contents of a file as its summary section has them, and what they lack.

    A damaged section is a BagFormatError.
    """
    ending = file.size - len(MAGIC)
    end = ending - _FOOTER_SIZE
    head = file.head(end) if end > 0 else None
    if head != (Opcode.FOOTER, ending):  # a footer with further fields is found by a walk
        if not _has_footer(file):
            raise BagFormatError(f"it was not closed, for it has no footer; {REMEDY}")
        return Contents(lacks="its footer is not as usual")
    footer = parse(file.record(end, ending))
    assert isinstance(footer, Footer)
    if not footer.summary_start:
        return Contents(lacks="it has no summary section")
    offset = start = footer.summary_start
    if start > end:
        raise BagFormatError(f"its summary section is not where it should be; {REMEDY}")
    if end - start > RECORD_LIMIT:
        raise BagFormatError(f"its summary section has more than {RECORD_LIMIT} bytes")
    # The checksum covers everything before itself; it is the footer's last field.
    if footer.summary_crc not in (0, zlib.crc32(file.content(start, ending - 4 - start))):
        raise BagFormatError(f"the checksum of its summary section is wrong; {REMEDY}")
    found, statistics = Contents(), None
    while offset < end:
        raw = file.record(offset, end)
        offset, record = raw.end, parse(raw)
        found.declare(record)
        if isinstance(record, Statistics):
            statistics = record
        elif isinstance(record, MetadataIndex):
            found.metadata.append((record.name, record.offset))
        elif isinstance(record, ChunkIndex):
            found.chunks.append(_place(record))
    _check_places(found.chunks, start)
    if statistics is None:
        found.lacks = "its summary section has no statistics"
        return found
    found.counts = statistics.channel_message_counts
    if what := _lacking(found, statistics):
        found.lacks = f"its summary section lacks {what}"
    if statistics.message_count:
        found.times = [statistics.message_start_time, statistics.message_end_time]
        for each in found.chunks:
            if each.indexes:  # one without messages has times of zero
                found.times += each.start_time, each.end_time
    return found


def _has_footer(file: RecordFile) -> bool:
    """Return whether the records of a file follow each other up to a footer at its end."""
    kind, offset, ending = 0, len(MAGIC), file.size - len(MAGIC)
    while offset < ending and (head := file.head(offset)):
        kind, offset = head
    return kind == Opcode.FOOTER and offset == ending


def _place(index: ChunkIndex) -> ChunkPlace:
    end = index.chunk_start_offset + max(index.chunk_length, RECORD.size)
    return ChunkPlace(
        start_time=index.message_start_time,
        end_time=index.message_end_time,
        size=index.uncompressed_size,
        start=index.chunk_start_offset,
        end=end,
        behind=end + index.message_index_length,
        compression=index.compression,
        indexes=index.message_index_offsets,
    )


def _check_places(chunks: list[ChunkPlace], end: int) -> None:
    place = 0
    for chunk in sorted(chunks, key=lambda chunk: chunk.start):
        if chunk.start < place:
            raise BagFormatError("its chunks overlap each other")
        place = chunk.end
    if place > end:
        raise BagFormatError("a chunk reaches beyond the file's data")


def _lacking(found: Contents, statistics: Statistics) -> str:
    """Return what would be missing unnoticed: statistics count what the section lists."""
    counts = found.counts
    if statistics.channel_count > len(found.channels) or not counts.keys() <= found.channels.keys():
        return "channels"
    if not {each.schema_id for each in found.channels.values()} <= {0, *found.schemas}:
        return "schemas"
    if statistics.chunk_count != len(found.chunks):
        return "chunks"
    if statistics.metadata_count != len(found.metadata):
        return "metadata records"
    return "" if statistics.message_count == sum(counts.values()) else "counts of messages"


def _records(
    file: RecordFile, skip: Mapping[int, int] | None = None
) -> Iterator[tuple[int, int, int, bytes]]:
    """Yield kind, start, end and first bytes of each record before the summary section.

    ``skip`` has offsets that are passed, and where the walk continues [bytes].
    """
    offset, ending, skip = len(MAGIC), file.size - len(MAGIC), skip or {}
    while True:
        if offset in skip:
            offset = skip[offset]
            continue
        first = file.content(offset, HEAD.itemsize)
        opcode, length = RECORD.unpack_from(first) if len(first) >= RECORD.size else (0, 0)
        end = offset + RECORD.size + length
        if not opcode or end > ending:
            raise BagFormatError(f"its records do not end as they should; {REMEDY}")
        if opcode in _ENDS:
            return
        if opcode == Opcode.MESSAGE and length < MESSAGE.size:
            raise BagFormatError(f"a message is shorter than its head; {REMEDY}")
        yield opcode, offset, end, first
        offset = end


def add_loose(loose: list[ChunkPlace], start: int, end: int, first: bytes) -> tuple[int, int]:
    """Add a message outside of chunks to the last place or a new one; return channel and time."""
    channel, _, time, _ = MESSAGE.unpack_from(first, RECORD.size)
    last = loose[-1] if loose else None
    if last is None or last.end != start or end - last.start > _LOOSE_SIZE:
        last = ChunkPlace(time, time, 0, start, end, loose=True)
        loose.append(last)
    last.end, last.size = end, end - last.start
    last.start_time, last.end_time = min(last.start_time, time), max(last.end_time, time)
    return channel, time


def loose_places(file: RecordFile, chunks: list[ChunkPlace]) -> list[ChunkPlace]:
    """Return the messages outside of chunks, and chunks without an index, of a file with a summary.

    Only what is between the chunks is walked over.
    """
    loose: list[ChunkPlace] = []
    further: list[ChunkPlace] = []
    for opcode, start, end, first in _records(file, {each.start: each.behind for each in chunks}):
        if opcode == Opcode.MESSAGE:
            add_loose(loose, start, end, first)
        elif opcode == Opcode.CHUNK:
            chunk = parse(file.record(start, end))
            assert isinstance(chunk, Chunk)
            times = chunk.message_start_time, chunk.message_end_time
            size, compression = chunk.uncompressed_size, chunk.compression
            further.append(ChunkPlace(*times, size, start, end, compression=compression))
    return [*further, *loose]


def spans_of(heads: np.ndarray) -> dict[int, tuple[int, int]]:
    """Return the first and last log time of each channel among messages [ns]."""
    order = np.lexsort((heads["log_time"], heads["channel"]))
    channels, times = heads["channel"][order], heads["log_time"][order]
    numbers, starts = np.unique(channels, return_index=True)
    ends = np.append(starts[1:], len(times))[: len(starts)] - 1
    places = zip(numbers.tolist(), times[starts].tolist(), times[ends].tolist(), strict=True)
    return {number: (first, last) for number, first, last in places}


def _walked(file: RecordFile) -> Contents:
    """Return the contents of a file from all its records; each chunk is uncompressed once."""
    found = Contents(loose=[], spans={})
    counts = Counter[int]()
    spans: dict[int, tuple[int, int]] = {}

    def add(channel: int, first: int, last: int, count: int) -> None:
        counts[channel] += count
        known = spans.get(channel, (first, last))
        spans[channel] = min(known[0], first), max(known[1], last)

    known: set[bytes] = set()  # declarations: each chunk may repeat them
    for opcode, start, end, first in _records(file):
        if opcode == Opcode.MESSAGE:
            assert found.loose is not None
            channel, time = add_loose(found.loose, start, end, first)
            add(channel, time, time, 1)
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL):
            found.declare(parse(file.record(start, end)))
        elif opcode == Opcode.METADATA:
            record = parse(file.record(start, end))
            assert isinstance(record, Metadata)
            found.metadata.append((record.name, start))
        elif opcode == Opcode.CHUNK:
            chunk = parse(file.record(start, end))
            assert isinstance(chunk, Chunk)
            declarations, _, heads = split_records(uncompressed(chunk))
            for raw in declarations:
                if raw.content not in known:
                    known.add(raw.content)
                    found.declare(parse(raw))
            numbers, amounts = np.unique(heads["channel"], return_counts=True)
            held = spans_of(heads)
            for channel, count in zip(numbers.tolist(), amounts.tolist(), strict=True):
                add(channel, *held[channel], count)
            if len(heads):
                logs = heads["log_time"]
                found.chunks.append(
                    ChunkPlace(
                        int(logs.min()),
                        int(logs.max()),
                        chunk.uncompressed_size,
                        start,
                        end,
                        compression=chunk.compression,
                        indexes=dict.fromkeys(held, 0),
                    )
                )
    if not counts.keys() <= found.channels.keys():
        raise BagFormatError("it has messages without a channel")
    if not {each.schema_id for each in found.channels.values()} <= {0, *found.schemas}:
        raise BagFormatError("it has channels without their schema")
    found.counts, found.spans = dict(counts), spans
    found.times = [time for span in spans.values() for time in span]
    return found
