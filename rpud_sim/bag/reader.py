"""Reader of a rosbag2 bag, or of a single file of one, in bounded memory."""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator
from contextlib import ExitStack
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

import numpy as np

from rpud_sim.bag.folders import storage_files
from rpud_sim.bag.limits import OVERLAP_LIMIT
from rpud_sim.bag.mcap_contents import REMEDY
from rpud_sim.bag.mcap_reader import BagChunk, McapFile
from rpud_sim.bag.metadata import LOSSES_RECORD, Losses, TopicSummary, losses_from_record
from rpud_sim.messages.batch import (
    Batch,
    Message,
    messages_of,
    ordered_by_topic,
)
from rpud_sim.messages.errors import BagFormatError, BagNotFoundError, BagWarning

if TYPE_CHECKING:
    import pandas

    from rpud_sim.bag.tables import RowTable, Tables
    from rpud_sim.messages.columns import Column


class BagReader:
    """Open bag: its topics, and its messages in the order of their log times.

    All times are integer nanoseconds since the epoch. A bag that is read as a whole, and is not as
    rosbag2 writes it, gives a ``BagWarning``.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        self.path = Path(path)  # path that was opened
        self._opened = ExitStack()
        try:
            found = storage_files(self.path)
            if found.missing:
                hint = "; rpud recover makes a bag of the other files" if found.files else ""
                raise BagNotFoundError(f"{self.path}: {found.missing[0]}{hint}")
            self.files = found.files  # the storage files
            self._files = [self._opened.enter_context(McapFile(file)) for file in self.files]
        except BaseException:
            self.close()
            raise
        unread = "is not read, for metadata.yaml does not list it; rpud recover reads it"
        said = [*found.warnings, *(f"{self.path}: {gap}" for gap in found.gaps)]
        said += [f"{file} {unread}" for file in found.unlisted]
        for text in (*said, *(file.warning for file in self._files if file.warning)):
            warnings.warn(BagWarning(text), stacklevel=3)
        self.size = sum(file.size for file in self._files)  # size of the storage files [bytes]
        # Statistics of a file without messages report that it starts at 0.
        self._filled = [file for file in self._files if file.message_count]

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
        """Compression of the chunks: ``none``, ``zstd``, ``lz4``, or several with commas."""
        names = {name for file in self._files for name in file.compressions} - {""}
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
    def unread_offers(self) -> list[str]:
        """A sentence for each file in which the QoS of some topics cannot be read."""
        files = self._files if self._declared else ()  # declared: their offers have been read
        return [
            f"{file.path}: the QoS of {len(unread)} topics, such as {next(iter(unread)):.200}, "
            f"cannot be read: {next(iter(unread.values()))}"
            for file in files
            if (unread := file.unread_offers)
        ]

    @property
    def left_out(self) -> dict[str, str]:
        """Reasons why topics cannot be tables, by their names."""
        return self._tables.left_out

    def records(self, name: str) -> list[dict[str, str]]:
        """Return the metadata records of one name, in the order in which they were written."""
        return [content for file in self._files for content in file.records(name)]

    def chunks(self) -> list[BagChunk]:
        """Return the chunks, sorted by their beginnings."""
        found = (chunk for file in self._files for chunk in file.chunks())
        return sorted(found, key=lambda chunk: chunk.start_time)

    def _written_times(self) -> Iterator[tuple[str, np.ndarray]]:
        """Yield topics with log times [ns] in the order of the files."""
        for file in self._files:
            yield from file.written_times()

    def messages(
        self,
        topics: Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
    ) -> Iterator[Message]:
        """Yield messages in the order of their log times; None for all topics.

        ``start`` counts from the bag's beginning, ``duration`` from there [ns].
        """
        for due in self._due(topics, start, duration):
            yield from messages_of(due)

    def batches(
        self,
        topics: Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
    ) -> Iterator[Batch]:
        """Yield the messages of ``messages`` in batches of one topic, in bounded memory.

        Within a topic they have the same order; between topics only the chunks do. A batch is a
        view of its chunk: who keeps batches should keep ``packed`` ones.
        """
        for due in self._due(topics, start, duration):
            yield from ordered_by_topic(due)

    def _due(
        self, topics: Collection[str] | None, start: int, duration: int | None
    ) -> Iterator[list[Batch]]:
        begin = start + self.start_time
        end = None if duration is None else begin + duration
        # A whole bag has all messages, whatever times its statistics report.
        return _due_batches(self.chunks(), topics, begin if start > 0 else 0, end)

    def columns(self, topic: str) -> tuple[Column, ...]:
        """Return the columns of a topic's table, with units; errors as in ``tables``."""
        return self._tables.table(topic).columns

    def tables(
        self,
        topics: str | Collection[str] | None = None,
        start: int = 0,
        duration: int | None = None,
        leave_out: Callable[[str, str], object] | None = None,
    ) -> Iterator[RowTable]:
        """Yield the messages of topics as columns, batch by batch, in bounded memory.

        Args:
            topics: name or names; None for all that can be tables: ``left_out`` has the others.
            start: time to skip from the bag's beginning [ns].
            duration: time after that [ns]; None for all.
            leave_out: called with the topic and the reason for each message that does not fit its
                type, which is then skipped; None for an error.
        """
        tables = self._tables.choose([topics] if isinstance(topics, str) else topics)
        return self._tables.batches(tables, self.batches(tables, start, duration), leave_out)

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
        ``start`` and ``duration`` are as for ``tables``.
        """
        tables = self._tables.choose([topics] if isinstance(topics, str) else topics)
        found = self._tables.arrays(tables, self.batches(tables, start, duration))
        return found[topics] if isinstance(topics, str) else found

    def frame(
        self,
        topic: str,
        start: int = 0,
        duration: int | None = None,
        *,
        index: str | None = None,
    ) -> pandas.DataFrame:
        """Return a topic as a pandas frame with its datetimes; ``attrs["units"]`` has the units.

        ``index`` is the name of the column that becomes the index, such as ``header.stamp``; None
        for the first one. ``start`` and ``duration`` are as for ``tables``.
        """
        from rpud_sim.bag.tables import to_frame, with_datetimes

        table = self._tables.table(topic)
        columns = with_datetimes(table, self.arrays(topic, start, duration))
        return to_frame(
            columns, {each.name: each.unit for each in table.columns}, index or next(iter(columns))
        )

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
        """Readable topics by name, and errors of damaged ones and of the record of losses."""
        topics: list[TopicSummary] = []
        errors: dict[str, BagFormatError] = {}
        losses: dict[str, Losses] = {}
        try:
            for record in self.records(LOSSES_RECORD):
                losses |= losses_from_record(record)
        except BagFormatError as error:
            errors[f"record {LOSSES_RECORD}"] = error
        for name in sorted({name for file in self._files for name in file.topic_channels}):
            files = [file for file in self._files if name in file.topic_channels]
            try:
                found = [file.topic(name) for file in files]
            except BagFormatError as error:
                errors[name] = error
            else:
                topics.append(TopicSummary.joined(found, losses.get(name)))
        return tuple(topics), errors


def _due_batches(
    chunks: Iterable[BagChunk],
    topics: Collection[str] | None = None,
    start: int = 0,
    end: int | None = None,
) -> Iterator[list[Batch]]:
    """Yield the batches that are due before each chunk, and the rest at the end.

    No later one has an earlier message. A chunk is read when none before it holds earlier ones.
    ``topics`` is None for all. Messages with log times from ``start`` on and before ``end`` [ns]
    count.
    """
    chosen = [
        chunk
        for chunk in chunks
        if chunk.end_time >= start
        and (end is None or chunk.start_time < end)
        and (topics is None or not chunk.topics.isdisjoint(topics))
    ]
    waiting: list[Batch] = []
    opened: list[tuple[int, int]] = []  # last time and size of chunks
    reached = -1  # log time of the last message so far
    for chunk in sorted(chosen, key=lambda chunk: chunk.start_time):
        due, waiting = _parted(waiting, chunk.start_time)
        reached = max([reached, *(int(batch.log_times[-1]) for batch in due)])
        yield due
        opened = [each for each in opened if each[0] >= chunk.start_time]
        if opened and chunk.size + sum(size for _, size in opened) > OVERLAP_LIMIT:
            raise BagFormatError(
                f"more than {OVERLAP_LIMIT} bytes of chunks overlap in time, "
                "too much to put their messages in order"
            )
        last = -1
        for batch in chunk.batches(topics):
            first = _count_before(batch.log_times, start)
            behind = len(batch) if end is None else _count_before(batch.log_times, end)
            batch = batch.part(slice(first, behind))
            if len(batch):
                if batch.log_times[0] < reached:
                    raise BagFormatError(
                        f"{chunk.file.path}: a message is earlier than its chunk begins; {REMEDY}"
                    )
                waiting.append(batch)
                last = max(last, int(batch.log_times[-1]))
        if last >= 0:
            opened.append((last, chunk.size))
    yield waiting


def _parted(waiting: Iterable[Batch], until: int) -> tuple[list[Batch], list[Batch]]:
    """Return what is due up to a time [ns], which no later chunk precedes, and the rest."""
    due, rest = [], []
    for batch in waiting:
        count = _count_before(batch.log_times, until, "right")
        if count:
            due.append(batch.part(slice(0, count)))
        if count < len(batch):
            rest.append(batch.part(slice(count, None)))
    return due, rest


def _count_before(times: np.ndarray, time: int, side: Literal["left", "right"] = "left") -> int:
    if not len(times) or times[-1] < time:
        return len(times)
    return int(np.searchsorted(times, time, side))
