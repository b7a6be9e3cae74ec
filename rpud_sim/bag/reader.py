"""Read a rosbag2 bag, or a single MCAP file, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path, PurePosixPath
from types import TracebackType
from typing import TYPE_CHECKING

from rpud_sim.bag.errors import BagFormatError, BagNotFoundError
from rpud_sim.bag.losses import RECORD_NAME as LOSSES_RECORD
from rpud_sim.bag.losses import Losses, losses_from_record
from rpud_sim.bag.messages import Message, merged
from rpud_sim.bag.metadata import FILE_NAME, BagMetadata, read_document
from rpud_sim.bag.storage_file import StorageFile, TopicSummary, clear_errors

if TYPE_CHECKING:
    import numpy as np
    import pandas

    from rpud_sim.bag.columns import Column
    from rpud_sim.bag.tables import Batch, Table


class BagReader:
    """An open bag: what is in it, and its messages in the order of their log times.

    `path` is a bag's directory or one MCAP file. What a file repeats of the one before is there
    only where it is the first file. All times are integer nanoseconds since the
    epoch. Raises BagNotFoundError, or BagFormatError where a file is damaged or incomplete.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Open the files and read their indexes."""
        self._path = Path(path)
        self._open_files = ExitStack()
        try:
            self._files = [
                self._open_files.enter_context(StorageFile(file, repeats=number == 0))
                for number, file in enumerate(storage_files(self._path))
            ]
        except BaseException:
            self.close()
            raise

    @property
    def path(self) -> Path:
        """The path the bag was opened with."""
        return self._path

    @property
    def size(self) -> int:
        """Bytes of the MCAP files."""
        return sum(file.size for file in self._files)

    @property
    def message_count(self) -> int:
        """Messages of all topics."""
        return sum(file.message_count for file in self._files)

    @property
    def start_time(self) -> int:
        """Log time of the first message [ns]; 0 in an empty bag."""
        return min((file.statistics.message_start_time for file in self._filled), default=0)

    @property
    def end_time(self) -> int:
        """Log time of the last message [ns]; 0 in an empty bag."""
        return max((file.statistics.message_end_time for file in self._filled), default=0)

    @property
    def duration(self) -> int:
        """From the first to the last message [ns]."""
        return self.end_time - self.start_time

    @property
    def compression(self) -> str:
        """Compression of the chunks, one of `none`, `zstd` and `lz4`, or several with commas."""
        names = {
            index.compression or "none" for file in self._files for index in file.chunk_indexes
        }
        return ",".join(sorted(names)) or "none"

    @cached_property
    def topics(self) -> tuple[TopicSummary, ...]:
        """All topics in the order of their names, also those without a message."""
        losses = {
            topic: item
            for record in self.records(LOSSES_RECORD)
            for topic, item in losses_from_record(record).items()
        }
        names = {channel.topic for file in self._files for channel in file.channels.values()}
        return tuple(self._summary(name, losses.get(name)) for name in sorted(names))

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
        return merged(
            source for file in self._filled for source in file.sources(topics, start_time)
        )

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
    ) -> Iterator[Batch]:
        """Yield the messages of topics as tables, piece by piece, in bounded memory.

        `topics` is one or several, or None for all that can be tables: `left_out` names the
        others. `start` skips that many nanoseconds from the bag's beginning, `duration` limits
        what follows. Raises BagError where a topic is not in the bag, BagFormatError where one
        cannot be a table or is damaged.
        """
        from rpud_sim.bag.tables import batches  # loads what listing a bag does not need

        names = [topics] if isinstance(topics, str) else topics
        tables, _ = self._tables(names)
        end = None if duration is None else self.start_time + start + duration
        return batches(self._path, self.messages(tables, start), tables, end)

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

        return open_tables(self._path, self.topics, topics)

    @property
    def _filled(self) -> list[StorageFile]:
        # Statistics of a file without messages say that it starts at 0.
        return [file for file in self._files if file.message_count]

    def _summary(self, name: str, losses: Losses | None) -> TopicSummary:
        parts = [file.topic(name) for file in self._files if name in file.topic_names]
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
    stem = file.stem.rstrip("0123456789")
    digits = file.stem[len(stem) :]
    return stem, len(digits), digits


def storage_files(path: Path) -> list[Path]:
    """Name the MCAP files of a bag, in the order of its metadata."""
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise BagNotFoundError(f"there is no bag at {path}")
    document = path / FILE_NAME
    if not document.is_file():
        files = in_order(path.glob("*.mcap"))
        if not files:
            raise BagNotFoundError(f"{path} holds neither {FILE_NAME} nor an MCAP file")
        return files
    with clear_errors(document):
        metadata = read_document(document)
    if metadata.storage_identifier != "mcap":
        raise BagFormatError(
            f"{document}: storage is {metadata.storage_identifier!r:.80}; only 'mcap' is read"
        )
    check_compression(metadata, document)
    names = [_inside(name, document) for name in metadata.relative_file_paths]
    if len(set(names)) < len(names):
        raise BagFormatError(f"{document}: a file is named twice")
    return [path / name for name in names]


def check_compression(metadata: BagMetadata, document: Path) -> None:
    """Refuse files or messages that rosbag2 compressed on its own, beside the chunks of MCAP.

    Raises BagFormatError.
    """
    if metadata.compression_mode.lower() not in ("", "none"):
        raise BagFormatError(
            f"{document}: compression_mode is {metadata.compression_mode!r:.80}; "
            "only compression of MCAP chunks is read"
        )


def _inside(name: str, document: Path) -> PurePosixPath:
    pure = PurePosixPath(name)
    if pure.is_absolute() or ".." in pure.parts:
        raise BagFormatError(f"{document}: the file {name!r:.200} is outside of the bag")
    return pure
