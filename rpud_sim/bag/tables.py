"""Tables of NumPy arrays from the messages of a topic, in batches of bounded size or whole."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property, lru_cache, partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.bag.batches import SerializedBatch
from rpud_sim.bag.batches import joined as joined_batches
from rpud_sim.bag.cdr import Codec, Shape
from rpud_sim.bag.columns import (
    RECEIVED,
    Column,
    FieldReader,
    Kind,
    columns_of,
    holds_rows,
    objects,
    row_columns,
    to_rows,
)
from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.metadata import TopicSummary
from rpud_sim.foundation.quantities import suggestion
from rpud_sim.foundation.values import Ragged

if TYPE_CHECKING:
    import pandas

BATCH_SIZE = 8 * 2**20  # size of a topic's messages that become one batch [bytes]
# Size of messages that are copied into the arrays together [bytes]: a processor's cache holds it. A
# topic that fills half of a chunk is read from the chunk without a copy of its messages.
PART_SIZE = 2**19
TOTAL_SIZE = 64 * 2**20  # greatest size of all topics' messages that wait to become batches [bytes]

# Greatest size of a batch's decoded messages, unless there is a single one [bytes].
DECODED_SIZE = 64 * 2**20

# Greatest definitions of all types of a bag together, without comments [characters].
DEFINITIONS_LIMIT = 256 * 2**10

_COMMENT = re.compile(r"#.*")
_DEFINITION_OVERHEAD = 64  # characters that take as long to compile as the smallest type
_OVERHEAD = 256  # bytes that a message takes in memory in addition to its data
_NAMES_SHOWN = 30

_RECEIVED = tuple(Column(name, Kind.TIME, np.dtype(np.int64)) for name in RECEIVED)


@dataclass(frozen=True)
class Batch:
    """Consecutive rows of one topic."""

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
        if len(summary.kinds) > 1:
            raise BagFormatError("its messages are of several types or definitions")
        if summary.topic.serialization_format != "cdr":
            raise BagFormatError(
                f"its messages are {summary.topic.serialization_format!r:.40}; only 'cdr' is read"
            )
        if summary.definition is None:
            raise BagFormatError("the bag does not hold the definition of its type")
        self.codec, self._fields = compiled(summary.topic.type, summary.definition)
        self._reader = FieldReader(self.codec, self._fields)
        self._blocks = holds_rows(summary.topic.type, self._fields)

    @property
    def columns(self) -> tuple[Column, ...]:
        columns = (*_RECEIVED, *self._fields)
        return row_columns(columns) if self._blocks else columns

    def batch(
        self, block: SerializedBatch, leave_out: Callable[[str], object] | None = None
    ) -> Batch:
        """Return the rows of messages.

        ``leave_out`` is called with the reason for each message that is not of the type, which is
        then skipped; None for an error.
        """
        fields = self._reader.read(block)
        for _, reason in fields.errors:
            if leave_out is None:
                raise BagFormatError(reason)
            leave_out(reason)
        if fields.errors:
            block = block.part(fields.rows)
        try:
            return self._batch(block, fields.columns)
        except BagFormatError:  # of a block whose rows have no time, or too few values
            if leave_out is None:
                raise
        kept = []
        for row in range(len(block)):
            try:
                self.batch(block.part(slice(row, row + 1)))
            except BagFormatError as error:
                leave_out(str(error))
            else:
                kept.append(row)
        return self.batch(block.part(np.array(kept, np.intp)))

    def empty(self) -> Batch:
        none, data = np.empty(0, np.int64), np.empty(0, np.uint8)
        return self.batch(SerializedBatch(self._name, none, none, data, none, none))

    def _batch(self, block: SerializedBatch, columns: Mapping[str, np.ndarray | Ragged]) -> Batch:
        received = {"log_time": block.log_times, "publish_time": block.publish_times}
        if self._blocks:
            values = to_rows((*_RECEIVED, *self._fields), {**received, **columns})
        else:
            values = received | {
                name: objects(each.rows()) if isinstance(each, Ragged) else each
                for name, each in columns.items()
            }
        return Batch(self._name, values, len(block))


@lru_cache(maxsize=256)  # topics of one type share it
def compiled(type_name: str, definition: str) -> tuple[Codec, tuple[Column, ...]]:
    """Return the codec of a type, and the columns of its fields."""
    codec = Codec(type_name, definition)
    return codec, columns_of(codec, definition)


class Tables:
    """Tables of the topics of the bag at ``path``; ``errors`` are those of damaged topics."""

    def __init__(
        self,
        path: Path,
        summaries: Iterable[TopicSummary],
        errors: Mapping[str, BagFormatError],
    ) -> None:
        self._path, self._errors = path, errors
        self._known = {summary.topic.name: summary for summary in summaries}
        self._opened: dict[str, Table | BagFormatError] = {}
        self._kinds: set[tuple[str, str | None]] = set()  # types and definitions of these
        self._size = 0  # characters of the definitions

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
            listed = _listed(self._known) + suggestion(name, self._known)
            raise BagError(f"{self._path} holds no topic {name!r:.80}; it holds {listed}")
        found = self._open(name)
        if isinstance(found, BagFormatError):
            raise BagFormatError(f"{self._path}: {name} cannot be a table: {found}") from found
        return found

    def _open(self, name: str) -> Table | BagFormatError:
        if name not in self._opened:
            summary = self._known[name]
            kind = (summary.topic.type, summary.definition)
            if kind not in self._kinds:
                self._kinds.add(kind)
                self._size += len(_COMMENT.sub("", summary.definition or "")) + _DEFINITION_OVERHEAD
            try:
                if self._size > DEFINITIONS_LIMIT:
                    raise BagFormatError(
                        f"the definitions of the bag's types have more than {DEFINITIONS_LIMIT} "
                        "characters together, too many to compile"
                    )
                self._opened[name] = Table(summary)
            except BagFormatError as error:
                self._opened[name] = error
        return self._opened[name]

    def batches(
        self,
        tables: Mapping[str, Table],
        blocks: Iterable[SerializedBatch],
        leave_out: Callable[[str, str], object] | None = None,
        batch_size: int | None = None,
    ) -> Iterator[Batch]:
        """Yield the rows of messages, in their order within each topic.

        ``leave_out`` is called with the topic and the reason for each message that is not of its
        topic's type, which is then skipped; None for an error. ``batch_size`` is in bytes; None for
        ``BATCH_SIZE``.
        """
        limit = batch_size or BATCH_SIZE
        waiting: dict[str, list[SerializedBatch]] = {name: [] for name in tables}
        shares = dict.fromkeys(tables, 0.0)  # of a batch, that wait
        total = 0

        def batch(name: str) -> Batch:
            nonlocal total
            block, waiting[name] = joined_batches(waiting[name]), []
            total -= _memory(block)
            shares[name] = 0.0
            try:
                return tables[name].batch(block, leave_out and partial(leave_out, name))
            except BagFormatError as error:
                raise BagFormatError(f"{self._path}: {name}: {error}") from error

        for whole in blocks:
            name = whole.topic
            for block, share in _divided(whole, tables[name].codec.shape, limit):
                # A batch of one block is made at once. What waits must not keep the chunk.
                alone = share >= 1.0 and not waiting[name]
                waiting[name].append(block if alone else block.packed())
                shares[name] += share
                total += _memory(block)
                if shares[name] >= 1.0:
                    yield batch(name)
                elif total >= TOTAL_SIZE:
                    yield batch(max(shares, key=shares.__getitem__))
        yield from (batch(name) for name in tables if waiting[name])

    def arrays(
        self, tables: Mapping[str, Table], blocks: Iterable[SerializedBatch]
    ) -> dict[str, dict[str, np.ndarray]]:
        """Return the columns of each topic, from all its messages."""
        parts = {name: [dict(table.empty().columns)] for name, table in tables.items()}
        for piece in self.batches(tables, blocks, batch_size=PART_SIZE):
            parts[piece.topic].append(dict(piece.columns))
        # Column by column, and each is gone from its parts: they and the whole take little more
        # memory.
        return {
            name: {
                column.name: np.concatenate([part.pop(column.name) for part in parts[name]])
                for column in table.columns
            }
            for name, table in tables.items()
        }


def _memory(block: SerializedBatch) -> int:
    return int(block.sizes.sum()) + _OVERHEAD * len(block)


def _divided(
    block: SerializedBatch, kind: Shape, limit: int
) -> Iterator[tuple[SerializedBatch, float]]:
    """Yield a block in parts, and the share of a batch that each fills; ``limit`` is in bytes.

    What fills less than two batches stays whole.
    """
    decoded = kind.most(int(block.sizes.sum())) + (len(block) - 1) * kind.most(0)
    share = max(_memory(block) / limit, decoded / DECODED_SIZE)
    if share < 2.0:
        yield block, share
        return
    shares = np.maximum((block.sizes + _OVERHEAD) / limit, kind.most(block.sizes) / DECODED_SIZE)
    sums = np.cumsum(shares)
    cuts = np.searchsorted(sums, np.arange(1.0, sums[-1])) + 1
    for start, end in pairwise(np.unique([0, *cuts, len(block)]).tolist()):
        yield block.part(slice(start, end)), float(shares[start:end].sum())


def _listed(names: Iterable[str]) -> str:
    names = sorted(names)
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return ", ".join(f"{name:.80}" for name in names[:_NAMES_SHOWN]) + more or "none"


def to_frame(table: Table, columns: Mapping[str, np.ndarray]) -> pandas.DataFrame:
    """Return a pandas frame with the first column as index."""
    try:
        import pandas
    except ModuleNotFoundError as error:
        if error.name != "pandas":
            raise
        raise BagError("a frame needs the Python module pandas: pip install pandas") from error
    index = table.columns[0].name
    dtypes = {Kind.TIME: "datetime64[ns]", Kind.DURATION: "timedelta64[ns]"}
    series = {
        column.name: objects([*columns[column.name]])
        if column.kind is Kind.ARRAY
        else columns[column.name].astype(dtypes.get(column.kind), copy=False)
        if column.kind in dtypes
        else columns[column.name]
        for column in table.columns
    }
    return pandas.DataFrame(series).set_index(index)
