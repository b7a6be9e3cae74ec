"""Writer of a rosbag2 bag: a directory with MCAP files and ``metadata.yaml``."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from mcap.records import Schema

from rpud_sim.bag.mcap_writer import (
    COMPRESSIONS,
    McapWriter,
    MessageRecords,
    interleaved,
)
from rpud_sim.bag.metadata import (
    FILE_NAME,
    OFFERED_QOS_KEY,
    RECORD_KEY,
    RECORD_NAME,
    FileInformation,
    Topic,
    dump_document,
    dump_offered_qos,
    dump_yaml,
    metadata_of,
    stored_name,
)
from rpud_sim.foundation.atomic_folder import make_folder, remove_folder, write_atomic
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.user_files import named_errors
from rpud_sim.messages.batch import LATEST, Batch
from rpud_sim.messages.errors import BagError, BagExistsError

CHUNK_SIZE = 1 << 20  # uncompressed size after which a chunk is closed [bytes]
_MOST_CHANNELS = 2**16 - 1


class BagWriter:
    """New bag for serialized messages, complete when it is closed.

    Written messages are on the disk after ``flush``. A bag that was never closed lacks its index
    and ``metadata.yaml``; ``recover`` makes a whole bag of it. Each file of a split bag is whole
    and has all channels. Threads must not share a writer.

    Args:
        compression: of the chunks: ``none`` or ``zstd``.
        chunk_size: uncompressed size after which a chunk is closed [bytes].
        max_file_size: a new file begins before one is larger [bytes], unless one call writes more.
        max_file_duration: a new file begins before one lasts longer [s].
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        compression: str = "zstd",
        chunk_size: int = CHUNK_SIZE,
        max_file_size: int | None = None,
        max_file_duration: float | None = None,
    ) -> None:
        if compression not in COMPRESSIONS:
            allowed = ", ".join(COMPRESSIONS)
            raise BagError(f"compression is {compression!r}; it must be one of {allowed}")
        self.path = Path(os.path.abspath(path))  # directory of the bag
        self._compression, self._chunk_size = compression, chunk_size
        self._max_size = max_file_size
        self._max_duration = max_file_duration and round(max_file_duration * SECOND)
        self._channels: list[tuple[str, str, Schema | None, dict[str, str]]] = []
        self._channel_of: dict[str, int] = {}  # number of the last channel of each topic
        self._topics: dict[str, Topic] = {}
        self._counts: dict[str, int] = {}
        self._began: int | None = None  # log time of the file's first message
        self._closed_files: list[FileInformation] = []
        self._closed_size = 0
        self._listed_size = 0  # bytes that topics take in the metadata, at most
        self._file: McapWriter | None = None
        stored_name(self.path)  # before anything is created
        self._made = _create(self.path)  # folders, its own first
        try:
            self._open_file()
            with named_errors(self.path, BagError):
                _sync(self.path.parent)
        except BaseException:
            self.discard()
            raise

    @property
    def message_count(self) -> int:
        """Messages written so far."""
        return sum(self._counts.values())

    @property
    def size(self) -> int:
        """Size of the files on the disk so far [bytes]."""
        return self._closed_size + (self._file.path.stat().st_size if self._file else 0)

    @property
    def closed_size(self) -> int:
        """Greatest size of the bag, were it split and closed now [bytes]."""
        open_size = self._file.closed_size + self._file.end_size if self._file else 0
        listed = 2 * (self._listed_size + 512 * self.file_count)
        return self._closed_size + open_size + listed

    @property
    def file_count(self) -> int:
        """Files so far."""
        return len(self._closed_files) + (self._file is not None)

    def add_topic(self, topic: Topic, definition: str | None = None) -> None:
        """Declare a topic, with its type's ``ros2msg`` text if known, before its first message."""
        if topic.name in self._channel_of:
            raise BagError(f"topic {topic.name} was declared twice")
        schema = Schema(
            id=0,
            name=topic.type,
            encoding="" if definition is None else "ros2msg",
            data=(definition or "").encode(),
        )
        metadata = {
            OFFERED_QOS_KEY: dump_offered_qos(topic.offered_qos),
            "topic_type_hash": topic.type_hash,
        }
        self.add_channel(topic, schema, metadata)

    def add_channel(self, topic: Topic, schema: Schema | None, metadata: Mapping[str, str]) -> int:
        """Declare a channel of a topic and return its number; a topic may have several.

        The number of ``schema`` does not matter.
        """
        if len(self._channels) >= _MOST_CHANNELS:
            raise BagError(f"a bag has at most {_MOST_CHANNELS} channels")
        channel = (topic.name, topic.serialization_format, schema, dict(metadata))
        number = self._opened.add_channel(*channel)
        self._channels.append(channel)
        self._listed_size += 1024 + len(topic.name) + 512 * len(topic.offered_qos)
        self._topics.setdefault(topic.name, topic)
        self._counts.setdefault(topic.name, 0)
        self._channel_of[topic.name] = number
        return number

    def write_batches(self, batches: Sequence[Batch]) -> None:
        """Add the serialized messages of batches: of one group, or else one behind the other.

        The file is the same as if they were written one by one in that order.
        """
        found = [(self._channel(batch.topic), batch) for batch in batches if len(batch)]
        for _, batch in found:
            logs, sent = batch.log_times, batch.publish_times
            wrong = (logs < 0) | (logs > LATEST) | (sent < 0) | (sent > LATEST)
            for row in np.flatnonzero(wrong)[:1].tolist():
                raise _time_error(batch.topic, int(logs[row]), int(sent[row]))
        if found:
            self._split_if_full(
                sum(int(batch.sizes.sum()) for _, batch in found),
                min(int(batch.log_times.min()) for _, batch in found),
            )
            self._opened.write(interleaved(found))
        for _, batch in found:
            self._counts[batch.topic] += len(batch)

    def write(self, topic: str, data: bytes, log_time: int, publish_time: int) -> None:
        """Add one message, with times of receipt and sending [ns since the epoch]."""
        channel = self._channel(topic)
        if not (0 <= log_time <= LATEST and 0 <= publish_time <= LATEST):
            raise _time_error(topic, log_time, publish_time)
        self._split_if_full(len(data), log_time)
        self._opened.add(channel, data, log_time, publish_time)
        self._counts[topic] += 1

    def write_records(self, records: MessageRecords) -> None:
        """Add records of the bag's channels, by their numbers, to the open file."""
        numbers, counts = np.unique(records.channels, return_counts=True)
        for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
            self._counts[self._channels[number - 1][0]] += count
        self._opened.write(records)

    def split(self) -> None:
        """Complete the file and continue in a new one."""
        self._complete_file()
        self._open_file()
        self._began = None

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        """Add a metadata record: named texts, such as how the bag was made."""
        self._opened.add_record(name, content)

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything written is on the disk."""
        self._opened.flush()

    def close(self) -> None:
        """Complete the bag with its index, its statistics and ``metadata.yaml``.

        A closed bag stays as it is. After a failed write this only releases the file.
        """
        if self._file is None:
            return
        try:
            with named_errors(self.path, BagError):
                if not self._file.failed:
                    self._complete_file()
                    _write_document(self.path, self._metadata(self._closed_files))
        finally:
            self._release()

    def __enter__(self) -> BagWriter:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()  # also after an error: what was written makes a whole bag

    def _channel(self, topic: str) -> int:
        channel = self._channel_of.get(topic)
        if channel is None:
            raise BagError(f"topic {topic} was not declared before its first message")
        return channel

    def _split_if_full(self, size: int, log_time: int) -> None:
        """Begin a new file if messages of a size [bytes] and from a time on [ns] have no space."""
        if self._began is None:
            self._began = log_time
        elif (self._max_duration is not None and log_time - self._began >= self._max_duration) or (
            self._max_size is not None and self._opened.closed_size + size > self._max_size
        ):
            self.split()
            self._began = log_time

    def _open_file(self) -> None:
        path = self.path / f"{self.path.name}_{len(self._closed_files)}.mcap"
        self._file = McapWriter(path, self._compression, self._chunk_size)
        for channel in self._channels:
            self._file.add_channel(*channel)
        self._file.flush()
        with named_errors(self.path, BagError):
            _sync(self.path)

    def _complete_file(self) -> None:
        file = self._opened
        file.flush()
        files = [*self._closed_files, file.information]
        file.add_record(RECORD_NAME, {RECORD_KEY: dump_yaml(self._metadata(files))})
        file.finish()
        self._release()
        self._closed_files = files
        self._closed_size += file.path.stat().st_size

    def _metadata(self, files: Sequence[FileInformation]) -> dict[str, Any]:
        counts = {topic: self._counts[name] for name, topic in self._topics.items()}
        return metadata_of(files, counts)

    @property
    def _opened(self) -> McapWriter:
        assert self._file is not None
        return self._file

    def _release(self) -> None:
        """Close the file, complete or not; after a failed write the rest of it fails again."""
        if self._file is not None:
            file, self._file = self._file, None
            with suppress(BagError, OSError):
                file.close()

    def discard(self) -> None:
        """Delete the bag, and the folders above it that were made for it."""
        remove_folder(self._made)
        self._release()


@contextmanager
def whole_bag(path: str | os.PathLike[str]) -> Iterator[BagWriter]:
    """Context with a new bag, which is deleted after an error or an interruption."""
    bag = BagWriter(path)
    try:
        yield bag
        bag.close()
    except BaseException:
        bag.discard()
        raise


def _time_error(topic: str, log_time: int, publish_time: int) -> BagError:
    return BagError(
        f"a message of {topic} has log_time {log_time} ns and publish_time "
        f"{publish_time} ns; both must be from 0 to {LATEST}"
    )


def _create(folder: Path) -> list[Path]:
    if os.path.lexists(folder):
        raise BagExistsError(f"{folder} exists already; a bag is never overwritten")
    with named_errors(folder, BagError):
        return make_folder(folder)


def _write_document(folder: Path, metadata: Mapping[str, Any]) -> None:
    write_atomic(folder / FILE_NAME, dump_document(metadata))
    _sync(folder)


def _sync(folder: Path) -> None:
    """Wait until the names in a folder are on the disk: to sync files does not do that."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
