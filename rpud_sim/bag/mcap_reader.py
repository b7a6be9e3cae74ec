"""One MCAP file: its topics, records and chunks. Times are integer nanoseconds."""

from __future__ import annotations

import re
import zlib
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
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

from rpud_sim.bag.batches import LATEST, SerializedBatch
from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.metadata import OFFERED_QOS_KEY, Topic, TopicSummary, load_offered_qos
from rpud_sim.bag.records import (
    HEAD,
    MAGIC,
    MESSAGE,
    RECORD,
    RecordFile,
    message_heads,
    message_index,
    parse,
    reading,
    uncompressed,
)

# Channel metadata of messages that split files of earlier releases repeated of the previous one.
REPEATED_KEY = "rpud_repeated"

# Greatest summary section [bytes]; that of an hour's recording has less than one MiB.
SUMMARY_LIMIT = 64 * 2**20

_LOOSE_SIZE = 1 << 20  # size of the messages outside of chunks that are read together [bytes]
_FOOTER_SIZE = RECORD.size + 20
_ENDS = (Opcode.DATA_END, Opcode.FOOTER)
_REMEDY = "rpud recover makes a whole bag of it"
_COMMENT = re.compile(r"#.*")
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


@dataclass(eq=False)
class BagChunk:
    """Chunk of a bag, or consecutive messages outside of chunks, which can be read by itself."""

    start_time: int  # no message is earlier [ns]
    end_time: int  # no message is later [ns]
    size: int  # memory that its messages take [bytes]
    file: McapFile  # that has it
    start: int  # offsets in the file [bytes]
    end: int
    compression: str = ""
    loose: bool = False  # whether it is outside of chunks
    indexes: dict[int, int] = field(default_factory=dict)  # offsets of message indexes by channel

    @property
    def topics(self) -> frozenset[str]:
        """Names of the topics that it may hold."""
        channels = self.file.channels
        if not self.indexes:
            return frozenset(self.file.topic_channels)
        return frozenset(channels[each].topic for each in self.indexes if each in channels)

    def batches(self, topics: Collection[str] | None = None) -> list[SerializedBatch]:
        """Return the messages of topics, a batch for each in the order of log times; None for all.

        A damaged chunk is a BagFormatError.
        """
        return self.file.batches(self, topics)


