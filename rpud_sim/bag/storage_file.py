"""One MCAP file: its summary, its topics and its messages. Times are integer nanoseconds."""

from __future__ import annotations

import os
import re
import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cache, cached_property, lru_cache, partial
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    Metadata,
    Schema,
    Statistics,
)

from rpud_sim.bag.errors import BagError, BagFormatError, BagNotFoundError
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.losses import Losses
from rpud_sim.bag.messages import Message, Source, chunk_messages, messages_in
from rpud_sim.bag.metadata import Topic, load_offered_qos
from rpud_sim.bag.records import (
    MAGIC,
    MESSAGE,
    message_index_times,
    parse,
    read_record,
    uncompressed,
)
from rpud_sim.bag.summary import complete_statistics, read_summary

RECORDS_LIMIT = 64 * 2**20
"""Bytes that all metadata records of one name may have together."""

RATE_MESSAGES = 10
"""Fewer messages have no rate: two that arrive together would have one of many kHz."""

_COMMENT = re.compile(r"#.*")
_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")


@dataclass(frozen=True)
class TopicSummary:
    """What a bag holds of one topic.

    `first_time` and `last_time` are log times [ns], None where there is no message or no index;
    `definition` is the `ros2msg` text of its type, None where the file lacks it; `losses` is None
    where nobody counted them. `kinds` are encoding, type and definition without comments of all its
    channels: where they are several, `topic` and `definition` are those of the first.
    """

    topic: Topic
    message_count: int
    first_time: int | None
    last_time: int | None
    definition: str | None
    losses: Losses | None
    kinds: frozenset[tuple[str, str, str]] = frozenset()

    @property
    def rate(self) -> float | None:
        """Mean rate from the first to the last message [Hz].

        None where fewer than RATE_MESSAGES would make a chance of it, or where the file has no
        index of their times.
        """
        if self.first_time is None or self.last_time is None:
            return None
        if self.message_count < RATE_MESSAGES or self.last_time <= self.first_time:
            return None
        return (self.message_count - 1) * 1e9 / (self.last_time - self.first_time)


