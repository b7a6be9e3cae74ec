"""One MCAP file: its topics, records and messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mcap.records import Channel, ChunkIndex, Metadata, Schema

from rpud_sim.bag.errors import BagError, BagFormatError, reading
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.mcap_index import MessageTimes, check_ends, complete_statistics, read_summary
from rpud_sim.bag.messages import Message, Piece, Source, chunk_messages, unchunked_messages
from rpud_sim.bag.metadata import Topic, load_offered_qos
from rpud_sim.bag.record_walk import RecordWalk, Stretch
from rpud_sim.bag.records import MAGIC, parse, read_record
from rpud_sim.bag.topic_summary import TopicSummary

if TYPE_CHECKING:
    from rpud_sim.bag.message_block import MessageBlock

RECORDS_LIMIT = 64 * 2**20  # greatest size of all metadata records of one name together [bytes]

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
        self._path = path
        self._shown = shown or path
        self._repeats = repeats
        with reading(self._shown):
            self._stream: BinaryIO = path.open("rb")
        try:
            with reading(self._shown):
                self.size = os.fstat(self._stream.fileno()).st_size
                self.closed = True  # whether the file was closed
                try:
                    check_ends(self._stream, self.size, self._shown)
                    self._index = read_summary(self._stream, self.size)
                    self.statistics = complete_statistics(self._index)
                except BagFormatError:
                    if not unclosed or not self._walk.end > len(MAGIC):
                        raise
                    self.closed = False
                    self._index = self._walk.summary
                    self.statistics = complete_statistics(self._index)
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> McapFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @cached_property
    def channels(self) -> dict[int, Channel]:
        return {
            number: channel
            for number, channel in self._index.channels.items()
            if self._repeats or REPEATED_KEY not in channel.metadata
        }

    @property
    def schemas(self) -> dict[int, Schema]:
        return self._index.schemas

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
            schema = self._index.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._times.span({channel.id for channel in channels})
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

    def sources(self, topics: Collection[str] | None, start_time: int) -> Iterator[Source]:
        """Yield the chunks that may hold messages of ``topics`` from ``start_time`` [ns] on."""
        wanted = self._wanted(topics)
        if not self.closed:
            for piece in self.pieces():
                if piece.end_time >= start_time and piece.topics.intersection(wanted.values()):
                    yield Source(
                        piece.start_time, piece.size, partial(_from, piece, topics, start_time)
                    )
            return
        if not self._index.chunk_indexes:
            read = partial(unchunked_messages, self._path, self.size, wanted, start_time)
            yield Source(self.start_time, 0, partial(self._guarded, read))
        for index in self._index.chunk_indexes:
            channels = index.message_index_offsets.keys()
            if index.message_end_time < start_time or (channels and channels.isdisjoint(wanted)):
                continue
            yield Source(
                index.message_start_time,
                index.uncompressed_size,
                partial(
                    self._guarded, partial(chunk_messages, self._stream, index, wanted, start_time)
                ),
                partial(self._chunk_blocks, index, wanted, start_time),
            )

    def pieces(self) -> Iterator[Piece]:
        """Yield the parts that can be read by themselves, in the order of the file."""
        for index in self._index.chunk_indexes:
            yield Piece(
                index.message_start_time,
                index.message_end_time,
                index.uncompressed_size,
                self._names(index.message_index_offsets) or frozenset(self.topic_channels),
                partial(self._read_chunk, index),
                partial(self._read_chunk_blocks, index),
            )
        with self._reading():
            loose = [] if self.closed and self._index.chunk_indexes else self._walk.stretches
        for stretch in loose:
            yield Piece(
                stretch.first,
                stretch.last,
                stretch.end - stretch.start,
                self._names(stretch.channels),
                partial(self._read_stretch, stretch),
            )

    def _names(self, numbers: Iterable[int]) -> frozenset[str]:
        channels = self.channels
        return frozenset(channels[number].topic for number in numbers if number in channels)

    def _wanted(self, topics: Collection[str] | None) -> dict[int, str]:
        return {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }

    def _read_chunk(self, index: ChunkIndex, topics: Collection[str] | None) -> Iterator[Message]:
        wanted = self._wanted(topics)
        return self._guarded(partial(chunk_messages, self._stream, index, wanted, 0))

    def _chunk_blocks(
        self, index: ChunkIndex, wanted: dict[int, str], start_time: int
    ) -> list[MessageBlock]:
        from rpud_sim.bag.chunk_blocks import chunk_blocks  # NumPy, which listing does not need

        with self._reading():
            return chunk_blocks(self._stream, index, wanted, start_time)

    def _read_chunk_blocks(
        self, index: ChunkIndex, topics: Collection[str] | None
    ) -> list[MessageBlock]:
        return self._chunk_blocks(index, self._wanted(topics), 0)

    def _read_stretch(self, stretch: Stretch, topics: Collection[str] | None) -> Iterator[Message]:
        read = partial(
            unchunked_messages,
            self._path,
            self.size,
            self._wanted(topics),
            0,
            stretch.start,
            stretch.end,
        )
        found = list(self._guarded(read))
        return iter(sorted(found, key=lambda message: message.log_time))

    def _guarded(self, read: Callable[[], Iterator[Message]]) -> Iterator[Message]:
        with self._reading():
            yield from read()

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
    def _times(self) -> MessageTimes:
        return MessageTimes(self._stream, self.size, self._index.chunk_indexes)

    @cached_property
    def _definitions(self) -> dict[int, str]:
        texts = {}
        for number, schema in self._index.schemas.items():
            if schema.encoding == "ros2msg":
                with suppress(UnicodeDecodeError):
                    texts[number] = schema.data.decode()
        return texts

    def _kind(self, channel: Channel) -> tuple[str, str, str]:
        schema = self._index.schemas.get(channel.schema_id, _NO_SCHEMA)
        text = self._definitions.get(schema.id, "")
        return channel.message_encoding, schema.name, _without_comments(text)


def _from(piece: Piece, topics: Collection[str] | None, start_time: int) -> Iterator[Message]:
    return (message for message in piece.read(topics) if message.log_time >= start_time)


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _without_comments(definition: str) -> str:
    return " ".join(_COMMENT.sub("", definition).split())
