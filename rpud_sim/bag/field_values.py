"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.cdr import DECODED_LIMIT, Codec
from rpud_sim.bag.columns import Column, Kind, Sequences, objects
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import MessageBlock, gathered
from rpud_sim.foundation.time import SECOND

ELEMENTS_LIMIT = 10_000  # greatest number of messages within one message that are passed one by one
HEAD = 4  # bytes before the first field: the encoding of a message

# Whole number for all messages: one if it is the same for all, otherwise of shape (n,).
Whole: TypeAlias = "int | np.ndarray"

_STEPS_LIMIT = 4 * ELEMENTS_LIMIT  # of one walk: messages with other lengths need other steps
_TEXTS = ("string", "wstring")
_DTYPES = {"bool": "u1", "byte": "u1", "char": "u1"}


@dataclass(frozen=True)
class Field:
    """One field of many messages."""

    place: Whole  # of its first byte, from the beginning of each message [bytes]
    dtype: np.dtype | None  # of its numbers, as they are in the messages; None for a text or a list
    # of the numbers of an array or a sequence, or of the bytes of a text or a list of texts;
    # None for a single number
    count: Whole | None = None


class FieldWalk:
    """Walk along the fields of messages, all at once.

    Args:
        wanted: attributes of the fields to note, with dots.
        data: bytes of all messages, uint8.
        starts: where each message begins in ``data``.
        sizes: of each message [bytes].
        order: of the bytes of numbers, ``<`` or ``>``.
    """

    def __init__(
        self,
        codec: Codec,
        wanted: Collection[str],
        data: np.ndarray,
        starts: np.ndarray,
        sizes: np.ndarray,
        order: str,
    ) -> None:
        self.fields: dict[str, Field] = {}  # by attribute
        self.bad = np.zeros(len(starts), bool)  # messages that are not of the type, shape (n,)
        self._codec, self._wanted, self._order = codec, wanted, order
        self._data, self._starts, self._sizes = data, starts, sizes
        self._least = int(sizes.min(initial=0)) if len(sizes) else 0
        self._steps = 0
        end = self._member(codec.type_name, "", HEAD)
        # Serializers may align the end of a message.
        self.bad |= (end > sizes) | (end + 3 < sizes)

    def _member(self, type_name: str, prefix: str | None, place: Whole) -> Whole:
        """Pass a message and return its end; fields in sequences have no prefix."""
        fields = self._codec.fields(type_name)
        if not fields:
            return place + 1  # CDR needs one member
        for _, attribute, (node, described) in fields:
            name = None if prefix is None else prefix + attribute
            place = self._field(node, described, name, place)
        return place

    def _field(self, node: Nodetype, described: Any, name: str | None, place: Whole) -> Whole:
        if node == Nodetype.NAME:
            return self._member(described, None if name is None else f"{name}.", place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            return self._text(name, place)
        if node == Nodetype.BASE:
            dtype = self._dtype(described[0])
            place = _aligned(place, dtype.itemsize)
            self._note(name, Field(place, dtype))
            return place + dtype.itemsize
        (element, item), count = described
        start = place
        if node == Nodetype.SEQUENCE:
            place = _aligned(place, 4)
            count = self._length(place)
            place = place + 4
        if element != Nodetype.BASE or item[0] in _TEXTS:
            end = self._elements(element, item, count, place)
            self._note(name, Field(start, None, end - start))
            return end
        dtype = self._dtype(item[0])
        if not _is_one(count):
            place = _same(np.where(count, _aligned(place, dtype.itemsize), place))
        elif count:
            place = _aligned(place, dtype.itemsize)
        self._note(name, Field(place, dtype, count))
        return self._reach(place + count * dtype.itemsize)

    def _text(self, name: str | None, place: Whole) -> Whole:
        place = _aligned(place, 4)
        count = self._length(place)
        place = place + 4
        self.bad |= count < 1  # a text ends with a zero
        end = self._reach(place + count)
        self.bad |= self._read(end - 1, np.dtype("u1")) != 0
        self._note(name, Field(place, None, count - 1))
        return end

    def _elements(self, element: Nodetype, item: Any, counts: Whole, place: Whole) -> Whole:
        self.bad |= np.asarray(counts) > ELEMENTS_LIMIT
        number = 0
        while True:
            more = (number < np.asarray(counts)) & ~self.bad & (place < self._sizes)
            short = (number < np.asarray(counts)) & ~(place < self._sizes)
            self.bad |= short
            if not more.any():
                return place
            self._steps += 1
            if self._steps > _STEPS_LIMIT:
                self.bad |= more
                return place
            if more.all():
                place = self._field(element, item, None, place)
            else:
                place = self._some(element, item, more, place)
            number += 1

    def _some(self, element: Nodetype, item: Any, chosen: np.ndarray, place: Whole) -> np.ndarray:
        places = np.broadcast_to(np.asarray(place), self.bad.shape).copy()
        part = object.__new__(FieldWalk)
        part.__dict__.update(self.__dict__)
        part._starts, part._sizes = self._starts[chosen], self._sizes[chosen]
        part._least = int(part._sizes.min())
        part.bad = np.zeros(len(part._starts), bool)
        places[chosen] = part._field(element, item, None, _same(places[chosen]))
        self.bad[chosen] = part.bad
        self._steps = part._steps
        return places

    def _note(self, name: str | None, field: Field) -> None:
        if name is not None and name in self._wanted:
            self.fields[name] = field

    def _length(self, place: Whole) -> Whole:
        found = self._read(place, np.dtype(f"{self._order}u4")).astype(np.int64)
        found[self.bad] = 0
        return _same(found)

    def _reach(self, end: Whole) -> Whole:
        """Return the end of a field; messages that it exceeds are bad."""
        if _is_one(end) and end <= self._least:
            return end
        self.bad |= end > self._sizes
        return _same(np.where(self.bad, HEAD, end))

    def _read(self, place: Whole, dtype: np.dtype) -> np.ndarray:
        """Return a number of each message; those that are too short for it are bad."""
        if not _is_one(place) or place + dtype.itemsize > self._least or self.bad.any():
            self.bad |= place + dtype.itemsize > self._sizes
            place = np.where(self.bad, -self._starts, place)
        return taken(self._data, self._starts + place, dtype)

    def _dtype(self, name: str) -> np.dtype:
        return np.dtype(self._order + (_DTYPES.get(name) or np.dtype(name).str[1:]))


def taken(data: np.ndarray, places: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return the numbers at places of a buffer, which need not be aligned [bytes]."""
    if len(data) < dtype.itemsize:
        return np.zeros(len(places), dtype)
    # An overlapping view with one item for each place: NumPy copies the wanted ones out of it.
    view: np.ndarray = np.ndarray((len(data) - dtype.itemsize + 1,), dtype, data, strides=(1,))
    return view[places]


def _is_one(value: Whole) -> bool:
    return not isinstance(value, np.ndarray)


def _same(values: Whole) -> Whole:
    if not isinstance(values, np.ndarray) or (len(values) and (values == values[0]).all()):
        return values if not isinstance(values, np.ndarray) else int(values[0])
    return values


def _aligned(place: Whole, size: int) -> Whole:
    return place + (HEAD - place) % size  # alignment counts from behind the head


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
