"""Tables of NumPy arrays from the messages of a topic, in batches of bounded size or whole."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.bag.metadata import TopicSummary
from rpud_sim.foundation.extras import import_extra
from rpud_sim.foundation.quantities import did_you_mean
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.batch import Batch, joined
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import RECEIVED, Column, FieldReader, Kind, columns_of, objects
from rpud_sim.messages.errors import BagError, BagFormatError

if TYPE_CHECKING:
    import pandas

# Sizes of decoded messages, as ``Shape.most`` bounds them [bytes].
BATCH_SIZE = 64 * 2**20  # greatest size of a batch
ARRAY_SIZE = 4 * 2**20  # size of messages copied into arrays together: a cache holds them
TOTAL_SIZE = 256 * 2**20  # size of all topics' messages that wait to become batches

_MAX_DURATION = 7e9  # s; with any stamp the times are 64-bit nanoseconds

_RECEIVED = tuple(Column(name, Kind.TIME, np.dtype(np.int64)) for name in RECEIVED)
# Column with the exact time of each row.
TIME = Column("time", Kind.TIME, np.dtype(np.int64), description="of the sample or segment")
# Columns from which the time of a row is calculated, by type.
_TIME_COLUMNS = {
    "rpud_msgs/msg/Trajectory": {"origin", "sequence", "start_seconds", "start_fraction"},
    "rpud_msgs/msg/Waveform": {"header.stamp", "sample_period", "sequence"},
}


@dataclass(frozen=True)
class RowTable:
    """Rows of consecutive messages of one topic, as columns."""

    topic: str  # its name
    # values of each column, by its name; ``Kind`` describes their form
    columns: Mapping[str, np.ndarray]
    message_count: int  # number of messages that the rows come from

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.columns["log_time"])


class Table:
    """Conversion of one topic's messages to rows.

    Each message becomes a row. In blocks each sample or segment becomes a row, and the first column
    is its exact ``time``.
    """

    def __init__(self, summary: TopicSummary) -> None:
        self._name = summary.topic.name
        if not summary.one_type:
            raise BagFormatError("its messages are of several types or definitions")
        if summary.topic.serialization_format != "cdr":
            raise BagFormatError(
                f"its messages are {summary.topic.serialization_format!r:.40}; only 'cdr' is read"
            )
        if summary.definition is None:
            raise BagFormatError(summary.undefined)
        self.codec, self._fields = compiled(summary.topic.type, summary.definition)
        self._reader = FieldReader(self.codec, self._fields)
        # Messages of some types are blocks of rows.
        needed = _TIME_COLUMNS.get(summary.topic.type)
        simple = all(each.kind not in (Kind.ARRAY, Kind.NESTED) for each in self._fields)
        names = {each.name for each in self._fields}
        self._has_rows = simple and needed is not None and needed <= names

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns of the table; of rows ``TIME``, and numbers instead of sequences."""
        columns = (*_RECEIVED, *self._fields)
        if not self._has_rows:
            return columns
        rows = (replace(e, kind=Kind.NUMBER) if e.kind is Kind.SEQUENCE else e for e in columns)
        return (TIME, *rows)

    def parts(self, batch: Batch, limit: int) -> Iterator[tuple[Batch, int]]:
        """Yield a batch in parts of a size, with their sizes; what fills less than two is whole."""
        sizes = self.codec.shape.most(batch.sizes)
        ends = np.cumsum(sizes)
        if ends[-1] < 2 * limit:
            yield batch, int(ends[-1])
            return
        cuts = np.searchsorted(ends, np.arange(limit, ends[-1], limit)) + 1
        for start, end in pairwise(np.unique([0, *cuts, len(batch)]).tolist()):
            yield batch.part(slice(start, end)), int(sizes[start:end].sum())

    def batch(self, batch: Batch, leave_out: Callable[[str], object] | None = None) -> RowTable:
        """Return the rows of messages.

        ``leave_out`` is called with the reason for each message that is not of the type, which is
        then skipped; None for an error.
        """
        fields = self._reader.read(batch)
        for _, reason in fields.errors:
            if leave_out is None:
                raise BagFormatError(reason)
            leave_out(reason)
        if fields.errors:
            batch = batch.part(fields.rows)
        try:
            return self._batch(batch, fields.columns)
        except BagFormatError:  # a block has rows without a time, or too few values
            if leave_out is None:
                raise
        fitting = []
        for row in range(len(batch)):
            try:
                self.batch(batch.part(slice(row, row + 1)))
            except BagFormatError as error:
                leave_out(str(error))
            else:
                fitting.append(row)
        return self.batch(batch.part(np.array(fitting, np.intp)))

    def empty(self) -> RowTable:
        return self.batch(Batch(self._name, np.empty(0, np.int64)))

    def _batch(self, batch: Batch, columns: Mapping[str, np.ndarray | Sequences]) -> RowTable:
        received = {"log_time": batch.log_times, "publish_time": batch.publish_times}
        if self._has_rows:
            values = to_rows((*_RECEIVED, *self._fields), {**received, **columns})
        else:
            values = received | {
                name: objects(each.rows()) if isinstance(each, Sequences) else each
                for name, each in columns.items()
            }
        return RowTable(self._name, values, len(batch))


