"""One MCAP file: its topics, records and messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
import re
import zlib
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path
from typing import BinaryIO

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
from mcap.summary import Summary

from rpud_sim.bag.chunks import chunk_blocks, stretch_blocks
from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.messages import REPEATED_KEY, BagSegment, MessageBlock
from rpud_sim.bag.metadata import Topic, TopicSummary, load_offered_qos
from rpud_sim.bag.records import (
    MAGIC,
    RECORD,
    message_index_times,
    parse,
    parse_chunk_index,
    read_record,
    reading,
)
from rpud_sim.bag.scan import RecordWalk

# Greatest summary section [bytes]; that of an hour's recording has less than one MiB.
SUMMARY_LIMIT = 64 * 2**20

RECORDS_LIMIT = 64 * 2**20  # greatest size of all metadata records of one name together [bytes]

_REMEDY = "rpud recover makes a whole bag of it"
_FOOTER_SIZE = RECORD.size + 20
_COMMENT = re.compile(r"#.*")
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


class McapFile:
    """Open MCAP file with its summary section; ``shown`` is its name in errors.

    With ``repeats`` it includes messages that the file repeats of the previous one. With
    ``unclosed`` a file that was not closed, or lost its end, is read up to its last whole record.
    """

    def __init__(
        self,
        path: Path,
        *,
        repeats: bool = True,
        shown: Path | None = None,
        unclosed: bool = False,
    ) -> None:
        self._shown = shown or path
        self.closed = True  # whether the file was closed
        with reading(self._shown):
            self._stream: BinaryIO = path.open("rb")
        try:
            with reading(self._shown):
                self.size = os.fstat(self._stream.fileno()).st_size
                try:
                    _check_ends(self._stream, self.size, self._shown)
                    self._index = _read_summary(self._stream, self.size)
                    self.statistics = _checked_statistics(self._index)
                except BagFormatError:
                    if not unclosed or not self._walk.end > len(MAGIC):
                        raise
                    self.closed = False
                    self._index = self._walk.summary
                    self.statistics = _checked_statistics(self._index)
        except BaseException:
            self._stream.close()
            raise
        self.schemas = self._index.schemas
        self.channels = {
            number: channel
            for number, channel in self._index.channels.items()
            if repeats or REPEATED_KEY not in channel.metadata
        }

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @property
    def message_count(self) -> int:
        """Messages of the channels."""
        counts = self.statistics.channel_message_counts
        left_out = self._index.channels.keys() - self.channels.keys()
        return self.statistics.message_count - sum(counts.get(number, 0) for number in left_out)

    @property
    def start_time(self) -> int:
        """Log time of the first message [ns]."""
        return self.statistics.message_start_time

    @property
    def end_time(self) -> int:
        """Log time of the last message [ns]."""
        return self.statistics.message_end_time

    @property
    def compressions(self) -> set[str]:
        """Compressions of the chunks; an empty text for those without."""
        return {index.compression for index in self._index.chunk_indexes}

    @cached_property
    def topic_channels(self) -> dict[str, list[Channel]]:
        """Channels of each topic; each publisher may have had its own."""
        found: dict[str, list[Channel]] = {}
        for channel in self.channels.values():
            found.setdefault(channel.topic, []).append(channel)
        return found

    def records(self, name: str) -> Iterator[dict[str, str]]:
        offsets = {index.offset for index in self._index.metadata_indexes if index.name == name}
        total = 0
        with self._reading():
            for offset in sorted(offsets):
                found = read_record(self._stream, offset, self.size)
                record = parse(found)
                total += len(found.content)
                if not isinstance(record, Metadata):
                    raise BagFormatError("a metadata record is not where it should be")
                if total > RECORDS_LIMIT:
                    raise BagFormatError(f"the records {name} have more than {RECORDS_LIMIT} bytes")
                if record.name == name:
                    yield record.metadata

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        with self._reading():
            channels = self.topic_channels[name]
            schema = self.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._span({channel.id for channel in channels})
            counts = self.statistics.channel_message_counts
            return TopicSummary(
                topic=Topic(
                    name=name,
                    type=schema.name,
                    type_hash=channels[0].metadata.get("topic_type_hash", ""),
                    offered_qos=_offered_qos(channels[0].metadata.get("offered_qos_profiles", "")),
                    serialization_format=channels[0].message_encoding,
                ),
                message_count=sum(counts.get(channel.id, 0) for channel in channels),
                first_time=first,
                last_time=last,
                definition=self._definitions.get(schema.id),
                kinds=frozenset(map(self._kind, channels)),
            )

    def segments(self) -> Iterator[BagSegment]:
        """Yield the parts that can be read by themselves, in the order of the file."""
        with self._reading():
            walk = None if self.closed and self._index.chunk_indexes else self._walk
        everything = frozenset(self.topic_channels)
        for chunk in (walk.summary if walk else self._index).chunk_indexes:
            held = chunk.message_index_offsets
            yield BagSegment(
                chunk.message_start_time,
                chunk.message_end_time,
                chunk.uncompressed_size,
                self._names(held) if held else everything,
                partial(self._blocks, partial(chunk_blocks, self._stream, chunk)),
            )
        for stretch in walk.stretches if walk else ():
            read = partial(stretch_blocks, self._stream, stretch.start, stretch.end)
            yield BagSegment(
                stretch.first,
                stretch.last,
                stretch.end - stretch.start,
                self._names(stretch.channels),
                partial(self._blocks, read),
            )
        if walk and self.closed and not walk.whole:
            yield BagSegment(self.end_time, self.end_time, 0, everything, self._no_blocks)

    def _names(self, numbers: Iterable[int]) -> frozenset[str]:
        channels = self.channels
        return frozenset(channels[number].topic for number in numbers if number in channels)

    def _blocks(
        self,
        read: Callable[[Mapping[int, str]], list[MessageBlock]],
        topics: Collection[str] | None,
    ) -> list[MessageBlock]:
        names = {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }
        with self._reading():
            return read(names)

    def _no_blocks(self, topics: Collection[str] | None) -> list[MessageBlock]:
        """Say why a file without chunks cannot be read to its end."""
        with self._reading():
            read_record(self._stream, self._walk.end, self.size - len(MAGIC))
            raise BagFormatError("its messages do not end as they should")

    @contextmanager
    def _reading(self) -> Iterator[None]:
        if self._stream.closed:
            raise BagError(f"{self._shown} was closed; open the bag again")
        with reading(self._shown):
            yield

    @cached_property
    def _walk(self) -> RecordWalk:
        return RecordWalk(self._stream, self.size)

    @cached_property
    def _definitions(self) -> dict[int, str]:
        texts = {}
        for number, schema in self.schemas.items():
            if schema.encoding == "ros2msg":
                with suppress(UnicodeDecodeError):
                    texts[number] = schema.data.decode()
        return texts

    def _kind(self, channel: Channel) -> tuple[str, str, str]:
        schema = self.schemas.get(channel.schema_id, _NO_SCHEMA)
        text = self._definitions.get(schema.id, "")
        return channel.message_encoding, schema.name, _without_comments(text)

    @cached_property
    def _chunks_of(self) -> dict[int, list[ChunkIndex]]:
        found: dict[int, list[ChunkIndex]] = {}
        for index in self._index.chunk_indexes:
            for channel in index.message_index_offsets:
                found.setdefault(channel, []).append(index)
        return found

    def _span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Return the first and last log time of channels [ns]; None without messages.

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
            _, times = message_index_times(read_record(self._stream, offsets[channel], self.size))
            for time in times:
                first, last = extremes or (time, time)
                extremes = [min(time, first), max(time, last)]
        return extremes


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _without_comments(definition: str) -> str:
    return " ".join(_COMMENT.sub("", definition).split())


def _check_ends(stream: BinaryIO, size: int, name: object) -> None:
    """Check that a file begins and ends as a closed MCAP file; ``size`` is in bytes."""
    stream.seek(0)
    if stream.read(len(MAGIC)) != MAGIC:
        raise BagFormatError(f"{name} is not an MCAP file")
    stream.seek(max(0, size - len(MAGIC)))
    if size < 2 * len(MAGIC) or stream.read() != MAGIC:
        raise BagFormatError(f"{name} is cut off: it was not closed, or lost its end; {_REMEDY}")


def _read_summary(stream: BinaryIO, size: int) -> Summary:
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
    place = 0
    for index in sorted(summary.chunk_indexes, key=lambda index: index.chunk_start_offset):
        if index.chunk_start_offset < place:
            raise BagFormatError("its chunks overlap each other")
        place = index.chunk_start_offset + index.chunk_length
    if place > footer.summary_start:
        raise BagFormatError("a chunk reaches beyond the file's data")
    return summary


def _checked_statistics(summary: Summary) -> Statistics:
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
