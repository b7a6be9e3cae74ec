"""One MCAP file: its topics, records and messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Iterator
from contextlib import contextmanager, suppress
from functools import cached_property, lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from mcap.records import Channel, ChunkIndex, Metadata, Schema

from rpud_sim.bag.errors import BagError, BagFormatError, reading
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.mcap_index import MessageTimes, check_ends, complete_statistics, read_summary
from rpud_sim.bag.messages import Piece
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

    def pieces(self) -> Iterator[Piece]:
        """Yield the parts that can be read by themselves, in the order of the file."""
        with self._reading():
            walk = None if self.closed and self._index.chunk_indexes else self._walk
        index = walk.summary if walk else self._index
        for chunk in index.chunk_indexes:
            held = self._names(chunk.message_index_offsets)
            yield Piece(
                chunk.message_start_time,
                chunk.message_end_time,
                chunk.uncompressed_size,
                held if chunk.message_index_offsets else frozenset(self.topic_channels),
                partial(self._chunk_blocks, chunk),
            )
        if walk is None:
            return
        for stretch in walk.stretches:
            yield Piece(
                stretch.first,
                stretch.last,
                stretch.end - stretch.start,
                self._names(stretch.channels),
                partial(self._stretch_blocks, stretch),
            )
        if self.closed and not walk.whole:
            everything = frozenset(self.topic_channels)
            yield Piece(self.end_time, self.end_time, 0, everything, self._no_blocks)

    def _names(self, numbers: Iterable[int]) -> frozenset[str]:
        channels = self.channels
        return frozenset(channels[number].topic for number in numbers if number in channels)

    def _wanted(self, topics: Collection[str] | None) -> dict[int, str]:
        return {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }

    # NumPy is loaded here, because listing a bag does not need it.

    def _chunk_blocks(
        self, index: ChunkIndex, topics: Collection[str] | None
    ) -> list[MessageBlock]:
        from rpud_sim.bag.chunk_blocks import chunk_blocks

        with self._reading():
            return chunk_blocks(self._stream, index, self._wanted(topics))

    def _stretch_blocks(
        self, stretch: Stretch, topics: Collection[str] | None
    ) -> list[MessageBlock]:
        from rpud_sim.bag.chunk_blocks import stretch_blocks

        with self._reading():
            return stretch_blocks(self._stream, stretch, self._wanted(topics))

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


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _without_comments(definition: str) -> str:
    return " ".join(_COMMENT.sub("", definition).split())
