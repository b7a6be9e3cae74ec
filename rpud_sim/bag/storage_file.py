"""One MCAP file: its summary, its topics and its messages. Times are integer nanoseconds."""

from __future__ import annotations

import struct
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.exceptions import McapError
from mcap.reader import NonSeekingReader, SeekingReader
from mcap.records import Channel, ChunkIndex, MessageIndex, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from rpud_sim.bag.errors import BagError, BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import Losses
from rpud_sim.bag.messages import Message, Source, chunk_messages
from rpud_sim.bag.metadata import Topic, load_offered_qos

_NO_SCHEMA = Schema(id=0, data=b"", encoding="", name="")
_MAGIC = b"\x89MCAP0\r\n"


@dataclass(frozen=True)
class TopicSummary:
    """What a bag holds of one topic.

    `first_time` and `last_time` are log times [ns], None where there is no message;
    `definition` is the `ros2msg` text of its type; `losses` is None where nobody counted them.
    """

    topic: Topic
    message_count: int
    first_time: int | None
    last_time: int | None
    definition: str
    losses: Losses | None

    @property
    def rate(self) -> float:
        """Mean rate from the first to the last message [Hz]; 0 where there are fewer than two."""
        if self.first_time is None or self.last_time is None or self.last_time <= self.first_time:
            return 0.0
        return (self.message_count - 1) * 1e9 / (self.last_time - self.first_time)


class StorageFile:
    """One open MCAP file with its summary.

    Raises BagNotFoundError, or BagFormatError where it is damaged or incomplete.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        with clear_errors(path):
            self._stream: BinaryIO = path.open("rb")
        try:
            with clear_errors(path):
                self.size = path.stat().st_size
                self._check_ends()
                # No record is longer than the file, whatever its length field says.
                self._reader = SeekingReader(self._stream, record_size_limit=self.size)
                summary = self._reader.get_summary()
            if summary is None or summary.statistics is None:
                raise BagFormatError(f"{path} has no summary section with statistics")
            self._index: Summary = summary
            self.statistics: Statistics = summary.statistics
        except BaseException:
            self._stream.close()
            raise

    def __enter__(self) -> StorageFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stream.close()

    @property
    def channels(self) -> dict[int, Channel]:
        """The channels by their numbers."""
        return self._index.channels

    @property
    def chunk_indexes(self) -> list[ChunkIndex]:
        """Where the chunks are; empty in a file without chunks."""
        return self._index.chunk_indexes

    @cached_property
    def topic_names(self) -> set[str]:
        """The names of its topics."""
        return {channel.topic for channel in self.channels.values()}

    def records(self, name: str) -> Iterator[dict[str, str]]:
        """Yield the metadata records of that name."""
        with clear_errors(self._path):
            for record in self._reader.iter_metadata():
                if record.name == name:
                    yield record.metadata

    def topic(self, name: str) -> TopicSummary:
        """Summarize one topic of this file; publishers may have had a channel each."""
        with clear_errors(self._path):
            channels = [channel for channel in self.channels.values() if channel.topic == name]
            schema = self._index.schemas.get(channels[0].schema_id, _NO_SCHEMA)
            first, last = self._time_span({channel.id for channel in channels})
            counts = self.statistics.channel_message_counts
            return TopicSummary(
                topic=Topic(
                    name=name,
                    type=schema.name,
                    type_hash=channels[0].metadata.get("topic_type_hash", ""),
                    offered_qos=load_offered_qos(
                        channels[0].metadata.get("offered_qos_profiles", "")
                    ),
                    serialization_format=channels[0].message_encoding,
                ),
                message_count=sum(counts.get(channel.id, 0) for channel in channels),
                first_time=first,
                last_time=last,
                definition=schema.data.decode() if schema.encoding == "ros2msg" else "",
                losses=None,
            )

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
                lambda: self._guarded(self._unchunked(wanted, start_time)),
            )
        for index in self.chunk_indexes:
            offsets = index.message_index_offsets
            if index.message_end_time < start_time or (
                offsets and wanted.keys().isdisjoint(offsets)
            ):
                continue
            yield Source(index.message_start_time, partial(self._chunk, index, wanted, start_time))

    def _chunk(
        self, index: ChunkIndex, wanted: dict[int, str], start_time: int
    ) -> Iterator[Message]:
        return self._guarded(chunk_messages(self._stream, index, wanted, start_time))

    def _guarded(self, messages: Iterator[Message]) -> Iterator[Message]:
        with clear_errors(self._path):
            yield from messages

    def _unchunked(self, wanted: dict[int, str], start_time: int) -> Iterator[Message]:
        with self._path.open("rb") as stream:
            reader = NonSeekingReader(stream, record_size_limit=self.size)
            for _, _, message in reader.iter_messages(log_time_order=False, starting_at=start_time):
                if message.channel_id in wanted:
                    yield Message(
                        wanted[message.channel_id],
                        message.log_time,
                        message.publish_time,
                        message.data,
                    )

    def _time_span(self, channels: set[int]) -> tuple[int | None, int | None]:
        """Find the first and last log time of channels, in as few message indexes as it takes."""
        holding = [
            index
            for index in self.chunk_indexes
            if not channels.isdisjoint(index.message_index_offsets)
        ]
        if not holding:
            return None, None
        earliest: list[int] = []
        for index in sorted(holding, key=lambda index: index.message_start_time):
            if earliest and index.message_start_time >= min(earliest):
                break
            earliest.append(min(self._log_times(index, channels)))
        latest: list[int] = []
        for index in sorted(holding, key=lambda index: index.message_end_time, reverse=True):
            if latest and index.message_end_time <= max(latest):
                break
            latest.append(max(self._log_times(index, channels)))
        return min(earliest), max(latest)

    def _log_times(self, index: ChunkIndex, channels: set[int]) -> list[int]:
        times = []
        for channel, offset in index.message_index_offsets.items():
            if channel not in channels:
                continue
            self._stream.seek(offset)
            reader = StreamReader(self._stream, skip_magic=True, record_size_limit=self.size)
            record = next(reader.records)
            if not isinstance(record, MessageIndex):
                raise BagFormatError(
                    f"{self._path}: a chunk's message index is not where it should be"
                )
            times += [log_time for log_time, _ in record.records]
        return times

    def _check_ends(self) -> None:
        if self._stream.read(len(_MAGIC)) != _MAGIC:
            raise BagFormatError(f"{self._path} is not an MCAP file")
        self._stream.seek(max(0, self.size - len(_MAGIC)))
        if self.size < 2 * len(_MAGIC) or self._stream.read() != _MAGIC:
            raise BagFormatError(f"{self._path} is cut off: it was not closed, or lost its end")
        self._stream.seek(0)


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
