"""Tables of NumPy arrays from the messages of a topic, in pieces of bounded size or whole."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.bag.blocks import holds_rows, row_columns, to_rows
from rpud_sim.bag.cdr import Codec, definition_size
from rpud_sim.bag.columns import RECEIVED, Column, Kind, columns_of, objects
from rpud_sim.bag.errors import BagError, BagFormatError
from rpud_sim.bag.messages import Message
from rpud_sim.bag.topic_summary import TopicSummary
from rpud_sim.foundation.quantities import suggestion

if TYPE_CHECKING:
    import pandas

BATCH_SIZE = 8 * 2**20
"""Size of a topic's messages that become one batch [bytes]."""

TOTAL_SIZE = 64 * 2**20
"""Greatest size of all topics' messages that wait to become batches [bytes]."""

DECODED_SIZE = 64 * 2**20
"""Greatest size of a batch's decoded messages, unless there is a single one [bytes]."""

DEFINITIONS_LIMIT = 256 * 2**10
"""Greatest definitions of all types of a bag together, without comments [characters]."""

_DEFINITION_OVERHEAD = 64  # characters that take as long to compile as the smallest type
_OVERHEAD = 256  # bytes that a message takes in memory in addition to its data
_NAMES_SHOWN = 30

_RECEIVED = tuple(Column(name, Kind.TIME, np.dtype(np.int64)) for name in RECEIVED)


@dataclass(frozen=True)
class Batch:
    """Consecutive rows of one topic.

    Attributes:
        topic: its name.
        columns: values of each column, by its name; ``Kind`` describes their form.
        message_count: number of messages that the rows come from.
    """

    topic: str
    columns: Mapping[str, np.ndarray]
    message_count: int

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.columns["log_time"])


