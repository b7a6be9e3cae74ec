"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.cdr import DECODED_LIMIT, Codec
from rpud_sim.bag.columns import Column, Kind, objects
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import MessageBlock, gathered, items
from rpud_sim.foundation.ragged import Ragged
from rpud_sim.foundation.time import SECOND

ELEMENTS_LIMIT = 10_000  # greatest number of messages within one message that are passed one by one

_HEAD = 4  # bytes before the first field: the encoding of a message
_LEAST = 8  # messages of one layout that are not decoded one by one
_MOST_LAYOUTS = 100  # of messages of one size
_TEXTS = ("string", "wstring")
_DTYPES = {"bool": "u1", "byte": "u1", "char": "u1"}
_KNOWN_TEXTS = 1000
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes of numbers, by the beginning of a message


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

    Messages of one size whose texts and sequences have the same lengths have their fields at the
    same places: those are found in one message, and read in all. Other messages are decoded one by
    one: lists of messages, the few of a layout, and what is not of the type, for the reason.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)
        self._nested = any(
            column.kind is Kind.NESTED and not _holds_texts(codec, column.attribute)
            for column in columns
        )
        self._largest = codec.budget.largest(DECODED_LIMIT)

    def read(self, block: MessageBlock) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        parts = [] if self._nested else self._laid_out(block)
        left = np.ones(len(block), bool)
        for rows, _ in parts:
            left[rows] = False
        others = np.flatnonzero(left)
        errors: list[tuple[int, str]] = []
        if len(others) or not parts:
            messages, decoded = [], []
            for row in others.tolist():
                try:
                    messages.append(self._codec.decode(block.message(row)))
                    decoded.append(row)
                except BagFormatError as error:
                    errors.append((row, str(error)))
            values = {column.name: column.values(messages) for column in self._columns}
            parts.append((np.array(decoded, np.intp), values))
        rows_of_all = np.concatenate([rows for rows, _ in parts])
        order = np.argsort(rows_of_all, kind="stable")
        joined = {
            column.name: _together([values[column.name] for _, values in parts], order)
            for column in self._columns
        }
        return FieldValues(rows_of_all[order], joined, tuple(errors))

    def _laid_out(
        self, block: MessageBlock
    ) -> list[tuple[np.ndarray, dict[str, np.ndarray | Ragged]]]:
        """Return places and values of messages that share their layout with others."""
        found = []
        order = np.argsort(block.sizes, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(block.sizes[order])) + 1):
            for _ in range(_MOST_LAYOUTS):
                if len(rows) < _LEAST or not _HEAD <= block.sizes[rows[0]] <= self._largest:
                    break
                layout = _layout(self._codec, block.message(int(rows[0])))
                same = np.arange(len(rows)) == 0
                if layout is not None:
                    same = layout.fits(block.data, block.starts[rows])
                    chosen = rows[same]
                    try:
                        values = layout.values(self._columns, block.data, block.starts[chosen])
                        found.append((chosen, values))
                    except UnicodeDecodeError:
                        pass
                rows = rows[~same]
        return found


class _Field(NamedTuple):
    """One field of a message."""

    place: int  # of its first byte [bytes]
    dtype: np.dtype | None  # of its numbers, as they are in the message; None for texts
    length: int  # of the numbers, or of the bytes
    texts: tuple[slice, ...] | None = None  # those of a list, from the first byte


