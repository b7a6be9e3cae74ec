"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.budget import DECODED_LIMIT
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Column, Kind, Sequences, objects
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.field_walk import HEAD, Field, FieldWalk, Whole, taken
from rpud_sim.bag.message_block import MessageBlock, gathered
from rpud_sim.foundation.time import SECOND

_KNOWN_TEXTS = 1000
_TEXT_ALIGNMENT = 4  # bytes
_ORDERS = {0: ">", 256: "<"}  # by the first two bytes of a message


@dataclass(frozen=True)
class FieldValues:
    """Values of fields."""

    rows: np.ndarray  # places of the readable messages in the block, in their order, shape (n,)
    # values of each column, by its name, in the form of ``Kind``; ``Sequences`` for sequences
    # of numbers
    columns: dict[str, np.ndarray | Sequences]
    errors: tuple[tuple[int, str], ...]  # place of each other message, and the reason

    def array(self, name: str) -> np.ndarray:
        """Return the values of a column that holds no sequences."""
        values = self.columns[name]
        assert not isinstance(values, Sequences)
        return values


class FieldReader:
    """Reader of some columns of one type.

    One walk finds the places of all messages' fields. Of a list of texts, equal ones are decoded
    once. What the walk cannot read is decoded message by message: lists of messages, a byte order
    other than that of the first message, and messages that are not of the type, for the reason.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)
        self._nested = any(
            column.kind is Kind.NESTED and not _holds_texts(codec, column.attribute)
            for column in columns
        )
        self._wanted = {
            attribute
            for column in columns
            for attribute in (
                [f"{column.attribute}.sec", f"{column.attribute}.nanosec"]
                if column.kind in (Kind.TIME, Kind.DURATION)
                else [column.attribute]
            )
        }
        self._largest = codec.largest_size(DECODED_LIMIT)

    def read(self, block: MessageBlock) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        rows = np.empty(0, np.intp)
        if not self._nested:
            rows, values = self._walked(block)
            if len(rows) == len(block):
                return FieldValues(rows, values, ())
        others = np.setdiff1d(np.arange(len(block)), rows)
        decoded, errors = self._decoded(block, others)
        others = np.setdiff1d(others, [row for row, _ in errors])
        if not len(rows):
            return FieldValues(others, decoded, errors)
        order = np.argsort(np.concatenate([rows, others]), kind="stable")
        joined = {name: _together(values[name], decoded[name], order) for name in values}
        return FieldValues(np.concatenate([rows, others])[order], joined, errors)

    def _walked(self, block: MessageBlock) -> tuple[np.ndarray, dict[str, np.ndarray | Sequences]]:
        readable = (block.sizes >= HEAD) & (block.sizes <= self._largest)
        order = ""
        if readable.any():
            heads = np.zeros(len(block), np.uint16)
            heads[readable] = taken(block.data, block.starts[readable], np.dtype("<u2"))
            head = int(heads[np.argmax(readable)])
            order = _ORDERS.get(head, "")
            readable &= heads == head
        rows = np.flatnonzero(readable) if order else np.empty(0, np.intp)
        while True:
            starts, sizes = block.starts[rows], block.sizes[rows]
            walk = FieldWalk(self._codec, self._wanted, block.data, starts, sizes, order or "<")
            if walk.bad.any():
                rows = rows[~walk.bad]
                continue
            values = _Values(block.data, starts, sizes, walk.fields, self._codec)
            try:
                return rows, {column.name: values.of(column) for column in self._columns}
            except _UnreadableError as error:
                rows = np.delete(rows, error.rows)

    def _decoded(
        self, block: MessageBlock, rows: np.ndarray
    ) -> tuple[dict[str, np.ndarray | Sequences], tuple[tuple[int, str], ...]]:
        messages, errors = [], []
        for row in rows.tolist():
            try:
                messages.append(self._codec.decode(block.message(row)))
            except BagFormatError as error:
                errors.append((row, str(error)))
        return {column.name: column.values(messages) for column in self._columns}, tuple(errors)


class _UnreadableError(Exception):
    """Messages with a text that is none; ``rows`` are their places."""

    def __init__(self, rows: Sequence[int]) -> None:
        super().__init__(rows)
        self.rows = rows


class _Values:
    def __init__(
        self,
        data: np.ndarray,
        starts: np.ndarray,
        sizes: np.ndarray,
        fields: dict[str, Field],
        codec: Codec,
    ) -> None:
        self._data, self._starts, self._sizes = data, starts, sizes
        self._fields, self._codec = fields, codec

    def of(self, column: Column) -> np.ndarray | Sequences:
        read: dict[Kind, Callable[[Column], np.ndarray | Sequences]] = {
            Kind.NUMBER: self._number,
            Kind.TIME: self._time,
            Kind.DURATION: self._time,
            Kind.TEXT: self._text,
            Kind.ARRAY: self._array,
            Kind.SEQUENCE: self._sequence,
            Kind.NESTED: self._texts,
        }
        return read[column.kind](column)

    def _number(self, column: Column) -> np.ndarray:
        field = self._fields[column.attribute]
        return _native(self._taken(field), column.dtype)

    def _time(self, column: Column) -> np.ndarray:
        seconds = self._taken(self._fields[f"{column.attribute}.sec"]).astype(np.int64)
        return seconds * SECOND + self._taken(self._fields[f"{column.attribute}.nanosec"])

    def _array(self, column: Column) -> np.ndarray:
        return self._numbers(column).reshape(len(self._starts), column.length)

    def _sequence(self, column: Column) -> Sequences:
        return Sequences(self._numbers(column), self._counts(self._fields[column.attribute]))

    def _numbers(self, column: Column) -> np.ndarray:
        field = self._fields[column.attribute]
        assert field.dtype is not None
        sizes = self._counts(field) * field.dtype.itemsize
        found = gathered(self._data, self._starts + field.place, sizes)
        return _native(found.view(field.dtype), column.dtype)

    def _text(self, column: Column) -> np.ndarray:
        field = self._fields[column.attribute]
        counts = self._counts(field)
        data = gathered(self._data, self._starts + field.place, counts)
        content, ends = data.tobytes(), np.cumsum(counts).tolist()
        if len(ends) and content[: ends[0]] * len(ends) == content and (counts == counts[0]).all():
            content, ends = content[: ends[0]], ends[:1]  # a frame's name is always the same
        texts = np.empty(len(counts), object)
        known: dict[bytes, str | None] = {}
        bad: list[int] = []
        start = 0
        for row, end in enumerate(ends):
            part = content[start:end]
            start = end
            if part not in known:
                if len(known) >= _KNOWN_TEXTS:
                    known.clear()
                known[part] = _decoded(part)
            texts[row] = known[part]
            if texts[row] is None:
                bad.append(row)
        texts[len(ends) :] = texts[0] if len(counts) else None
        if bad:
            raise _UnreadableError(bad if len(ends) == len(counts) else range(len(counts)))
        return texts

    def _texts(self, column: Column) -> np.ndarray:
        """Return lists of texts; padding between texts depends on the place of the first."""
        field = self._fields[column.attribute]
        counts = self._counts(field)
        content = gathered(self._data, self._starts + field.place, counts).tobytes()
        shifts = np.broadcast_to(np.asarray(field.place) % _TEXT_ALIGNMENT, counts.shape).tolist()
        found = np.empty(len(counts), object)
        known: dict[tuple[bytes, int], list[str] | None] = {}
        bad: list[int] = []
        start = 0
        for row, end in enumerate(np.cumsum(counts).tolist()):
            key = content[start:end], shifts[row]
            start = end
            if key not in known:
                if len(known) >= _KNOWN_TEXTS:
                    known.clear()
                known[key] = self._decoded_texts(column, row)
            texts = known[key]
            if texts is None:
                bad.append(row)
            else:
                found[row] = texts.copy()
        if bad:
            raise _UnreadableError(bad)
        return found

    def _decoded_texts(self, column: Column, row: int) -> list[str] | None:
        start = int(self._starts[row])
        try:
            message = self._codec.decode(self._data[start : start + self._sizes[row]].tobytes())
        except BagFormatError:
            return None
        return list(attrgetter(column.attribute)(message))

    def _taken(self, field: Field) -> np.ndarray:
        assert field.dtype is not None
        return taken(self._data, self._starts + field.place, field.dtype)

    def _counts(self, field: Field) -> np.ndarray:
        count: Whole | None = field.count
        return np.full(self._starts.shape, count, np.int64)


def _holds_texts(codec: Codec, attribute: str) -> bool:
    type_name = codec.type_name
    for part in attribute.split("."):
        node, described = {name: kind for _, name, kind in codec.fields(type_name)}[part]
        type_name = described if node == Nodetype.NAME else type_name
    return node in (Nodetype.ARRAY, Nodetype.SEQUENCE) and described[0][0] == Nodetype.BASE


def _decoded(data: bytes) -> str | None:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return None


def _native(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    if dtype.kind == "b":
        return values != 0
    return values.astype(dtype, copy=False)


def _together(
    first: np.ndarray | Sequences, second: np.ndarray | Sequences, order: np.ndarray
) -> np.ndarray | Sequences:
    if isinstance(first, Sequences) and isinstance(second, Sequences):
        rows = objects([*first.rows(), *second.rows()])[order]
        return Sequences.of(rows, first.values.dtype)
    return np.concatenate([first, second])[order]
