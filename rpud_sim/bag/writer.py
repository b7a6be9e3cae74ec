"""Write a rosbag2 bag: a directory with MCAP files and `metadata.yaml`."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType

from mcap.records import Attachment, Schema

from rpud_sim.bag.errors import BagError, BagExistsError
from rpud_sim.bag.latched import REPEATED_KEY, LatchedMessages
from rpud_sim.bag.messages import Message
from rpud_sim.bag.metadata import (
    FILE_NAME,
    RECORD_KEY,
    RECORD_NAME,
    BagMetadata,
    FileInformation,
    Topic,
    dump_offered_qos,
    stored_name,
)
from rpud_sim.bag.output_file import COMPRESSIONS, LATEST, OutputFile
from rpud_sim.bag.reserve import Reserve
from rpud_sim.foundation.time import SECOND

__all__ = ["COMPRESSIONS", "LATEST", "BagWriter"]

CHUNK_SIZE = 1 << 20
"""Uncompressed bytes after which a chunk is closed."""

_END = 1 << 20  # bytes of a reserve for records at the end of a bag, its metadata and its folder
_MOST_CHANNELS = 2**16 - 1


class BagWriter:
    """Writes serialized messages to the new bag `path`/ and completes it when it is closed.

    Times are integer nanoseconds since the epoch. What is written is on the disk after `flush`;
    a bag that was never closed lacks its index and `metadata.yaml`, and `recovery.recover` makes a
    whole one of it. Where it is split, each file is a whole one with all channels, and begins with
    the last messages of latched topics: on channels of their own, marked with `rpud_repeated`, and
    with the log time of the message before. Not for use by several threads at once.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        compression: str = "zstd",
        chunk_size: int = CHUNK_SIZE,
        custom_data: Mapping[str, str] | None = None,
        max_file_size: int | None = None,
        max_file_duration: float | None = None,
        reserved: bool = False,
    ) -> None:
        """Create the directory and its first file.

        `compression` is one of COMPRESSIONS, `chunk_size` is in bytes; `custom_data` goes to the
        bag's metadata. A new file begins before one is larger than `max_file_size` bytes, as far
        as single messages are not, or lasts `max_file_duration` [s]. Where it is `reserved`,
        `reserve` keeps room on the disk to close it. Raises BagExistsError where
        anything exists at `path`, BagError where it cannot be created.
        """
        if compression not in COMPRESSIONS:
            allowed = ", ".join(COMPRESSIONS)
            raise BagError(f"compression is {compression!r}; it must be one of {allowed}")
        self._path = Path(os.path.abspath(path))
        self._compression, self._chunk_size = compression, chunk_size
        self._custom_data = dict(custom_data or {})
        self._max_size = max_file_size
        self._max_duration = max_file_duration and round(max_file_duration * SECOND)
        self._topics: dict[str, Topic] = {}
        self._named: dict[str, int] = {}  # the channel of each topic that add_topic declared
        # By their numbers in the bag; `_numbers` are those in the open file.
        self._channels: list[tuple[str, str, Schema | None, dict[str, str]]] = []
        self._counts: dict[str, int] = {}
        self._repeated = 0
        self._latched = LatchedMessages()
        self._last = 0  # log time of the last message
        self._began: int | None = None  # log time of the file's first message that is not repeated
        self._closed_files: list[FileInformation] = []
        self._closed_size = 0
        self._listed_size = 0  # bytes that topics take in the metadata, at most
        self._failed = False
        self._file: OutputFile | None = None
        stored_name(self._path)  # before anything is created
        self._create_directory()
        self._reserve = Reserve(self._path) if reserved else None
        with self._guarded():
            self._file = self._open_file()
            _sync_folder(self._path.parent)

    @property
    def path(self) -> Path:
        """The bag's directory."""
        return self._path

    @property
    def message_count(self) -> int:
        """Messages written so far, without those that files repeat: what a reader will count."""
        return sum(self._counts.values()) - self._repeated

    @property
    def size(self) -> int:
        """Bytes of the files on the disk so far."""
        there = self._opened.path.stat().st_size if self._file is not None else 0
        return self._closed_size + there

    @property
    def closed_size(self) -> int:
        """Bytes of the bag at most, were it split and closed now."""
        open_size = self._file.closed_size + self._file.end_size if self._file is not None else 0
        listed = self._listed_size + 512 * self.file_count
        return self._closed_size + open_size + self._latched.size + 2 * listed

    @property
    def file_count(self) -> int:
        """Files so far."""
        return len(self._closed_files) + (self._file is not None)

    def add_topic(self, topic: Topic, definition: str | None = None) -> None:
        """Declare a topic before its first message.

        `definition` is the complete `ros2msg` text of its type; None where it is unknown.
        Raises BagError where the topic was declared already.
        """
        if topic.name in self._topics:
            raise BagError(f"topic {topic.name} was declared twice")
        schema = Schema(
            id=0,
            name=topic.type,
            encoding="" if definition is None else "ros2msg",
            data=(definition or "").encode(),
        )
        metadata = {
            "offered_qos_profiles": dump_offered_qos(topic.offered_qos),
            "topic_type_hash": topic.type_hash,
        }
        self._named[topic.name] = self.add_channel(topic, schema, metadata)
        self._latched.declare(topic)

    def add_channel(self, topic: Topic, schema: Schema | None, metadata: Mapping[str, str]) -> int:
        """Declare a channel of a topic as another file has it; give its number in this one.

        A topic may have several. The number that `schema` has there does not matter. Raises
        BagError where there are too many.
        """
        if len(self._channels) >= _MOST_CHANNELS // 2:  # each may need another when it is repeated
            raise BagError(f"a bag has at most {_MOST_CHANNELS // 2} channels")
        channel = (topic.name, topic.serialization_format, schema, dict(metadata))
        with self._guarded():
            number = self._opened.add_channel(*channel)
        self._numbers.append(number)
        self._channels.append(channel)
        self._listed_size += 1024 + len(topic.name) + 512 * len(topic.offered_qos)
        self._topics.setdefault(topic.name, topic)
        self._counts.setdefault(topic.name, 0)
        return len(self._channels) - 1

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
        topic = self._channels[channel][0]
        if not (0 <= log_time <= LATEST and 0 <= publish_time <= LATEST):
            raise BagError(
                f"a message of {topic} has log_time {log_time} ns and publish_time "
                f"{publish_time} ns; both must be from 0 to {LATEST}"
            )
        if self._is_full(len(data), log_time):
            self.split()
        try:
            self._opened.write(self._numbers[channel], data, log_time, publish_time, sequence)
        except OSError as error:
            raise self._failure(error) from error
        self._counts[topic] += 1
        self._last = log_time
        if self._began is None:
            self._began = log_time
        if topic in self._latched:
            self._latched.note(Message(topic, log_time, publish_time, data))

    def split(self) -> None:
        """Complete the file, and go on in a new one that begins with the latched messages.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._complete_file()
            self._file = self._open_file()
            for message in self._latched.at(self._last):
                number = self._repeating(message.topic)
                self._file.write(number, message.data, message.log_time, message.publish_time, 0)
                self._counts[message.topic] += 1
                self._repeated += 1

    def add_attachment(self, attachment: Attachment) -> None:
        """Keep a file in the bag.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._opened.add_attachment(attachment)

    def add_custom_data(self, content: Mapping[str, str]) -> None:
        """Add to the custom data that goes to the bag's metadata."""
        self._custom_data.update(content)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Keep named text in the bag, such as how it was made.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._opened.add_record(name, content)

    def reserve(self, size: int) -> bool:
        """Tell whether a message of `size` bytes can be written and the bag then be closed.

        The room for it is taken from other programs now. Raises BagError where the disk fails.
        """
        if self._reserve is None:
            return True
        with self._guarded():
            return self._reserve.hold(
                self._opened.unwritten + self._latched.size + 2 * self._listed_size + size + _END
            )

    def flush(self) -> None:
        """Close the chunk in progress and wait until all that was written is on the disk.

        Raises BagError where the disk fails.
        """
        with self._guarded():
            self._opened.flush()

    def close(self) -> None:
        """Complete the bag with its index, its statistics and `metadata.yaml`.

        Closing again is harmless; after a failed write it only releases the file. Raises BagError
        where the disk fails.
        """
        if self._file is None:
            return
        try:
            if self._reserve is not None:
                with self._guarded():
                    self._reserve.release()
            if not self._failed:
                with self._guarded():
                    self._complete_file()
                    self._write_document()
        finally:
            if self._file is not None:
                file, self._file = self._file, None
                # After a failed write the rest of a buffer fails here again.
                with suppress(OSError) if self._failed else self._guarded():
                    file.close()

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

    def _is_full(self, size: int, log_time: int) -> bool:
        if self._began is None:
            return False
        if self._max_duration is not None and log_time - self._began >= self._max_duration:
            return True
        return self._max_size is not None and self._opened.closed_size + size > self._max_size

    def _open_file(self) -> OutputFile:
        name = f"{self._path.name}_{len(self._closed_files)}.mcap"
        file = OutputFile(self._path / name, self._compression, self._chunk_size, self._reserve)
        self._numbers = [file.add_channel(*channel) for channel in self._channels]
        self._repeats: dict[str, int] = {}
        self._began = None
        _sync_folder(self._path)
        return file

    def _repeating(self, topic: str) -> int:
        """Give the channel of the open file for repeated messages of a topic."""
        if topic not in self._repeats:
            name, encoding, schema, metadata = self._channels[self._named[topic]]
            marked = {**metadata, REPEATED_KEY: "true"}
            self._repeats[topic] = self._opened.add_channel(name, encoding, schema, marked)
        return self._repeats[topic]

    def _complete_file(self) -> None:
        file = self._opened
        file.flush()
        information = file.information
        metadata = self._metadata([*self._closed_files, information])
        file.add_record(RECORD_NAME, {RECORD_KEY: metadata.to_record()})
        file.finish()
        self._file = None
        file.close()
        self._closed_files.append(information)
        self._closed_size += file.path.stat().st_size

    def _write_document(self) -> None:
        # Renamed when it is whole, so that there is never half a metadata.yaml.
        draft = self._path / f"{FILE_NAME}.tmp"
        with draft.open("x", encoding="utf-8") as document:
            document.write(self._metadata(self._closed_files).to_document())
            document.flush()
            os.fsync(document.fileno())
        draft.rename(self._path / FILE_NAME)
        _sync_folder(self._path)

    def _metadata(self, files: Sequence[FileInformation]) -> BagMetadata:
        filled = [file for file in files if file.message_count]
        start = min((file.start_time for file in filled), default=0)
        end = max((file.start_time + file.duration for file in filled), default=0)
        return BagMetadata(
            start_time=start,
            duration=end - start,
            message_count=sum(file.message_count for file in files),
            topics=tuple((topic, self._counts[name]) for name, topic in self._topics.items()),
            files=tuple(files),
            custom_data=self._custom_data,
        )

    @property
    def _opened(self) -> OutputFile:
        assert self._file is not None
        return self._file

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