@dataclass
class _Layout:
    """Places of the fields of a message, and what others have at the same places."""

    order: str  # of the bytes of numbers, ``<`` or ``>``
    fields: dict[str, _Field] = field(default_factory=dict)  # by attribute
    fixed: list[tuple[int, str, int]] = field(default_factory=list)  # places, dtypes and numbers

    def fits(self, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return which messages, of the same size, have this layout."""
        same = np.ones(len(starts), bool)
        for place, dtype, number in self.fixed:
            same &= items(data, dtype)[starts + place] == number
        return same

    def values(
        self, columns: Sequence[Column], data: np.ndarray, starts: np.ndarray
    ) -> dict[str, np.ndarray | Ragged]:
        return {column.name: self._column(column, data, starts) for column in columns}

    def _column(self, column: Column, data: np.ndarray, starts: np.ndarray) -> np.ndarray | Ragged:
        if column.kind in (Kind.TIME, Kind.DURATION):
            parts = [f"{column.attribute}.{part}" for part in ("sec", "nanosec")]
            seconds, rest = (self._numbers(part, data, starts) for part in parts)
            return seconds[:, 0].astype(np.int64) * SECOND + rest[:, 0]
        if column.kind in (Kind.TEXT, Kind.NESTED):
            return _texts(self.fields[column.attribute], data, starts)
        numbers = self._numbers(column.attribute, data, starts)
        numbers = numbers != 0 if column.dtype.kind == "b" else numbers
        numbers = numbers.astype(column.dtype, copy=False)
        if column.kind is Kind.NUMBER:
            return numbers[:, 0]
        if column.kind is Kind.ARRAY:
            return numbers
        return Ragged.of_counts(numbers.reshape(-1), np.full(len(numbers), numbers.shape[1]))

    def _numbers(self, attribute: str, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return the numbers of a field, shape (messages, numbers of each)."""
        place, dtype, count, _ = self.fields[attribute]
        assert dtype is not None
        if count == 1:
            return items(data, dtype)[starts + place][:, None]
        found = gathered(data, starts + place, np.full(len(starts), count * dtype.itemsize))
        return found.view(dtype).reshape(len(starts), count)


def _layout(codec: Codec, message: bytes) -> _Layout | None:
    """Return the layout of a message; None if it is not of the type, or of too many parts."""
    order = _ORDERS.get(message[:2])
    if order is None:
        return None
    layout = _Layout(order, fixed=[(0, "<u2", int.from_bytes(message[:2], "little"))])
    try:
        end = _Walk(codec, message, layout).member(codec.type_name, "", _HEAD)
    except (_NoLayoutError, struct.error):
        return None
    # Serializers may align the end of a message.
    return layout if end <= len(message) <= end + 3 else None


class _NoLayoutError(Exception):
    """Error of a message that is not of the type, or of too many parts."""


class _Walk:
    """Walk along the fields of a message, which notes their places in a layout."""

    def __init__(self, codec: Codec, message: bytes, layout: _Layout) -> None:
        self._codec, self._message, self._layout = codec, message, layout

    def member(self, type_name: str, prefix: str | None, place: int) -> int:
        """Pass a message and return its end; fields in sequences have no prefix."""
        fields = self._codec.fields(type_name)
        for _, attribute, (node, described) in fields:
            name = None if prefix is None else prefix + attribute
            place = self._field(node, described, name, place)
        return place if fields else place + 1  # CDR needs one member

    def _field(self, node: Nodetype, described: Any, name: str | None, place: int) -> int:
        if node == Nodetype.NAME:
            return self.member(described, None if name is None else f"{name}.", place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            text, end = self._text(place)
            self._note(name, _Field(text.start, None, text.stop - text.start))
            return end
        if node == Nodetype.BASE:
            return self._numbers(described[0], 1, name, place)
        (element, item), count = described
        if node == Nodetype.SEQUENCE:
            count, place = self._length(place)
        if element == Nodetype.BASE and item[0] not in _TEXTS:
            return self._numbers(item[0], count, name, place)
        if count > ELEMENTS_LIMIT:
            raise _NoLayoutError
        start, texts = place, []
        for _ in range(count):
            if place >= len(self._message):
                raise _NoLayoutError
            if element == Nodetype.BASE:
                text, place = self._text(place)
                texts.append(slice(text.start - start, text.stop - start))
            else:
                place = self._field(element, item, None, place)
        self._note(name, _Field(start, None, place - start, tuple(texts)))
        return place

    def _numbers(self, kind: str, count: int, name: str | None, place: int) -> int:
        dtype = np.dtype(self._layout.order + (_DTYPES.get(kind) or np.dtype(kind).str[1:]))
        place = _aligned(place, dtype.itemsize) if count else place
        self._note(name, _Field(place, dtype, count))
        return self._reach(place + count * dtype.itemsize)

    def _text(self, place: int) -> tuple[slice, int]:
        """Return the place of a text without the zero behind it, and its end."""
        count, place = self._length(place)
        end = self._reach(place + count)
        if count < 1 or self._message[end - 1] != 0:
            raise _NoLayoutError
        self._layout.fixed.append((end - 1, "u1", 0))
        return slice(place, end - 1), end

    def _length(self, place: int) -> tuple[int, int]:
        place = _aligned(place, 4)
        (count,) = struct.unpack_from(f"{self._layout.order}I", self._message, place)
        self._layout.fixed.append((place, f"{self._layout.order}u4", count))
        return count, place + 4

    def _reach(self, end: int) -> int:
        if end > len(self._message):
            raise _NoLayoutError
        return end

    def _note(self, name: str | None, found: _Field) -> None:
        if name is not None:
            self._layout.fields[name] = found


def _texts(place: _Field, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the texts, or lists of texts, of messages; equal ones are decoded once."""
    size = place.length
    content = gathered(data, starts + place.place, np.full(len(starts), size)).tobytes()
    known: dict[bytes, Any] = {}

    def decoded(part: bytes) -> Any:
        if part not in known:
            if len(known) >= _KNOWN_TEXTS:
                known.clear()
            texts = place.texts
            known[part] = part.decode() if texts is None else [part[t].decode() for t in texts]
        return known[part] if place.texts is None else [*known[part]]

    if place.texts is None and content == content[:size] * len(starts):  # as a frame's name
        return np.full(len(starts), decoded(content[:size]), object)
    return objects([decoded(content[k * size : (k + 1) * size]) for k in range(len(starts))])


def _aligned(place: int, size: int) -> int:
    return place + (_HEAD - place) % size  # alignment counts from behind the head


def _holds_texts(codec: Codec, attribute: str) -> bool:
    type_name = codec.type_name
    for part in attribute.split("."):
        node, described = {name: kind for _, name, kind in codec.fields(type_name)}[part]
        type_name = described if node == Nodetype.NAME else type_name
    return node in (Nodetype.ARRAY, Nodetype.SEQUENCE) and described[0][0] == Nodetype.BASE


def _together(parts: list[np.ndarray | Ragged], order: np.ndarray) -> np.ndarray | Ragged:
    if len(parts) == 1:
        return parts[0]
    ragged = [part for part in parts if isinstance(part, Ragged)]
    if ragged:
        rows = objects([row for part in ragged for row in part.rows()])[order]
        return Ragged.of(rows, ragged[0].values.dtype)
    return np.concatenate([part for part in parts if not isinstance(part, Ragged)])[order]