class McapFile:
    """Open MCAP file that was closed by its writer."""

    def __init__(self, path: Path) -> None:
        self._path = path
        with reading(path):
            if path.exists() and not path.is_file():  # to open a FIFO may take forever
                raise BagFormatError(f"{path} is not a file")
            self._stream = path.open("rb")
        self.schemas: dict[int, Schema] = {}
        self.channels: dict[int, Channel] = {}
        self._chunks: list[BagChunk] = []
        self._metadata: list[tuple[str, int]] = []  # names and offsets of records
        try:
            with reading(path):
                self._file = RecordFile(self._stream)
                statistics = self._read_summary()
        except BaseException:
            self._stream.close()
            raise
        self.size = self._file.size  # [bytes]
        self.counts = statistics.channel_message_counts  # messages by channel
        repeated = {n for n, each in self.channels.items() if REPEATED_KEY in each.metadata}
        for number in repeated:
            del self.channels[number]
        self.message_count = statistics.message_count
        self.message_count -= sum(self.counts.get(number, 0) for number in repeated)
        self.start_time = statistics.message_start_time
        self.end_time = statistics.message_end_time
        # Compressions of the chunks; an empty text for those without.
        self.compressions = {each.compression for each in self._chunks}
        # Of each topic; each publisher may have had its own.
        self.topic_channels: dict[str, list[Channel]] = {}
        for channel in self.channels.values():
            self.topic_channels.setdefault(channel.topic, []).append(channel)

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    def _read_summary(self) -> Statistics:
        """Read the summary section, and return the statistics.

        The format makes each part of the section optional. Topics would be missing unnoticed if a
        part were absent.
        """
        file = self._file
        if file.content(0, len(MAGIC)) != MAGIC:
            raise BagFormatError(f"{self._path} is not an MCAP file")
        ending = file.size - len(MAGIC)
        if ending < len(MAGIC) or file.content(ending, len(MAGIC)) != MAGIC:
            raise BagFormatError(
                f"{self._path} is cut off: it was not closed, or lost its end; {_REMEDY}"
            )
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
        statistics = None
        while offset < end:
            raw = file.record(offset, end)
            offset, record = raw.end, parse(raw)
            if isinstance(record, Schema):
                self.schemas.setdefault(record.id, record)
            elif isinstance(record, Channel):
                self.channels.setdefault(record.id, record)
            elif isinstance(record, Statistics):
                statistics = record
            elif isinstance(record, MetadataIndex):
                self._metadata.append((record.name, record.offset))
            elif isinstance(record, ChunkIndex):
                place = record.chunk_start_offset
                chunk = BagChunk(
                    start_time=record.message_start_time,
                    end_time=record.message_end_time,
                    size=record.uncompressed_size,
                    file=self,
                    start=place,
                    end=place + record.chunk_length,
                    compression=record.compression,
                    indexes=record.message_index_offsets,
                )
                self._chunks.append(chunk)
        place = 0
        for chunk in sorted(self._chunks, key=lambda chunk: chunk.start):
            if chunk.start < place:
                raise BagFormatError("its chunks overlap each other")
            place = chunk.end
        if place > start:
            raise BagFormatError("a chunk reaches beyond the file's data")
        if statistics is None:
            raise BagFormatError(f"its summary section has no statistics; {_REMEDY}")
        known, counts = self.channels.keys(), statistics.channel_message_counts
        if statistics.channel_count > len(known) or not counts.keys() <= known:
            raise BagFormatError(f"its summary section lacks channels; {_REMEDY}")
        if not {each.schema_id for each in self.channels.values()} <= {0, *self.schemas}:
            raise BagFormatError(f"its summary section lacks schemas; {_REMEDY}")
        return statistics

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield the content of the metadata records of a name."""
        with self._reading():
            for offset in sorted({offset for one, offset in self._metadata if one == name}):
                record = parse(self._file.record(offset))
                if not isinstance(record, Metadata):
                    raise BagFormatError("a metadata record is not where it should be")
                if record.name == name:
                    yield record.metadata

    def topic(self, name: str) -> TopicSummary:
        """Return the summary of one topic."""
        with self._reading():
            channels = self.topic_channels[name]
            schema = self.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._span({channel.id for channel in channels})
            return TopicSummary(
                topic=Topic(
                    name=name,
                    type=schema.name,
                    type_hash=channels[0].metadata.get("topic_type_hash", ""),
                    offered_qos=_offered_qos(channels[0].metadata.get(OFFERED_QOS_KEY, "")),
                    serialization_format=channels[0].message_encoding,
                ),
                message_count=sum(self.counts.get(channel.id, 0) for channel in channels),
                first_time=first,
                last_time=last,
                definition=self._definitions.get(schema.id),
                kinds=frozenset(map(self._kind, channels)),
            )

    def chunks(self) -> list[BagChunk]:
        """Return the chunks in the order of the file."""
        with self._reading():
            return self._chunks or self._loose_chunks

    def batches(self, chunk: BagChunk, topics: Collection[str] | None) -> list[SerializedBatch]:
        """Return the messages of a chunk, a batch for each topic in the order of log times."""
        wanted = {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }
        with self._reading():
            if chunk.loose:
                content = self._file.content(chunk.start, chunk.end - chunk.start)
            else:
                record = parse(self._file.record(chunk.start, chunk.end))
                if not isinstance(record, Chunk) or record.uncompressed_size != chunk.size:
                    raise BagFormatError("a chunk is not what its index says")
                content = uncompressed(record)
            batches = _batches_in(content, wanted)
            if any(batch.log_times[0] < chunk.start_time for batch in batches):
                raise BagFormatError(f"a message is earlier than its chunk says; {_REMEDY}")
            return batches

    @contextmanager
    def _reading(self) -> Iterator[None]:
        if self._stream.closed:
            raise BagError(f"{self._path} was closed; open the bag again")
        with reading(self._path):
            yield

    @cached_property
    def _loose_chunks(self) -> list[BagChunk]:
        """Messages of a file without chunks, as those of the preset ``fastwrite``."""
        found: list[BagChunk] = []
        offset = len(MAGIC)
        while (head := self._file.head(offset)) and head[0] not in _ENDS:
            opcode, end = head
            content = self._file.content(offset + RECORD.size, MESSAGE.size)
            if end > self._file.size or len(content) < MESSAGE.size:
                break
            if opcode == Opcode.MESSAGE:
                _, _, time, _ = MESSAGE.unpack(content)
                last = found[-1] if found else None
                if last is None or last.end != offset or end - last.start > _LOOSE_SIZE:
                    last = BagChunk(time, time, 0, self, offset, end, loose=True)
                    found.append(last)
                last.end, last.size = end, end - last.start
                last.start_time, last.end_time = (
                    min(last.start_time, time),
                    max(last.end_time, time),
                )
            offset = end
        if head is None or head[0] not in _ENDS:
            raise BagFormatError("its messages do not end as they should")
        return found

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
    def _chunks_of(self) -> dict[int, list[BagChunk]]:
        """Chunks that have an index of a channel."""
        found: dict[int, list[BagChunk]] = {}
        for chunk in self._chunks:
            for channel in chunk.indexes:
                found.setdefault(channel, []).append(chunk)
        return found

    def _span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Return log times of the first and the last message of channels [ns]; None without any.

        Only the indexes of two chunks are read: files have thousands.
        """
        chunks = [chunk for each in channels for chunk in self._chunks_of.get(each, ())]
        if not chunks:
            return None, None
        first = self._times(min(chunks, key=lambda chunk: chunk.start_time), channels)
        last = self._times(max(chunks, key=lambda chunk: chunk.end_time), channels)
        return min(first, default=None), max(last, default=None)

    def _times(self, chunk: BagChunk, channels: set[int]) -> list[int]:
        # A set operation would visit all channels of the chunk.
        offsets = [chunk.indexes[each] for each in channels if each in chunk.indexes]
        found = [message_index(self._file.record(each))[1]["log_time"] for each in offsets]
        return [int(end) for times in found if len(times) for end in (times.min(), times.max())]


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _without_comments(definition: str) -> str:
    return " ".join(_COMMENT.sub("", definition).split())


