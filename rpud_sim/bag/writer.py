"""Write a rosbag2 bag: a directory with one MCAP file and `metadata.yaml`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

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

_LATEST = 2**63 - 1


class BagWriter:
    """Writes serialized messages to the new bag `path`/ and completes it when it is closed.

    Times are integer nanoseconds since the epoch. What is written is on the disk after `flush`;
    a bag that was never closed lacks its index and `metadata.yaml`. Not for use by several
    threads at once.
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
        self._schemas: dict[str, int] = {}
        self._topics: dict[str, Topic] = {}
        self._channels: dict[str, int] = {}
        self._counts: dict[str, int] = {}
        self._first, self._last = _LATEST, 0
        self._failed = False
        self._stream: BinaryIO | None = None
        self._create_directory()
        self._file = self._path / f"{self._path.name}_0.mcap"
        with self._guarded():
            self._stream = self._file.open("xb")
            self._writer = Writer(
                self._stream, chunk_size=chunk_size, compression=COMPRESSIONS[compression]
            )
            self._writer.start(profile="ros2", library="rpud_sim")

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
        with self._guarded():
            if topic.type not in self._schemas:
                self._schemas[topic.type] = self._writer.register_schema(
                    name=topic.type,
                    encoding="ros2msg" if definition else "",
                    data=definition.encode(),
                )
            self._channels[topic.name] = self._writer.register_channel(
                topic=topic.name,
                message_encoding=topic.serialization_format,
                schema_id=self._schemas[topic.type],
                metadata={
                    "offered_qos_profiles": dump_offered_qos(topic.offered_qos),
                    "topic_type_hash": topic.type_hash,
                },
            )
        self._topics[topic.name] = topic
        self._counts[topic.name] = 0

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message as it was serialized.

        `log_time` is when it was received, `publish_time` when it was sent [ns since the epoch].
        Raises BagError where the topic was not declared, a time does not fit, or the disk fails.
        """
        channel = self._channels.get(topic)
        if channel is None:
            raise BagError(f"topic {topic} was not declared before its first message")
        if not (0 <= log_time <= _LATEST and 0 <= publish_time <= _LATEST):
            raise BagError(
                f"a message of {topic} has log_time {log_time} ns and publish_time "
                f"{publish_time} ns; both must be from 0 to {_LATEST}"
            )
        try:
            self._writer.add_message(
                channel_id=channel, log_time=log_time, data=data, publish_time=publish_time
            )
        except OSError as error:
            raise self._failure(error) from error
        self._counts[topic] += 1
        if log_time < self._first:
            self._first = log_time
        if log_time > self._last:
            self._last = log_time

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Keep named text in the bag, such as how it was made.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._writer.add_metadata(name, dict(content))

    def flush(self) -> None:
        """Close the chunk in progress and wait until all that was written is on the disk.

        Raises BagError where the disk fails.
        """
        assert self._stream is not None
        with self._guarded():
            self._writer.flush()
            os.fsync(self._stream.fileno())

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

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> BagError:
        self._failed = True
        return BagError(f"cannot write the bag {self._path}: {error.strerror}")