class StorageFile:
    """One open MCAP file with its summary.

    Without `repeats` it is as if the file did not hold what it repeats of the one before.
    `shown` names it in errors, where that is not its path. Raises BagNotFoundError, or
    BagFormatError where it is damaged or incomplete.
    """

    def __init__(self, path: Path, *, repeats: bool = True, shown: Path | None = None) -> None:
        self._path = path
        self._shown = shown or path
        self._repeats = repeats
        with clear_errors(self._shown):
            self._stream: BinaryIO = path.open("rb")
        try:
            with clear_errors(self._shown):
                self.size = os.fstat(self._stream.fileno()).st_size
                self._check_ends()
                self._index = read_summary(self._stream, self.size)
                self.statistics: Statistics = complete_statistics(self._index)
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> StorageFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @cached_property
    def channels(self) -> dict[int, Channel]:
        """The channels by their numbers."""
        return {
            number: channel
            for number, channel in self._index.channels.items()
            if self._repeats or REPEATED_KEY not in channel.metadata
        }

    @property
    def message_count(self) -> int:
        """Messages of the channels."""
        counts = self.statistics.channel_message_counts
        left_out = self._index.channels.keys() - self.channels.keys()
        return self.statistics.message_count - sum(counts.get(number, 0) for number in left_out)

    @property
    def start_time(self) -> int:
        """Log time of the first message."""
        return self.statistics.message_start_time

    @property
    def end_time(self) -> int:
        """Log time of the last message."""
        return self.statistics.message_end_time

    @property
    def compressions(self) -> set[str]:
        """What its chunks are compressed with; empty texts for those that are not."""
        return {index.compression for index in self.chunk_indexes}

    @property
    def schemas(self) -> dict[int, Schema]:
        """The schemas by their numbers."""
        return self._index.schemas

    @property
    def chunk_indexes(self) -> list[ChunkIndex]:
        """Where the chunks are; empty in a file without chunks."""
        return self._index.chunk_indexes

    @cached_property
    def topic_channels(self) -> dict[str, list[Channel]]:
        """The channels of each topic; publishers may have had one each."""
        found: dict[str, list[Channel]] = {}
        for channel in self.channels.values():
            found.setdefault(channel.topic, []).append(channel)
        return found

    @cached_property
    def _chunks_of(self) -> dict[int, list[ChunkIndex]]:
        """The chunks that hold messages of each channel."""
        found: dict[int, list[ChunkIndex]] = {}
        for index in self.chunk_indexes:
            for channel in index.message_index_offsets:
                found.setdefault(channel, []).append(index)
        return found

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield the metadata records of that name."""
        offsets = {index.offset for index in self._index.metadata_indexes if index.name == name}
        total = 0
        with self._clear_errors():
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
        """Summarize one topic of this file."""
        with self._clear_errors():
            channels = self.topic_channels[name]
            schema = self._index.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._time_span({channel.id for channel in channels})
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
                definition=self._texts.get(schema.id),
                losses=None,
                kinds=frozenset(self._kind(channel) for channel in channels),
            )

    def _kind(self, channel: Channel) -> tuple[str, str, str]:
        schema = self._index.schemas.get(channel.schema_id, _NO_SCHEMA)
        text = self._texts.get(schema.id)
        return channel.message_encoding, schema.name, "" if text is None else _plain(text)

    @cached_property
    def _texts(self) -> dict[int, str]:
        """The `ros2msg` texts of the schemas that can be read, by their numbers."""
        texts = {}
        for number, schema in self._index.schemas.items():
            if schema.encoding == "ros2msg":
                with suppress(UnicodeDecodeError):
                    texts[number] = schema.data.decode()
        return texts

    def sources(self, topics: Collection[str] | None, start_time: int) -> Iterator[Source]:
        """Yield the chunks that may hold messages of `topics` from `start_time` [ns] on."""
        wanted = {
            number: channel.topic
            for number, channel in self.channels.items()
            if topics is None or channel.topic in topics
        }
        if not self.chunk_indexes:
            yield Source(
                self.statistics.message_start_time,
                0,
                lambda: self._guarded(self._unchunked(wanted, start_time)),
            )
        for index in self.chunk_indexes:
            offsets = index.message_index_offsets
            if index.message_end_time < start_time or (
                offsets and wanted.keys().isdisjoint(offsets)
            ):
                continue
            yield Source(
                index.message_start_time,
                index.uncompressed_size,
                partial(self._chunk, index, wanted, start_time),
            )

    def _chunk(
        self, index: ChunkIndex, wanted: dict[int, str], start_time: int
    ) -> Iterator[Message]:
        return self._guarded(chunk_messages(self._stream, index, wanted, start_time))

    def _guarded(self, messages: Iterator[Message]) -> Iterator[Message]:
        with self._clear_errors():
            yield from messages

    @contextmanager
    def _clear_errors(self) -> Iterator[None]:
        if self._stream.closed:
            raise BagError(f"{self._shown} was closed; open the bag again")
        with clear_errors(self._shown):
            yield

    def _unchunked(self, wanted: dict[int, str], start_time: int) -> Iterator[Message]:
        offset = len(MAGIC)
        with self._path.open("rb") as stream:
            while True:
                record = read_record(stream, offset, self.size - len(MAGIC))
                offset = record.end
                if record.opcode == Opcode.DATA_END:
                    return
                if record.opcode == Opcode.CHUNK:
                    chunk = parse(record)
                    assert isinstance(chunk, Chunk)
                    yield from messages_in(uncompressed(chunk), wanted, start_time)
                if record.opcode == Opcode.MESSAGE:
                    channel, _, log_time, publish_time = MESSAGE.unpack_from(record.content)
                    if channel in wanted and log_time >= start_time:
                        data = record.content[MESSAGE.size :]
                        yield Message(wanted[channel], log_time, publish_time, data)

    def _time_span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Find the first and last log time of channels, in as few message indexes as it takes."""
        holding = {
            index.chunk_start_offset: index
            for channel in channels
            for index in self._chunks_of.get(channel, ())
        }
        if not holding:
            return None, None
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
        """Find the first and the last log time of channels in a chunk; none where it has none."""
        extremes: list[int] = []
        offsets = index.message_index_offsets
        for channel in channels:
            if channel in offsets:
                _, times = message_index_times(
                    read_record(self._stream, offsets[channel], self.size)
                )
                for time in times:
                    first, last = extremes or (time, time)
                    extremes = [min(time, first), max(time, last)]
        return extremes

    def _check_ends(self) -> None:
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise BagFormatError(f"{self._shown} is not an MCAP file")
        self._stream.seek(max(0, self.size - len(MAGIC)))
        if self.size < 2 * len(MAGIC) or self._stream.read() != MAGIC:
            raise BagFormatError(
                f"{self._shown} is cut off: it was not closed, or lost its end; "
                "rpud recover makes a whole bag of it"
            )
        self._stream.seek(0)


# Thousands of channels share a few texts.
_offered_qos = lru_cache(maxsize=1024)(load_offered_qos)


@lru_cache(maxsize=1024)
def _plain(definition: str) -> str:
    """Give a definition without what does not change its meaning."""
    return " ".join(_COMMENT.sub("", definition).split())


@contextmanager
def clear_errors(path: Path) -> Iterator[None]:
    """Turn whatever damaged bytes provoke in the libraries into one clear error."""
    try:
        yield
    except FileNotFoundError as error:
        raise BagNotFoundError(f"{path} does not exist") from error
    except OSError as error:
        raise BagError(f"cannot read {path}: {error.strerror or error}") from error
    except BagFormatError as error:
        text = str(error)
        raise BagFormatError(text if str(path) in text else f"{path}: {text}") from error
    except (
        McapError,
        struct.error,
        zstandard.ZstdError,
        EOFError,
        LookupError,
        MemoryError,
        OverflowError,
        RuntimeError,
        StopIteration,
        TypeError,
        ValueError,
    ) as error:
        raise BagFormatError(f"{path} is damaged: {error or type(error).__name__}") from error
