"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.cdr import DECODED_LIMIT, Codec
from rpud_sim.bag.columns import Column, Kind, objects
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import MessageBlock, gathered, items
from rpud_sim.foundation.ragged import Ragged
from rpud_sim.foundation.time import SECOND

ELEMENTS_LIMIT = 10_000  # greatest number of messages within one message that are passed one by one

# Whole number for all messages: one if it is the same for all, otherwise of shape (n,).
PerMessage: TypeAlias = "int | np.ndarray"

_HEAD = 4  # bytes before the first field: the encoding of a message
_STEPS_LIMIT = 4 * ELEMENTS_LIMIT  # of one walk: messages with other lengths need other steps
_TEXTS = ("string", "wstring")
_DTYPES = {"bool": "u1", "byte": "u1", "char": "u1"}
_KNOWN_TEXTS = 1000
_TEXT_ALIGNMENT = 4  # bytes
_ORDERS = {0: ">", 256: "<"}  # of the bytes of numbers, by the first two bytes of a message


@dataclass(frozen=True)
class FieldValues:
    """Values of fields."""

    rows: np.ndarray  # places of the readable messages in the block, in their order, shape (n,)
    # values of each column, by its name, in the form of ``Kind``; ``Ragged`` for sequences
    # of numbers
    columns: dict[str, np.ndarray | Ragged]
    errors: tuple[tuple[int, str], ...]  # place of each other message, and the reason

    def array(self, name: str) -> np.ndarray:
        """Return the values of a column that holds no sequences."""
        values = self.columns[name]
        assert not isinstance(values, Ragged)
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
        self._wanted: set[str] = set()
        for column in columns:
            is_time = column.kind in (Kind.TIME, Kind.DURATION)
            self._wanted |= {
                column.attribute + part for part in ((".sec", ".nanosec") if is_time else ("",))
            }
        self._largest = codec.budget.largest(DECODED_LIMIT)

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

    def _walked(self, block: MessageBlock) -> tuple[np.ndarray, dict[str, np.ndarray | Ragged]]:
        readable = (block.sizes >= _HEAD) & (block.sizes <= self._largest)
        order = ""
        if readable.any():
            heads = np.zeros(len(block), np.uint16)
            heads[readable] = _taken(block.data, block.starts[readable], np.dtype("<u2"))
            head = int(heads[np.argmax(readable)])
            order = _ORDERS.get(head, "")
            readable &= heads == head
        rows = np.flatnonzero(readable) if order else np.empty(0, np.intp)
        while True:
            walk = _FieldWalk(self._codec, self._wanted, block, rows, order or "<")
            if walk.bad.any():
                rows = rows[~walk.bad]
                continue
            try:
                return rows, {column.name: walk.values(column) for column in self._columns}
            except _UnreadableError as error:
                rows = np.delete(rows, error.rows)

    def _decoded(
        self, block: MessageBlock, rows: np.ndarray
    ) -> tuple[dict[str, np.ndarray | Ragged], tuple[tuple[int, str], ...]]:
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


@dataclass(frozen=True)
class _Field:
    """One field of many messages."""

    place: PerMessage  # of its first byte, from the beginning of each message [bytes]
    dtype: np.dtype | None  # of its numbers, as they are in the messages; None for a text or a list
    # of the numbers of an array or a sequence, or of the bytes of a text or a list of texts;
    # None for a single number
    count: PerMessage | None = None