class Table:
    """Conversion of one topic's messages to rows.

    Each message becomes a row. In blocks each sample or segment becomes a row, and the first column
    is its exact ``time``.

    Args:
        summary: of the topic.

    Raises:
        BagFormatError: if messages of its type cannot be rows.
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
        self._codec, self._fields = _compiled(summary.topic.type, summary.definition)
        self._blocks = holds_rows(summary.topic.type, self._fields)

    @property
    def columns(self) -> tuple[Column, ...]:
        """Columns in their order."""
        columns = (*_RECEIVED, *self._fields)
        return row_columns(columns) if self._blocks else columns

    def decoded_size(self, message: Message) -> int:
        """Return the greatest memory of a decoded message [bytes]."""
        return self._codec.decoded_size(len(message.data))

    def batch(self, messages: Sequence[Message]) -> Batch:
        """Return the rows of messages.

        Raises:
            BagFormatError: if a message is not of the type.
        """
        decoded = [self._codec.decode(message.data) for message in messages]
        try:
            values = {
                column.name: np.array([getattr(message, column.name) for message in messages], "i8")
                for column in _RECEIVED
            }
            values |= {column.name: column.values(decoded) for column in self._fields}
        except (OverflowError, TypeError, ValueError) as error:
            raise BagFormatError(f"a message does not fit its columns: {error!r:.200}") from error
        if self._blocks:
            values = to_rows((*_RECEIVED, *self._fields), values)
        return Batch(self._name, values, len(messages))


@lru_cache(maxsize=256)  # topics of one type share it
def _compiled(type_name: str, definition: str) -> tuple[Codec, tuple[Column, ...]]:
    codec = Codec(type_name, definition)
    return codec, columns_of(codec, definition)


def open_tables(
    path: Path,
    summaries: Iterable[TopicSummary],
    errors: Mapping[str, BagFormatError],
    topics: Collection[str] | None,
) -> tuple[dict[str, Table], dict[str, str]]:
    """Return the tables of topics by their names, and the reasons why others have none.

    Args:
        path: of the bag.
        summaries: of the bag's readable topics.
        errors: of damaged topics, by their names.
        topics: those that must have a table; None for all that can.

    Raises:
        BagError: if one of ``topics`` is not in the bag.
        BagFormatError: if one of ``topics`` is damaged or cannot be a table.
    """
    known = {summary.topic.name: summary for summary in summaries}
    tables, left_out = {}, {}
    compiled: set[tuple[str, str | None]] = set()
    size = 0
    for name in dict.fromkeys(known if topics is None else topics):
        if name in errors:
            raise errors[name]
        if name not in known:
            hint = suggestion(name, known)
            raise BagError(f"{path} holds no topic {name!r:.80}; it holds {_listed(known)}{hint}")
        kind = (known[name].topic.type, known[name].definition)
        if kind not in compiled:
            compiled.add(kind)
            size += definition_size(kind[1] or "") + _DEFINITION_OVERHEAD
        try:
            if size > DEFINITIONS_LIMIT:
                raise BagFormatError(
                    f"the definitions of the bag's types have more than {DEFINITIONS_LIMIT} "
                    "characters together, too many to compile"
                )
            tables[name] = Table(known[name])
        except BagFormatError as error:
            if topics is not None:
                raise BagFormatError(f"{path}: {name} cannot be a table: {error}") from error
            left_out[name] = str(error)
    return tables, left_out


def batches(
    path: Path,
    messages: Iterable[Message],
    tables: Mapping[str, Table],
    end: int | None = None,
    leave_out: Callable[[str, str], object] | None = None,
) -> Iterator[Batch]:
    """Yield the rows of messages, in their order within each topic.

    Args:
        path: of the bag.
        messages: of the topics in ``tables``.
        tables: by the names of topics.
        end: log time of the first message that does not count [ns]; None for no end.
        leave_out: called with the topic and the reason for each message that is not of its topic's
            type, which is then skipped; None for an error.

    Raises:
        BagFormatError: if a message is not of its topic's type.
    """
    waiting: dict[str, list[Message]] = {name: [] for name in tables}
    sizes = dict.fromkeys(tables, 0)
    decoded = dict.fromkeys(tables, 0)
    total = 0

    def batch(name: str) -> Batch:
        nonlocal total
        rows, waiting[name] = waiting[name], []
        total -= sizes[name]
        sizes[name] = decoded[name] = 0
        try:
            return tables[name].batch(rows)
        except BagFormatError as error:
            if leave_out is None:
                raise BagFormatError(f"{path}: {name}: {error}") from error
        return tables[name].batch([*_readable(tables[name], rows, partial(leave_out, name))])

    for message in messages:
        if end is not None and message.log_time >= end:
            break
        name = message.topic
        size = len(message.data) + _OVERHEAD
        waiting[name].append(message)
        sizes[name] += size
        decoded[name] += tables[name].decoded_size(message)
        total += size
        if sizes[name] >= BATCH_SIZE or decoded[name] >= DECODED_SIZE:
            yield batch(name)
        elif total >= TOTAL_SIZE:
            yield batch(max(sizes, key=sizes.__getitem__))
    for name, rest in waiting.items():
        if rest:
            yield batch(name)


def _readable(
    table: Table, messages: Iterable[Message], leave_out: Callable[[str], object]
) -> Iterator[Message]:
    for message in messages:
        try:
            table.batch([message])
        except BagFormatError as error:
            leave_out(str(error))
        else:
            yield message


def joined(table: Table, pieces: Iterable[Batch]) -> dict[str, np.ndarray]:
    """Return the columns of all batches of one table together."""
    parts = [table.batch([]), *pieces]
    return {
        column.name: np.concatenate([part.columns[column.name] for part in parts])
        for column in table.columns
    }


def to_frame(table: Table, columns: Mapping[str, np.ndarray]) -> pandas.DataFrame:
    """Return a pandas frame with the first column as index.

    Raises:
        BagError: if pandas is not installed.
    """
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


def _listed(names: Iterable[str]) -> str:
    names = sorted(names)
    more = f" and {len(names) - _NAMES_SHOWN} more" if len(names) > _NAMES_SHOWN else ""
    return ", ".join(f"{name:.80}" for name in names[:_NAMES_SHOWN]) + more or "none"
