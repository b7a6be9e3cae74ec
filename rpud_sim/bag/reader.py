"""Read a rosbag2 bag, or a single file of one, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property
from pathlib import Path, PurePosixPath
from tempfile import TemporaryDirectory
from types import TracebackType
from typing import TYPE_CHECKING

from rpud_sim.bag.errors import BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import RECORD_NAME as LOSSES_RECORD
from rpud_sim.bag.losses import Losses, losses_from_record
from rpud_sim.bag.messages import Message, merged
from rpud_sim.bag.metadata import FILE_NAME, local_name, read_document
from rpud_sim.bag.rosbag2_compression import (
    SUFFIX,
    compresses_messages,
    uncompress_file,
    uncompress_message,
)
from rpud_sim.bag.storage_file import StorageFile, TopicSummary, clear_errors

if TYPE_CHECKING:
    import numpy as np
    import pandas

    from rpud_sim.bag.columns import Column
    from rpud_sim.bag.sqlite_file import SqliteFile
    from rpud_sim.bag.tables import Batch, Table

SQLITE = b"SQLite format 3\0"
"""How the files of rosbag2's storage sqlite3 begin; others are MCAP files."""

SUFFIXES = (".mcap", ".db3", f".mcap{SUFFIX}", f".db3{SUFFIX}")
"""How the names of storage files end."""


class BagReader:
    """An open bag: what is in it, and its messages in the order of their log times.

    `path` is a bag's directory or one file of it: MCAP or SQLite, also compressed. What a file
    repeats of the one before is there only where it is the first file. All times are integer
    nanoseconds since the epoch. Raises BagNotFoundError, or BagFormatError where a file is damaged
    or incomplete.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open the files and read their indexes."""
        self._path = Path(path)
        self._open_files = ExitStack()
        try:
            files, self._compressed_messages = storage_files(self._path)
            self._compressed_files = any(file.name.endswith(SUFFIX) for file in files)
            self._files = [self._open(file, file == files[0]) for file in files]
            self._sizes = [file.stat().st_size for file in files]
        except BaseException:
            self.close()
            raise

    @property
    def path(self) -> Path:
        """The path the bag was opened with."""
        return self._path

    @property
    def size(self) -> int:
        """Bytes of the storage files."""
        return sum(self._sizes)

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(file.message_count for file in self._files)

    @property
    def start_time(self) -> int:
        """Log time of the first message [ns]; 0 in an empty bag."""
        return min((file.start_time for file in self._filled), default=0)

    @property
    def end_time(self) -> int:
        """Log time of the last message [ns]; 0 in an empty bag."""
        return max((file.end_time for file in self._filled), default=0)

    @property
    def duration(self) -> int:
        """From the first to the last message [ns]."""
        return self.end_time - self.start_time

    @property
    def compression(self) -> str:
        """Compression of the chunks: `none`, `zstd`, `lz4`, or several with commas.

        Where rosbag2 compressed files or messages on its own, `zstd files` or `zstd messages` is
        one of them.
        """
        names = {name for file in self._files for name in file.compressions} - {""}
        if self._compressed_files:
            names.add("zstd files")
        if self._compressed_messages:
            names.add("zstd messages")
        return ",".join(sorted(names)) or "none"

    @cached_property
    def topics(self) -> tuple[TopicSummary, ...]:
        """All topics in the order of their names, also those without a message.

        Raises BagFormatError where one of them, or the record of losses, is damaged.
        """
        topics, errors = self._declared
        for error in errors.values():
            raise error
        return topics

    @property
    def readable_topics(self) -> tuple[TopicSummary, ...]:
        """The topics that are not damaged; `damages` names the others."""
        return self._declared[0]

    @property
    def damages(self) -> dict[str, str]:
        """Topics, and records beside them, that are damaged, with the reason."""
        return {name: str(error) for name, error in self._declared[1].items()}

    @cached_property
    def _declared(self) -> tuple[tuple[TopicSummary, ...], dict[str, BagFormatError]]:
        topics: list[TopicSummary] = []
        errors: dict[str, BagFormatError] = {}
        losses: dict[str, Losses] = {}
        try:
            for record in self.records(LOSSES_RECORD):
                losses |= losses_from_record(record)
        except BagFormatError as error:
            errors[f"record {LOSSES_RECORD}"] = error
        names = {name for file in self._files for name in file.topic_channels}
        for name in sorted(names):
            try:
                topics.append(self._summary(name, losses.get(name)))
            except BagFormatError as error:
                errors[name] = error
        return tuple(topics), errors

    def records(self, name: str) -> list[dict[str, str]]:
        """Give the metadata records of that name, in the order in which they were written."""
        return [content for file in self._files for content in file.records(name)]

    def messages(self, topics: Collection[str] | None = None, start: int = 0) -> Iterator[Message]:
        """Yield messages in the order of their log times.

        `topics` limits them to these names; `start` skips that many nanoseconds from the bag's
        beginning. A file without chunks is read in the order in which it was written. Raises
        BagFormatError where the file is damaged.
        """
        start_time = self.start_time + start
        found = merged(
            source for file in self._filled for source in file.sources(topics, start_time)
        )
        return map(self._uncompressed, found) if self._compressed_messages else found

    def columns(self, topic: str) -> tuple[Column, ...]:
        """Give the columns of a topic's table, with their units.

        Raises what `batches` raises.
        """
        return self._table(topic).columns

    def batches(
        self,
        topics: str | Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
        leave_out: Callable[[str, str], object] | None = None,
    ) -> Iterator[Batch]:
        """Yield the messages of topics as tables, piece by piece, in bounded memory.

        `topics` is one or several, or None for all that can be tables: `left_out` names the
        others. `start` skips that many nanoseconds from the bag's beginning, `duration` limits
        what follows. Where `leave_out` is given, it gets topic and reason of each message that is
        not of its type, and the others follow. Raises BagError where a topic is not in the bag,
        BagFormatError where one cannot be a table or is damaged.
        """
        from rpud_sim.bag.tables import batches  # loads what listing a bag does not need

        names = [topics] if isinstance(topics, str) else topics
        tables, _ = self._tables(names)
        end = None if duration is None else self.start_time + start + duration
        return batches(self._path, self.messages(tables, start), tables, end, leave_out)

    def arrays(
        self, topic: str, start: int = 0, duration: int | None = None
    ) -> dict[str, np.ndarray]:
        """Give a topic as one NumPy array for each column; times are integer nanoseconds.

        Arguments and errors are those of `batches`.
        """
        from rpud_sim.bag.tables import joined

        return joined(self._table(topic), self.batches(topic, start, duration))

    def frame(self, topic: str, start: int = 0, duration: int | None = None) -> pandas.DataFrame:
        """Give a topic as a pandas frame; times are its datetimes, the index is the first of them.

        Arguments and errors are those of `batches`; raises BagError where there is no pandas.
        """
        from rpud_sim.bag.tables import to_frame

        return to_frame(self._table(topic), self.arrays(topic, start, duration))

    @property
    def left_out(self) -> dict[str, str]:
        """Topics that cannot be tables, with the reason."""
        return self._tables(None)[1]

    def close(self) -> None:
        """Release the files."""
        self._open_files.close()

    def __enter__(self) -> BagReader:
        """Give the reader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Release the files."""
        self.close()

    def _table(self, topic: str) -> Table:
        return self._tables([topic])[0][topic]

    def _tables(self, topics: Collection[str] | None) -> tuple[dict[str, Table], dict[str, str]]:
        from rpud_sim.bag.tables import open_tables

        errors = self._declared[1]
        for name in topics or ():
            if name in errors:
                raise errors[name]
        return open_tables(self._path, self._known, topics)

    @cached_property
    def _known(self) -> dict[str, TopicSummary]:
        return {summary.topic.name: summary for summary in self.readable_topics}

    def _open(self, file: Path, first: bool) -> StorageFile | SqliteFile:
        path = file
        with clear_errors(file):
            if file.exists() and not file.is_file():  # to open a FIFO may take forever
                raise BagFormatError(f"{file} is not a file")
            if file.name.endswith(SUFFIX):
                folder = self._open_files.enter_context(TemporaryDirectory(prefix="rpud-"))
                path = uncompress_file(file, Path(folder))
            with path.open("rb") as stream:
                is_database = stream.read(len(SQLITE)) == SQLITE
        if is_database:
            from rpud_sim.bag.sqlite_file import SqliteFile  # loads what MCAP does not need

            return self._open_files.enter_context(SqliteFile(path, file))
        return self._open_files.enter_context(StorageFile(path, repeats=first, shown=file))

    def _uncompressed(self, message: Message) -> Message:
        try:
            return replace(message, data=uncompress_message(message.data))
        except BagFormatError as error:
            raise BagFormatError(f"{self._path}: {message.topic}: {error}") from error

    @property
    def _filled(self) -> list[StorageFile | SqliteFile]:
        # Statistics of a file without messages say that it starts at 0.
        return [file for file in self._files if file.message_count]

    def _summary(self, name: str, losses: Losses | None) -> TopicSummary:
        parts = [file.topic(name) for file in self._files if name in file.topic_channels]
        times = [
            time for part in parts for time in (part.first_time, part.last_time) if time is not None
        ]
        return TopicSummary(
            topic=parts[0].topic,
            message_count=sum(part.message_count for part in parts),
            first_time=min(times, default=None),
            last_time=max(times, default=None),
            definition=parts[0].definition,
            losses=losses,
            kinds=frozenset().union(*(part.kinds for part in parts)),
        )


