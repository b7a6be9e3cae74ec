"""Write a rosbag2 bag: a directory with one MCAP file and `metadata.yaml`."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

from mcap.data_stream import RecordBuilder
from mcap.records import Attachment, Channel, Schema
from mcap.writer import CompressionType, Writer

from rpud_sim.bag.errors import BagError, BagExistsError
from rpud_sim.bag.metadata import (
    FILE_NAME,
    RECORD_KEY,
    RECORD_NAME,
    BagMetadata,
    FileInformation,
    Topic,
    dump_offered_qos,
)

COMPRESSIONS = {"none": CompressionType.NONE, "zstd": CompressionType.ZSTD}
CHUNK_SIZE = 1 << 20
"""Uncompressed bytes after which a chunk is closed."""

LATEST = 2**63 - 1
"""Greatest time that rosbag2 knows [ns since the epoch]."""

_MOST_CHANNELS = 2**16 - 1


class BagWriter:
    """Writes serialized messages to the new bag `path`/ and completes it when it is closed.

    Times are integer nanoseconds since the epoch. What is written is on the disk after `flush`;
    a bag that was never closed lacks its index and `metadata.yaml`, and `recovery.recover` makes a
    whole one of it. Not for use by several threads at once.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        compression: str = "zstd",
        chunk_size: int = CHUNK_SIZE,
        custom_data: Mapping[str, str] | None = None,
    ) -> None:
        """Create the directory and its file.

        `compression` is one of COMPRESSIONS, `chunk_size` is in bytes; `custom_data` goes to the
        bag's metadata. Raises BagExistsError where anything exists at `path`, BagError where it
        cannot be created.
        """
        if compression not in COMPRESSIONS:
            raise BagError(
                f"compression is {compression!r}; it must be one of {', '.join(COMPRESSIONS)}"
            )
        self._path = Path(os.path.abspath(path))
        self._custom_data = dict(custom_data or {})
        self._schemas: dict[tuple[str, str, bytes], int] = {}
        self._topics: dict[str, Topic] = {}
        self._named: dict[str, int] = {}  # the channel of each topic that add_topic declared
        self._channels: dict[int, str] = {}  # the topic of each channel
        self._counts: dict[str, int] = {}
        self._first, self._last = LATEST, 0
        self._failed = False
        self._unsafe = True  # whether anything may not be on the disk yet
        self._stream: BinaryIO | None = None
        self._create_directory()
        self._file = self._path / f"{self._path.name}_0.mcap"
        with self._guarded():
            self._stream = self._file.open("xb")
            self._writer = Writer(
                self._stream, chunk_size=chunk_size, compression=COMPRESSIONS[compression]
            )
            self._writer.start(profile="ros2", library="rpud_sim")
            self.flush()
            for folder in (self._path, self._path.parent):
                _sync_folder(folder)

    @property
    def path(self) -> Path:
        """The bag's directory."""
        return self._path

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return sum(self._counts.values())

    @property
    def size(self) -> int:
        """Bytes of the file on the disk so far."""
        return self._file.stat().st_size

    def add_topic(self, topic: Topic, definition: str = "") -> None:
        """Declare a topic before its first message.

        `definition` is the complete `ros2msg` text of its type; empty where it is unknown.
        Raises BagError where the topic was declared already.
        """
        if topic.name in self._topics:
            raise BagError(f"topic {topic.name} was declared twice")
        schema = Schema(
            id=0,
            name=topic.type,
            encoding="ros2msg" if definition else "",
            data=definition.encode(),
        )
        metadata = {
            "offered_qos_profiles": dump_offered_qos(topic.offered_qos),
            "topic_type_hash": topic.type_hash,
        }
        self._named[topic.name] = self.add_channel(topic, schema, metadata)

    def add_channel(self, topic: Topic, schema: Schema | None, metadata: Mapping[str, str]) -> int:
        """Declare a channel of a topic as another file has it; give its number in this one.

        A topic may have several. The number that `schema` has there does not matter. Raises
        BagError where there are too many.
        """
        if len(self._channels) == _MOST_CHANNELS:
            raise BagError(f"a bag has at most {_MOST_CHANNELS} channels")
        copies = RecordBuilder()
        with self._guarded():
            schema_id = 0
            if schema is not None:
                key = (schema.name, schema.encoding, schema.data)
                if key not in self._schemas:
                    self._schemas[key] = self._writer.register_schema(*key)
                schema_id = self._schemas[key]
                dataclasses.replace(schema, id=schema_id).write(copies)
            number = self._writer.register_channel(
                topic.name, topic.serialization_format, schema_id, dict(metadata)
            )
            Channel(
                id=number,
                schema_id=schema_id,
                topic=topic.name,
                message_encoding=topic.serialization_format,
                metadata=dict(metadata),
            ).write(copies)
            # The library declares it in the first chunk alone, and when that is damaged, nobody
            # knows what all the others hold. Here it stands outside of the chunks as well.
            self._opened.write(copies.end())
        self._unsafe = True
        self._channels[number] = topic.name
        self._topics.setdefault(topic.name, topic)
        self._counts.setdefault(topic.name, 0)
        return number

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message as it was serialized.

        `log_time` is when it was received, `publish_time` when it was sent [ns since the epoch].
        Raises BagError where the topic was not declared, a time does not fit, or the disk fails.
        """
        channel = self._named.get(topic)
        if channel is None:
            raise BagError(f"topic {topic} was not declared before its first message")
        self.write_to(channel, data, log_time, publish_time)

    def write_to(
        self, channel: int, data: bytes, log_time: int, publish_time: int, sequence: int = 0
    ) -> None:
        """Add one message to a channel that `add_channel` gave, with its number in the sequence.

        Raises what `write` raises.
        """
        topic = self._channels[channel]
        if not (0 <= log_time <= LATEST and 0 <= publish_time <= LATEST):
            raise BagError(
                f"a message of {topic} has log_time {log_time} ns and publish_time "
                f"{publish_time} ns; both must be from 0 to {LATEST}"
            )
        try:
            self._writer.add_message(
                channel_id=channel,
                log_time=log_time,
                data=data,
                publish_time=publish_time,
                sequence=sequence,
            )
        except OSError as error:
            raise self._failure(error) from error
        self._unsafe = True
        self._counts[topic] += 1
        if log_time < self._first:
            self._first = log_time
        if log_time > self._last:
            self._last = log_time

    def add_attachment(self, attachment: Attachment) -> None:
        """Keep a file in the bag.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._writer.add_attachment(
                attachment.create_time,
                attachment.log_time,
                attachment.name,
                attachment.media_type,
                attachment.data,
            )
        self._unsafe = True

    def add_custom_data(self, content: Mapping[str, str]) -> None:
        """Add to the custom data that goes to the bag's metadata."""
        self._custom_data.update(content)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Keep named text in the bag, such as how it was made.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._writer.add_metadata(name, dict(content))
        self._unsafe = True

    def flush(self) -> None:
        """Close the chunk in progress and wait until all that was written is on the disk.

        Raises BagError where the disk fails.
        """
        if not self._unsafe:
            return
        with self._guarded():
            self._writer.flush()
            os.fsync(self._opened.fileno())
        self._unsafe = False

    def close(self) -> None:
        """Complete the bag with its index, its statistics and `metadata.yaml`.

        Closing again is harmless; after a failed write it only releases the file. Raises BagError
        where the disk fails.
        """
        if self._stream is None:
            return
        try:
            if not self._failed:
                self._complete(self._stream)
        finally:
            stream, self._stream = self._stream, None
            with self._guarded():
                stream.close()

    def abandon(self) -> None:
        """Release the file and leave the bag torn."""
        self._failed = True
        self.close()

    def __enter__(self) -> BagWriter:
        """Give the writer itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Complete the bag with what was written, also after an error."""
        self.close()

    def _create_directory(self) -> None:
        try:
            os.makedirs(self._path)
        except OSError as error:
            if os.path.lexists(self._path):
                raise BagExistsError(
                    f"{self._path} exists already; a bag is never overwritten"
                ) from error
            raise BagError(f"cannot create the bag {self._path}: {error.strerror}") from error

    def _complete(self, stream: BinaryIO) -> None:
        metadata = self._metadata()
        with self._guarded():
            self._writer.flush()
            self._writer.add_metadata(RECORD_NAME, {RECORD_KEY: metadata.to_record()})
            self._writer.finish()
            stream.flush()
            os.fsync(stream.fileno())
            # Renamed when it is whole, so that there is never half a metadata.yaml.
            draft = self._path / f"{FILE_NAME}.tmp"
            with draft.open("x", encoding="utf-8") as document:
                document.write(metadata.to_document())
                document.flush()
                os.fsync(document.fileno())
            draft.rename(self._path / FILE_NAME)
            _sync_folder(self._path)

    def _metadata(self) -> BagMetadata:
        count = self.message_count
        start = self._first if count else 0
        duration = self._last - self._first if count else 0
        return BagMetadata(
            start_time=start,
            duration=duration,
            message_count=count,
            topics=tuple((topic, self._counts[name]) for name, topic in self._topics.items()),
            files=(FileInformation(self._file.name, start, duration, count),),
            custom_data=self._custom_data,
        )

    @property
    def _opened(self) -> BinaryIO:
        assert self._stream is not None
        return self._stream

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> BagError:
        self._failed = True
        return BagError(f"cannot write the bag {self._path}: {error.strerror}")


def _sync_folder(path: Path) -> None:
    """Wait until the names in a folder are on the disk: those of its files are not by theirs."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