class _FieldWalk:
    """Walk along the fields of the messages ``rows`` of a block, all at once.

    ``wanted`` are the attributes of the fields to note, with dots. ``order`` is that of the bytes
    of numbers, ``<`` or ``>``.
    """

    def __init__(
        self,
        codec: Codec,
        wanted: Collection[str],
        block: MessageBlock,
        rows: np.ndarray,
        order: str,
    ) -> None:
        self.bad = np.zeros(len(rows), bool)  # messages that are not of the type, shape (n,)
        self._fields: dict[str, _Field] = {}  # by attribute
        self._codec, self._wanted, self._order = codec, wanted, order
        self._data, self._starts, self._sizes = block.data, block.starts[rows], block.sizes[rows]
        self._least = int(self._sizes.min()) if len(rows) else 0
        self._steps = 0
        end = self._member(codec.type_name, "", _HEAD)
        # Serializers may align the end of a message.
        self.bad |= (end > self._sizes) | (end + 3 < self._sizes)

    def values(self, column: Column) -> np.ndarray | Ragged:
        """Return the values of a column of messages that are all of the type."""
        if column.kind in (Kind.TIME, Kind.DURATION):
            seconds = self._numbers(f"{column.attribute}.sec").astype(np.int64)
            return seconds * SECOND + self._numbers(f"{column.attribute}.nanosec")
        if column.kind is Kind.NUMBER:
            return _native(self._numbers(column.attribute), column.dtype)
        if column.kind is Kind.TEXT:
            return self._texts(column)
        if column.kind is Kind.NESTED:
            return self._lists_of_texts(column)
        field = self._fields[column.attribute]
        assert field.dtype is not None
        counts = self._counts(field)
        found = gathered(self._data, self._starts + field.place, counts * field.dtype.itemsize)
        numbers = _native(found.view(field.dtype), column.dtype)
        if column.kind is Kind.ARRAY:
            return numbers.reshape(len(self._starts), column.length)
        return Ragged.of_counts(numbers, counts)

    def _numbers(self, attribute: str) -> np.ndarray:
        field = self._fields[attribute]
        assert field.dtype is not None
        return _taken(self._data, self._starts + field.place, field.dtype)

    def _counts(self, field: _Field) -> np.ndarray:
        return np.full(self._starts.shape, field.count, np.int64)

    def _texts(self, column: Column) -> np.ndarray:
        parts, same = self._contents(self._fields[column.attribute])
        keys = parts[:1] if same else parts  # a frame's name is always the same
        found = _each_once(keys, lambda part, _: _text(part), len(parts))
        return np.full(len(parts), found[0], object) if same else found

    def _lists_of_texts(self, column: Column) -> np.ndarray:
        """Return lists of texts; padding between texts depends on the place of the first."""
        field = self._fields[column.attribute]
        parts, _ = self._contents(field)
        shifts = np.broadcast_to(np.asarray(field.place) % _TEXT_ALIGNMENT, len(parts)).tolist()

        def decoded(_: object, row: int) -> list[str] | None:
            start = int(self._starts[row])
            data = self._data[start : start + self._sizes[row]].tobytes()
            try:
                return list(attrgetter(column.attribute)(self._codec.decode(data)))
            except BagFormatError:
                return None

        keys = zip(parts, shifts, strict=True)
        return objects([*map(list, _each_once(keys, decoded, len(parts)))])

    def _contents(self, field: _Field) -> tuple[list[bytes], bool]:
        """Return the bytes of a text or list in each message, and whether all are the same."""
        counts = self._counts(field)
        content = gathered(self._data, self._starts + field.place, counts).tobytes()
        if len(counts) and (counts == counts[0]).all():
            first = content[: counts[0]]
            if first * len(counts) == content:
                return [first] * len(counts), True
        ends = np.cumsum(counts).tolist()
        return [content[i:j] for i, j in zip([0, *ends], ends, strict=False)], False

    def _member(self, type_name: str, prefix: str | None, place: PerMessage) -> PerMessage:
        """Pass a message and return its end; fields in sequences have no prefix."""
        fields = self._codec.fields(type_name)
        if not fields:
            return place + 1  # CDR needs one member
        for _, attribute, (node, described) in fields:
            name = None if prefix is None else prefix + attribute
            place = self._field(node, described, name, place)
        return place

    def _field(
        self, node: Nodetype, described: Any, name: str | None, place: PerMessage
    ) -> PerMessage:
        if node == Nodetype.NAME:
            return self._member(described, None if name is None else f"{name}.", place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            return self._pass_text(name, place)
        if node == Nodetype.BASE:
            dtype = self._dtype(described[0])
            place = _aligned(place, dtype.itemsize)
            self._note(name, _Field(place, dtype))
            return place + dtype.itemsize
        (element, item), count = described
        start = place
        if node == Nodetype.SEQUENCE:
            place = _aligned(place, 4)
            count = self._length(place)
            place = place + 4
        if element != Nodetype.BASE or item[0] in _TEXTS:
            end = self._elements(element, item, count, place)
            self._note(name, _Field(start, None, end - start))
            return end
        dtype = self._dtype(item[0])
        if not _is_one(count):
            place = _same(np.where(count, _aligned(place, dtype.itemsize), place))
        elif count:
            place = _aligned(place, dtype.itemsize)
        self._note(name, _Field(place, dtype, count))
        return self._reach(place + count * dtype.itemsize)

    def _pass_text(self, name: str | None, place: PerMessage) -> PerMessage:
        place = _aligned(place, 4)
        count = self._length(place)
        place = place + 4
        self.bad |= count < 1  # a text ends with a zero
        end = self._reach(place + count)
        self.bad |= self._read(end - 1, np.dtype("u1")) != 0
        self._note(name, _Field(place, None, count - 1))
        return end

    def _elements(
        self, element: Nodetype, item: Any, counts: PerMessage, place: PerMessage
    ) -> PerMessage:
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

    def _some(
        self, element: Nodetype, item: Any, chosen: np.ndarray, place: PerMessage
    ) -> np.ndarray:
        places = np.broadcast_to(np.asarray(place), self.bad.shape).copy()
        part = object.__new__(_FieldWalk)
        part.__dict__.update(self.__dict__)
        part._starts, part._sizes = self._starts[chosen], self._sizes[chosen]
        part._least = int(part._sizes.min())
        part.bad = np.zeros(len(part._starts), bool)
        places[chosen] = part._field(element, item, None, _same(places[chosen]))
        self.bad[chosen] = part.bad
        self._steps = part._steps
        return places

    def _note(self, name: str | None, field: _Field) -> None:
        if name is not None and name in self._wanted:
            self._fields[name] = field

    def _length(self, place: PerMessage) -> PerMessage:
        found = self._read(place, np.dtype(f"{self._order}u4")).astype(np.int64)
        found[self.bad] = 0
        return _same(found)

    def _reach(self, end: PerMessage) -> PerMessage:
        """Return the end of a field; messages that it exceeds are bad."""
        if _is_one(end) and end <= self._least:
            return end
        self.bad |= end > self._sizes
        return _same(np.where(self.bad, _HEAD, end))

    def _read(self, place: PerMessage, dtype: np.dtype) -> np.ndarray:
        """Return a number of each message; those that are too short for it are bad."""
        if not _is_one(place) or place + dtype.itemsize > self._least or self.bad.any():
            self.bad |= place + dtype.itemsize > self._sizes
            place = np.where(self.bad, -self._starts, place)
        return _taken(self._data, self._starts + place, dtype)

    def _dtype(self, name: str) -> np.dtype:
        return np.dtype(self._order + (_DTYPES.get(name) or np.dtype(name).str[1:]))


def _each_once(
    keys: Iterable[Any], decode: Callable[[Any, int], object | None], count: int
) -> np.ndarray:
    """Return what each key of ``count`` rows means, from its row; equal keys are decoded once."""
    found = np.empty(count, object)
    known: dict[Any, object | None] = {}
    bad: list[int] = []
    for row, key in enumerate(keys):
        if key not in known:
            if len(known) >= _KNOWN_TEXTS:
                known.clear()
            known[key] = decode(key, row)
        found[row] = known[key]
        if found[row] is None:
            bad.append(row)
    if bad:
        raise _UnreadableError(bad)
    return found


def _text(data: bytes) -> str | None:
    try:
        return data.decode()
    except UnicodeDecodeError:
        return None


def _taken(data: np.ndarray, places: np.ndarray, dtype: np.dtype) -> np.ndarray:
    """Return the numbers at places of a buffer, which need not be aligned [bytes]."""
    if len(data) < dtype.itemsize:
        return np.zeros(len(places), dtype)
    return items(data, dtype)[places]


def _is_one(value: PerMessage) -> bool:
    return not isinstance(value, np.ndarray)


def _same(values: PerMessage) -> PerMessage:
    if isinstance(values, np.ndarray) and len(values) and (values == values[0]).all():
        return int(values[0])
    return values


def _aligned(place: PerMessage, size: int) -> PerMessage:
    return place + (_HEAD - place) % size  # alignment counts from behind the head


def _holds_texts(codec: Codec, attribute: str) -> bool:
    type_name = codec.type_name
    for part in attribute.split("."):
        node, described = {name: kind for _, name, kind in codec.fields(type_name)}[part]
        type_name = described if node == Nodetype.NAME else type_name
    return node in (Nodetype.ARRAY, Nodetype.SEQUENCE) and described[0][0] == Nodetype.BASE


def _native(values: np.ndarray, dtype: np.dtype) -> np.ndarray:
    if dtype.kind == "b":
        return values != 0
    return values.astype(dtype, copy=False)


def _together(
    first: np.ndarray | Ragged, second: np.ndarray | Ragged, order: np.ndarray
) -> np.ndarray | Ragged:
    if isinstance(first, Ragged) and isinstance(second, Ragged):
        rows = objects([*first.rows(), *second.rows()])[order]
        return Ragged.of(rows, first.values.dtype)
    return np.concatenate([first, second])[order]