def _batches_in(content: bytes, topics: dict[int, str]) -> list[SerializedBatch]:
    """Return the messages among records, a batch for each topic in the order of log times.

    ``topics`` has the names of the channels to read, by their numbers.
    """
    data = np.frombuffer(content, np.uint8)
    places, heads = message_heads(content)
    names: dict[str, int] = {}
    held = np.bincount(heads["channel"])
    numbers = np.full(len(held), -1)  # of the topic of each channel; -1 if it is not wanted
    for channel in np.flatnonzero(held).tolist():
        if channel in topics:
            numbers[channel] = names.setdefault(topics[channel], len(names))
    of_message = numbers[heads["channel"]]
    order = np.lexsort((heads["log_time"], of_message))
    cuts = np.searchsorted(of_message[order], np.arange(len(names) + 1))
    batches = []
    for number, name in enumerate(names):
        rows = order[cuts[number] : cuts[number + 1]]
        logs, sent = (heads[each][rows] for each in ("log_time", "publish_time"))
        if len(rows) and max(logs.max(), sent.max()) > LATEST:
            raise BagFormatError(
                f"a message of {name:.200} has a time of more than {LATEST} ns; rpud recover "
                "makes a bag without it"
            )
        sizes = heads["length"][rows].astype(np.int64) - MESSAGE.size
        times = logs.astype(np.int64), sent.astype(np.int64)
        batches.append(SerializedBatch(name, *times, data, places[rows] + HEAD.itemsize, sizes))
    return batches