@lru_cache(maxsize=256)  # topics of one type share it
def compiled(type_name: str, definition: str) -> tuple[Codec, tuple[Column, ...]]:
    """Return the codec of a type, and the columns of its fields."""
    codec = Codec(type_name, definition)
    return codec, columns_of(codec, definition)


class Tables:
    """Tables of a bag's topics, of the bag at ``path``; ``errors`` is by damaged topic."""

    def __init__(
        self,
        path: Path,
        summaries: Iterable[TopicSummary],
        errors: Mapping[str, BagFormatError],
    ) -> None:
        self._path, self._errors = path, errors
        self._known = {summary.topic.name: summary for summary in summaries}
        self._opened: dict[str, Table | BagFormatError] = {}

    @cached_property
    def left_out(self) -> dict[str, str]:
        """Reasons why topics have no table, by their names."""
        found = {name: self._open(name) for name in self._known}
        return {name: str(each) for name, each in found.items() if not isinstance(each, Table)}

    def choose(self, topics: Collection[str] | None) -> dict[str, Table]:
        """Return the tables of topics by their names; None for all that have one."""
        if topics is None:
            topics = [name for name in self._known if name not in self.left_out]
        return {name: self.table(name) for name in topics}

    def table(self, name: str) -> Table:
        if name in self._errors:
            raise self._errors[name]
        if name not in self._known:
            hint = did_you_mean(name, self._known)
            raise BagError(f"{self._path} holds no topic {name!r:.80}{hint}")
        found = self._open(name)
        if isinstance(found, BagFormatError):
            raise BagFormatError(f"{self._path}: {name:.200} cannot be a table: {found}") from found
        return found

    def _open(self, name: str) -> Table | BagFormatError:
        if name not in self._opened:
            try:
                self._opened[name] = Table(self._known[name])
            except BagFormatError as error:
                self._opened[name] = error
        return self._opened[name]

    def batches(
        self,
        tables: Mapping[str, Table],
        batches: Iterable[Batch],
        leave_out: Callable[[str, str], object] | None = None,
        limit: int | None = None,
    ) -> Iterator[RowTable]:
        """Yield the rows of messages, in their order within each topic.

        ``leave_out`` is called with the topic and the reason for each message that is not of its
        topic's type, which is then skipped; None for an error. ``limit`` is the size of a batch.
        """
        limit = limit or BATCH_SIZE
        waiting: dict[str, list[Batch]] = {name: [] for name in tables}
        sizes = dict.fromkeys(tables, 0)  # size of waiting messages
        total = 0

        def decoded(name: str) -> RowTable:
            nonlocal total
            total -= sizes[name]
            batch, waiting[name], sizes[name] = joined(waiting[name]), [], 0
            try:
                return tables[name].batch(batch, leave_out and partial(leave_out, name))
            except BagFormatError as error:
                raise BagFormatError(f"{self._path}: {name:.200}: {error}") from error

        for whole in batches:
            name = whole.topic
            for part, size in tables[name].parts(whole, limit):
                # A batch of one part is made immediately. What waits must not keep the chunk.
                alone = size >= limit and not waiting[name]
                waiting[name].append(part if alone else part.packed())
                sizes[name] += size
                total += size
                if sizes[name] >= limit:
                    yield decoded(name)
                elif total >= TOTAL_SIZE:
                    yield decoded(max(sizes, key=sizes.__getitem__))
        yield from (decoded(name) for name in tables if waiting[name])

    def arrays(
        self, tables: Mapping[str, Table], batches: Iterable[Batch]
    ) -> dict[str, dict[str, np.ndarray]]:
        """Return the columns of each topic, from all its messages."""
        parts = {name: [dict(table.empty().columns)] for name, table in tables.items()}
        for batch in self.batches(tables, batches, limit=ARRAY_SIZE):
            parts[batch.topic].append(dict(batch.columns))
        # Column by column, and each is gone from its parts: they and the whole take little more
        # memory.
        return {
            name: {
                column.name: np.concatenate([part.pop(column.name) for part in parts[name]])
                for column in table.columns
            }
            for name, table in tables.items()
        }