def in_order(files: Iterable[Path]) -> list[Path]:
    """Sort files of a bag by their numbers: `run_10.mcap` comes after `run_9.mcap`."""
    return sorted(files, key=_name_parts)


def _name_parts(file: Path) -> tuple[str, int, str]:
    name = Path(file.name.removesuffix(SUFFIX)).stem
    stem = name.rstrip("0123456789")
    digits = name[len(stem) :]
    return stem, len(digits), digits


def storage_files(path: Path) -> tuple[list[Path], bool]:
    """Name the files of a bag, in the order of its metadata, and tell if messages are compressed.

    Raises BagNotFoundError, and BagFormatError where the metadata cannot be understood.
    """
    if path.is_file():
        return [path], False
    if not path.is_dir():
        raise BagNotFoundError(f"there is no bag at {path}")
    document = path / FILE_NAME
    if not document.is_file():
        files = in_order(file for suffix in SUFFIXES for file in path.glob(f"*{suffix}"))
        if not files:
            raise BagNotFoundError(f"{path} holds neither {FILE_NAME} nor an MCAP or SQLite file")
        return files, False
    with clear_errors(document):
        metadata = read_document(document)
        compressed = compresses_messages(metadata)
    if metadata.storage_identifier not in ("mcap", "sqlite3"):
        raise BagFormatError(
            f"{document}: storage is {metadata.storage_identifier!r:.80}; only 'mcap' and "
            "'sqlite3' are read"
        )
    names = [_inside(name, document) for name in metadata.relative_file_paths]
    if len(set(names)) < len(names):
        raise BagFormatError(f"{document}: a file is named twice")
    return [path / name for name in names], compressed


def _inside(name: str, document: Path) -> PurePosixPath:
    pure = PurePosixPath(local_name(name))
    if pure.is_absolute() or ".." in pure.parts:
        raise BagFormatError(f"{document}: the file {name!r:.200} is outside of the bag")
    return pure
