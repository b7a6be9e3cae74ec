"""Folder of a new bag: its MCAP files, one after the other, and its ``metadata.yaml``."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from mcap.records import Attachment, Schema

from rpud_sim.bag.errors import BagError, BagExistsError
from rpud_sim.bag.latched import REPEATED_KEY
from rpud_sim.bag.message_block import MessageBlock
from rpud_sim.bag.metadata import (
    FILE_NAME,
    RECORD_KEY,
    RECORD_NAME,
    BagMetadata,
    FileInformation,
    Topic,
    metadata_of,
    stored_name,
)
from rpud_sim.bag.open_chunk import COMPRESSIONS
from rpud_sim.bag.output_file import OutputFile
from rpud_sim.bag.reserve import Reserve

CHUNK_SIZE = 1 << 20  # uncompressed size after which a chunk is closed [bytes]
_END = 1 << 20  # bytes of a reserve for records at the end of a bag, its metadata and its folder
_MOST_CHANNELS = 2**16 - 1


class BagFolder:
    """New bag that is written by channels; one of its files is open, all have the same channels.

    Its options are those of ``OutputFile``; with ``reserved`` it keeps room on the disk for
    ``hold``.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        compression: str = "zstd",
        chunk_size: int = CHUNK_SIZE,
        custom_data: Mapping[str, str] | None = None,
        reserved: bool = False,
    ) -> None:
        _check_compression(compression)
        self.path = Path(os.path.abspath(path))
        self._compression, self._chunk_size = compression, chunk_size
        self._custom_data = dict(custom_data or {})
        # By their numbers in the bag; ``_numbers`` are those in the open file.
        self._channels: list[tuple[str, str, Schema | None, dict[str, str]]] = []
        self._topics: dict[str, Topic] = {}
        self._counts: dict[str, int] = {}
        self._repeated = 0
        self._closed_files: list[FileInformation] = []
        self._closed_size = 0
        self._listed_size = 0  # bytes that topics take in the metadata, at most
        self._failed = False
        self._file: OutputFile | None = None
        stored_name(self.path)  # before anything is created
        _create(self.path)
        self._reserve = Reserve(self.path) if reserved else None
        with self._writing():
            self._file = self._open_file()
            _sync(self.path.parent)

    @property
    def message_count(self) -> int:
        """Messages without those that files repeat: the number that a reader counts."""
        return sum(self._counts.values()) - self._repeated

    @property
    def file_count(self) -> int:
        return len(self._closed_files) + (self._file is not None)

    @property
    def size(self) -> int:
        """Size of the files on the disk so far [bytes]."""
        return self._closed_size + (self._file.path.stat().st_size if self._file else 0)

    @property
    def open_size(self) -> int:
        """Greatest size of the open file, were it closed now [bytes]."""
        return self._opened.closed_size

    @property
    def closed_size(self) -> int:
        """Greatest size of the bag, were it split and closed now [bytes]."""
        open_size = self._file.closed_size + self._file.end_size if self._file else 0
        return self._closed_size + open_size + 2 * (self._listed_size + 512 * self.file_count)

    def add_channel(self, topic: Topic, schema: Schema | None, metadata: Mapping[str, str]) -> int:
        """Declare a channel of a topic and return its number; a topic may have several.

        The number of ``schema`` does not matter. Too many channels raise BagError.
        """
        if len(self._channels) >= _MOST_CHANNELS // 2:  # each may need another for repetitions
            raise BagError(f"a bag has at most {_MOST_CHANNELS // 2} channels")
        channel = (topic.name, topic.serialization_format, schema, dict(metadata))
        with self._writing():
            self._numbers.append(self._opened.add_channel(*channel))
        self._channels.append(channel)
        self._listed_size += 1024 + len(topic.name) + 512 * len(topic.offered_qos)
        self._topics.setdefault(topic.name, topic)
        self._counts.setdefault(topic.name, 0)
        return len(self._channels) - 1

    def write(
        self, channel: int, data: bytes, log_time: int, publish_time: int, sequence: int = 0
    ) -> None:
        try:  # faster than a context, and recorders write many messages
            self._opened.write(self._numbers[channel], data, log_time, publish_time, sequence)
        except OSError as error:
            raise self._failure(error) from error
        self._counts[self._channels[channel][0]] += 1

    def write_blocks(self, parts: Sequence[tuple[int, MessageBlock, np.ndarray]]) -> None:
        """Add many messages at once: channel, messages, and the place of each among all of them."""
        with self._writing():
            self._opened.write_blocks(
                [(self._numbers[channel], block, places) for channel, block, places in parts]
            )
        for channel, block, _ in parts:
            self._counts[self._channels[channel][0]] += len(block)

    def split(self, repeated: Iterable[tuple[int, bytes, int, int]]) -> None:
        """Complete the file and open the next one.

        That begins with the messages ``repeated``: channel, data, log and publish time [ns]. They
        go to channels of their own with the metadata ``REPEATED_KEY``.
        """
        with self._writing():
            self._complete_file()
            self._file = self._open_file()
            marked: dict[int, int] = {}
            for channel, data, log_time, publish_time in repeated:
                topic, encoding, schema, metadata = self._channels[channel]
                if channel not in marked:
                    marked[channel] = self._file.add_channel(
                        topic, encoding, schema, {**metadata, REPEATED_KEY: "true"}
                    )
                self._file.write(marked[channel], data, log_time, publish_time, 0)
                self._counts[topic] += 1
                self._repeated += 1

    def add_attachment(self, attachment: Attachment) -> None:
        with self._writing():
            self._opened.add_attachment(attachment)

    def add_custom_data(self, content: Mapping[str, str]) -> None:
        self._custom_data.update(content)

    def add_record(self, name: str, content: Mapping[str, str]) -> None:
        with self._writing():
            self._opened.add_record(name, content)

    def hold(self, size: int) -> bool:
        """Return whether ``size`` bytes and the bag's end fit on the disk, and reserve the room."""
        if self._reserve is None:
            return True
        with self._writing():
            return self._reserve.hold(self._opened.unwritten + 2 * self._listed_size + size + _END)

    def flush(self) -> None:
        """Close the chunk in progress and wait until everything written is on the disk."""
        with self._writing():
            self._opened.flush()

    def close(self) -> None:
        """Complete the bag; do nothing if it is closed, and only release it after a failure."""
        if self._file is None:
            return
        try:
            if self._reserve is not None:
                with self._writing():
                    self._reserve.release()
            if not self._failed:
                with self._writing():
                    self._complete_file()
                    _write_document(self.path, self._metadata(self._closed_files))
        finally:
            if self._file is not None:
                file, self._file = self._file, None
                # After a failed write the rest of a buffer fails here again.
                with suppress(OSError) if self._failed else self._writing():
                    file.close()

    def _open_file(self) -> OutputFile:
        name = f"{self.path.name}_{len(self._closed_files)}.mcap"
        path = self.path / name
        file = OutputFile(path, self._compression, self._chunk_size, self._reserve)
        self._numbers = [file.add_channel(*channel) for channel in self._channels]
        _sync(self.path)
        return file

    def _complete_file(self) -> None:
        file = self._opened
        file.flush()
        files = [*self._closed_files, file.information]
        file.add_record(RECORD_NAME, {RECORD_KEY: self._metadata(files).to_record()})
        file.finish()
        self._file = None
        file.close()
        self._closed_files = files
        self._closed_size += file.path.stat().st_size

    def _metadata(self, files: Sequence[FileInformation]) -> BagMetadata:
        topics = tuple((topic, self._counts[name]) for name, topic in self._topics.items())
        return metadata_of(files, topics, self._custom_data)

    @property
    def _opened(self) -> OutputFile:
        assert self._file is not None
        return self._file

    @contextmanager
    def _writing(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            raise self._failure(error) from error

    def _failure(self, error: OSError) -> BagError:
        self._failed = True
        return BagError(f"cannot write the bag {self.path}: {error.strerror}")


def _check_compression(compression: str) -> None:
    if compression not in COMPRESSIONS:
        allowed = ", ".join(COMPRESSIONS)
        raise BagError(f"compression is {compression!r}; it must be one of {allowed}")


def _create(folder: Path) -> None:
    try:
        os.makedirs(folder)
    except OSError as error:
        if os.path.lexists(folder):
            raise BagExistsError(f"{folder} exists already; a bag is never overwritten") from error
        raise BagError(f"cannot create the bag {folder}: {error.strerror}") from error


def _write_document(folder: Path, metadata: BagMetadata) -> None:
    # Renamed when it is whole, so that there is never half a metadata.yaml.
    draft = folder / f"{FILE_NAME}.tmp"
    with draft.open("x", encoding="utf-8") as document:
        document.write(metadata.to_document())
        document.flush()
        os.fsync(document.fileno())
    draft.rename(folder / FILE_NAME)
    _sync(folder)


def _sync(folder: Path) -> None:
    """Wait until the names in a folder are on the disk: to sync files does not do that."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