def with_datetimes(table: Table, columns: Mapping[str, np.ndarray]) -> dict[str, np.ndarray]:
    """Return columns whose integer nanoseconds are times and durations of NumPy."""
    dtypes = {Kind.TIME: "datetime64[ns]", Kind.DURATION: "timedelta64[ns]"}
    return {
        each.name: columns[each.name].astype(dtypes.get(each.kind, columns[each.name].dtype))
        for each in table.columns
    }


def to_frame(
    columns: Mapping[str, np.ndarray], units: Mapping[str, str], index: str
) -> pandas.DataFrame:
    """Return a pandas frame with a column as index; ``attrs["units"]`` has the units."""
    pandas = import_extra("pandas", "a frame", "pandas")
    if index not in columns:
        raise BagError(f"index = {index!r:.80} is not a column{did_you_mean(index, columns)}")
    series = {n: objects([*each]) if each.ndim > 1 else each for n, each in columns.items()}
    frame = pandas.DataFrame(series).set_index(index)
    frame.attrs["units"] = dict(units)
    return frame


def to_rows(
    columns: tuple[Column, ...], blocks: Mapping[str, np.ndarray | Sequences]
) -> dict[str, np.ndarray]:
    """Return the values of ``Table.columns``, one for each row, from the values of blocks.

    Each row has the values that its block has once. ``sequence`` is the number of the row.
    """
    sequences = {name: each for name, each in blocks.items() if isinstance(each, Sequences)}
    single = {name: each for name, each in blocks.items() if not isinstance(each, Sequences)}
    first = next(iter(sequences))
    counts = sequences[first].counts
    for name, each in sequences.items():
        for row in np.flatnonzero(counts != each.counts):
            raise BagFormatError(f"{name} has {each.counts[row]} values, and {first} {counts[row]}")
    rows = {
        column.name: sequences[column.name].values
        if column.name in sequences
        else np.repeat(single[column.name], counts)
        for column in columns
    }
    numbers = np.arange(len(rows["sequence"])) - np.repeat(np.cumsum(counts) - counts, counts)
    if "sample_period" in rows:
        time = _sample_times(single, counts)
    else:
        time = rows["origin"] + _starts(rows["start_seconds"], rows["start_fraction"])
    rows["sequence"] = rows["sequence"] + numbers.astype(np.uint64)
    return {TIME.name: time, **rows}


def _starts(seconds: np.ndarray, fractions: np.ndarray) -> np.ndarray:
    """Return the starts of segments since simulation time zero [ns]."""
    fits = (seconds >= 0) & (seconds < _MAX_DURATION) & (fractions >= 0.0) & (fractions <= 1.0)
    for row in np.flatnonzero(~fits):
        raise BagFormatError(f"a segment starts at {seconds[row]} s + {fractions[row]:g} s")
    return seconds * SECOND + np.rint(fractions * SECOND).astype(np.int64)


def _sample_times(blocks: Mapping[str, np.ndarray], counts: np.ndarray) -> np.ndarray:
    stamps, periods, firsts = blocks["header.stamp"], blocks["sample_period"], blocks["sequence"]
    offsets: list[np.ndarray] = [np.empty(0, np.int64)]
    # Blocks of one rate together: the offsets of a hundred blocks take as long as one block's.
    edges = np.flatnonzero(np.diff(periods, prepend=np.nan, append=np.nan))
    for start, end in pairwise(edges.tolist()):
        offsets.append(_offsets(float(periods[start]), firsts[start:end], counts[start:end]))
    return np.repeat(stamps, counts) + np.concatenate(offsets)


def _offsets(period: float, firsts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the times of samples after the first of their block [ns].

    At a whole rate each time is rounded as the first one is. Otherwise the times of samples
    would depend on how they are divided into blocks. ``period`` is in s.
    """
    most = int(counts.max())
    if not (math.isfinite(period) and period > 0.0 and period * most < _MAX_DURATION):
        count = int(counts[0])
        raise BagFormatError(
            f"sample_period = {period:g} s is not the time between {count} samples"
        )
    numbers = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rate = round(1.0 / period) if period > 1.0 / SECOND else 0
    if rate and abs(rate * period - 1.0) < 1e-12:
        starts = np.repeat((firsts % np.uint64(rate)).astype(np.int64), counts)
        return (starts + numbers) * SECOND // rate - starts * SECOND // rate
    return np.rint(numbers * (period * SECOND)).astype(np.int64)
