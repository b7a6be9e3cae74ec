"""Reader of a rosbag2 bag, or of a single file of one, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING, overload

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import (
    BagSegment,
    Message,
    MessageBlock,
    blocks_of,
    due_blocks,
    messages_of,
    ordered_by_topic,
)
from rpud_sim.bag.metadata import TopicSummary
from rpud_sim.bag.storage_files import (
    SUFFIX,
    open_storage_files,
    storage_files,
    summarize,
    uncompressed_messages,
)

if TYPE_CHECKING:
    import numpy as np
    import pandas

    from rpud_sim.bag.columns import Column
    from rpud_sim.bag.tables import Batch, Tables


class BagReader:
    """Open bag: its topics, and its messages in the order of their log times.

    Repetitions in files of a split bag are read from the first file only. All times are integer
    nanoseconds since the epoch. ``unclosed`` is as for ``rpud_sim.bag.open``.
    """

    def __init__(self, path: str | os.PathLike[str], *, unclosed: bool = False) -> None:
        self.path = Path(path)  # that the bag was opened with
        self._opened = ExitStack()
        try:
            self._paths, self._compressed = storage_files(self.path)
            self._files = open_storage_files(self._paths, self._opened, unclosed=unclosed)
            self.files = tuple(self._paths)  # the storage files
            # of the storage files [bytes]
            self.size = sum(file.stat().st_size for file in self._paths)
            # Statistics of a file without messages say that it starts at 0.
            self._filled = [file for file in self._files if file.message_count]
        except BaseException:
            self.close()
            raise

    @property
    def unclosed(self) -> tuple[Path, ...]:
        """Files that were not closed: they are still being written, or lost their end."""
        pairs = zip(self._paths, self._files, strict=True)
        return tuple(path for path, file in pairs if not file.closed)

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
        """Time from the first to the last message [ns]."""
        return self.end_time - self.start_time

    @property
    def compression(self) -> str:
        """Compression of the chunks: ``none``, ``zstd``, ``lz4``, or several with commas.

        ``zstd files`` or ``zstd messages`` is among them if rosbag2 compressed whole files or
        messages.
        """
        names = {name for file in self._files for name in file.compressions} - {""}
        names |= {"zstd files" for file in self._paths if file.name.endswith(SUFFIX)}
        names |= {"zstd messages"} if self._compressed else set()
        return ",".join(sorted(names)) or "none"

    @property
    def topics(self) -> tuple[TopicSummary, ...]:
        """All topics in the order of their names, with or without messages."""
        topics, errors = self._declared
        if errors:
            raise next(iter(errors.values()))
        return topics

    @property
    def readable_topics(self) -> tuple[TopicSummary, ...]:
        """Topics that are not damaged; ``damages`` names the others."""
        return self._declared[0]

    @property
    def damages(self) -> dict[str, str]:
        """Reasons why topics, or the record of losses, are damaged, by their names."""
        return {name: str(error) for name, error in self._declared[1].items()}

    @property
    def left_out(self) -> dict[str, str]:
        """Reasons why topics cannot be tables, by their names."""
        return self._tables.left_out

    def records(self, name: str) -> list[dict[str, str]]:
        """Return the metadata records of one name, in the order in which they were written."""
        return [content for file in self._files for content in file.records(name)]

    def messages(self, topics: Collection[str] | None = None, start: int = 0) -> Iterator[Message]:
        """Yield messages in the order of their log times.

        The time from the bag's beginning up to ``start`` [ns] is skipped.
        """
        steps = due_blocks(self._segments, topics, self.start_time + start)
        found = (message for due in steps for message in messages_of(due))
        return uncompressed_messages(found, self.path) if self._compressed else found

    def blocks(
        self,
        topics: Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
    ) -> Iterator[MessageBlock]:
        """Yield the messages of ``messages`` in blocks of one topic, in bounded memory.

        Within a topic they have the same order; between topics only the chunks do. A block of a
        chunk is a view of it: who keeps blocks should keep ``packed`` ones. ``start`` counts from
        the bag's beginning, ``duration`` from there [ns].
        """
        start_time = self.start_time + start
        end = None if duration is None else start_time + duration
        steps = due_blocks(self._segments, topics, start_time, end)
        return self._uncompressed(block for due in steps for block in ordered_by_topic(due))

    def segments(self) -> list[BagSegment]:
        """Return the parts that can be read by themselves, sorted by their beginnings."""

        def blocks(found: BagSegment, topics: Collection[str] | None) -> Iterable[MessageBlock]:
            return self._uncompressed(found.blocks(topics))

        found = [replace(each, blocks=partial(blocks, each)) for each in self._segments]
        return sorted(found, key=lambda segment: segment.start_time)

    @property
    def _segments(self) -> Iterator[BagSegment]:
        return (segment for file in self._filled for segment in file.segments())

    def _uncompressed(self, blocks: Iterable[MessageBlock]) -> Iterator[MessageBlock]:
        if not self._compressed:
            return iter(blocks)
        messages = (message for block in blocks for message in messages_of([block]))
        return blocks_of(uncompressed_messages(messages, self.path))

    def columns(self, topic: str) -> tuple[Column, ...]:
        """Return the columns of a topic's table, with units; errors are those of ``batches``."""
        return self._tables.table(topic).columns

    def batches(
        self,
        topics: str | Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
        leave_out: Callable[[str, str], object] | None = None,
    ) -> Iterator[Batch]:
        """Yield the messages of topics as tables, piece by piece, in bounded memory.

        Args:
            topics: name or names; None for all that can be tables: ``left_out`` has the others.
            start: time to skip from the bag's beginning [ns].
            duration: time after that [ns]; None for all.
            leave_out: called with the topic and the reason for each message that does not fit its
                type, which is then skipped; None for an error.
        """
        tables = self._tables.choose([topics] if isinstance(topics, str) else topics)
        return self._tables.batches(tables, self.blocks(tables, start, duration), leave_out)

    @overload
    def arrays(  # type: ignore[overload-overlap]  # a text is a collection of texts, too
        self, topics: str, start: int = 0, duration: int | None = None
    ) -> dict[str, np.ndarray]: ...

    @overload
    def arrays(
        self, topics: Collection[str], start: int = 0, duration: int | None = None
    ) -> dict[str, dict[str, np.ndarray]]: ...

    def arrays(
        self, topics: str | Collection[str], start: int = 0, duration: int | None = None
    ) -> dict[str, np.ndarray] | dict[str, dict[str, np.ndarray]]:
        """Return one NumPy array for each column of a topic; times are integer nanoseconds.

        Several topics are read in one pass. The result then has such columns for each topic.
        ``start`` and ``duration`` are as for ``batches``.
        """
        tables = self._tables.choose([topics] if isinstance(topics, str) else topics)
        found = self._tables.arrays(tables, self.blocks(tables, start, duration))
        return found[topics] if isinstance(topics, str) else found

    def frame(self, topic: str, start: int = 0, duration: int | None = None) -> pandas.DataFrame:
        """Return a topic as a pandas frame with its datetimes; the first of them is the index.

        ``start`` and ``duration`` are as for ``batches``.
        """
        from rpud_sim.bag.tables import to_frame

        return to_frame(self._tables.table(topic), self.arrays(topic, start, duration))

    def close(self) -> None:
        """Release the files."""
        self._opened.close()

    def __enter__(self) -> BagReader:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @cached_property
    def _tables(self) -> Tables:
        from rpud_sim.bag.tables import Tables  # loads what listing a bag does not need

        return Tables(self.path, *self._declared)

    @cached_property
    def _declared(self) -> tuple[tuple[TopicSummary, ...], dict[str, BagFormatError]]:
        return summarize(self._files)
