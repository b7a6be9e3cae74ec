"""Columns of a table from the fields of a message type, with units from its comments."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.cdr import (
    DECODED_LIMIT,
    HEAD,
    PADDING,
    UNUSED,
    Codec,
    aligned,
    number_dtype,
)
from rpud_sim.messages.definition_text import fields_of, parts_of
from rpud_sim.messages.encoder import CODES, TEXT, Decoded, Members, Node, gathered, items
from rpud_sim.messages.encoder import Sequence as Several
from rpud_sim.messages.errors import BagFormatError

_GREATEST = 1e150  # squares of values beyond would overflow

# Columns of every table; a field with such a name gets underscores until it is unique.
RECEIVED = ("log_time", "publish_time")

_LEAST_TOGETHER = 4  # messages; fewer are decoded faster one by one
_KNOWN_TEXTS = 1000
_MOST_TEXTS = 1000  # greatest number of texts of a list in messages that are read together
_UNIT = re.compile(r"\[([^][]{1,20})\](?:[,;]|$)")


class Kind(Enum):
    """Kind of the values of a column, and their form in NumPy.

    ``NUMBER`` has its own dtype. ``TIME`` and ``DURATION`` are integer nanoseconds. ``ARRAY``,
    numbers of a fixed length, has a second axis. The others are arrays of objects: ``TEXT``,
    ``SEQUENCE`` with an array of numbers in each row, and ``NESTED`` with a list in each row.
    """

    NUMBER = "number"
    TIME = "time"
    DURATION = "duration"
    TEXT = "text"
    ARRAY = "array"
    SEQUENCE = "sequence"
    NESTED = "nested"


_TIME_KINDS = {
    "builtin_interfaces/msg/Time": Kind.TIME,
    "builtin_interfaces/msg/Duration": Kind.DURATION,
}
_TIME_MEMBERS = (("sec", CODES["int32"]), ("nanosec", CODES["uint32"]))


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str  # name of the field, with dots between messages and the fields in them
    kind: Kind  # kind of its values
    dtype: np.dtype = np.dtype(object)  # noqa: RUF009 - it never changes
    length: int = 0  # length of an array
    unit: str = ""  # unit from the comment behind the field; empty without one
    description: str = ""  # the comment; empty without one
    attribute: str = ""  # attribute of decoded messages, with dots; empty if there is no field

    @property
    def empty(self) -> np.ndarray | Sequences:
        """Values of no message, in the form of ``kind``: for a sequence, ``Sequences``."""
        if self.kind is Kind.SEQUENCE:
            return Sequences.of([], self.dtype)
        return np.empty((0, self.length) if self.kind is Kind.ARRAY else 0, self.dtype)


def columns_of(codec: Codec, definition: str) -> tuple[Column, ...]:
    """Return the columns of a type in the order of its fields; messages give one for each field."""
    columns: list[Column] = []
    taken = {*RECEIVED}
    comments = _comments(codec.type, definition)
    for column in _columns(codec.members, comments, "", ""):
        name = column.name
        while name in taken:
            name += "_"
        taken.add(name)
        columns.append(replace(column, name=name))
    return tuple(columns)


def _columns(
    members: Members, comments: dict[tuple[str, str], str], prefix: str, outer_unit: str
) -> Iterator[Column]:
    for name, node in members.members:
        comment = comments.get((members.name, name), "")
        units = _UNIT.findall(comment)
        unit = units[0] if len(units) == 1 else outer_unit
        path = prefix + name
        column = partial(Column, path, unit=unit, description=comment, attribute=path)
        if isinstance(node, str):
            yield column(Kind.TEXT) if node == TEXT else column(Kind.NUMBER, np.dtype(node))
        elif isinstance(node, Members):
            # A bag may define these types otherwise.
            kind = _TIME_KINDS.get(node.name) if node.members == _TIME_MEMBERS else None
            if kind is None:
                yield from _columns(node, comments, f"{path}.", unit)
            else:
                yield column(kind, np.dtype(np.int64))
        elif not (isinstance(node.element, str) and node.element != TEXT):
            yield column(Kind.NESTED)
        elif node.length is None:
            yield column(Kind.SEQUENCE, np.dtype(node.element))
        else:
            yield column(Kind.ARRAY, np.dtype(node.element), node.length)


def objects(values: Sequence[Any]) -> np.ndarray:
    """Return an array of objects, one for each value, also if the values are sequences."""
    array = np.empty(len(values), object)
    for number, value in enumerate(values):
        array[number] = value
    return array


def to_plain(value: Any) -> Any:
    """Return a decoded value as dictionaries, lists, numbers and texts."""
    if isinstance(value, np.ndarray):
        return value.tolist()
    if isinstance(value, list):
        return [to_plain(item) for item in value]
    if isinstance(value, Decoded):
        return {name: to_plain(item) for name, item in vars(value).items()}
    return value


def _comments(type_name: str, definition: str) -> dict[tuple[str, str], str]:
    """Return the comments behind fields, by the long name of their type and their own."""
    return {
        (name, field): comment
        for name, text in parts_of(type_name, definition)
        for _, field, comment in fields_of(name, text)
    }


def usable(values: np.ndarray) -> np.ndarray:
    """Return which values can be counted and drawn: finite ones, and not beyond 1e150."""
    return np.abs(values.astype(float, copy=False)) < _GREATEST


@dataclass(frozen=True)
class FieldValues:
    """Values of fields of a batch's messages."""

    rows: np.ndarray  # places of the readable messages in the batch, in their order, shape (n,)
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
    """Reader of some columns of one type, from many messages together.

    It goes from field to field in all messages together. Messages that are not as the others, and
    all of a type with lists of messages, are decoded one by one.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)
        self._wanted = {column.attribute for column in columns}
        self._fields = _flat_fields(codec.members)

    def read(self, batch: Batch) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        if batch.fields:
            columns = {c.name: _computed(c, batch.fields, len(batch)) for c in self._columns}
            return FieldValues(np.arange(len(batch)), columns, ())
        together = np.arange(len(batch) if self._fields is not None else 0)
        found: dict[str, np.ndarray | Sequences] = {}
        while len(together) >= _LEAST_TOGETHER:
            try:
                walk = _Walk(self._codec, batch.part(together))
                fields = walk.read(self._fields or (), self._wanted)
                found = {each.name: _column(each, fields) for each in self._columns}
                break
            except _UndecodableMessages as odd:
                together = together[~odd.messages]
        else:
            together = together[:0]
        if found and len(together) == len(batch):
            return FieldValues(together, found, ())
        single: list[int] = []
        errors: list[tuple[int, str]] = []
        values: dict[str, list[Any]] = {each.name: [] for each in self._columns}
        for row in np.setdiff1d(np.arange(len(batch)), together).tolist():
            try:
                message = self._codec.decode(batch.message(row))
            except BagFormatError as error:
                errors.append((row, str(error)))
                continue
            single.append(row)
            for each in self._columns:
                values[each.name].append(attrgetter(each.attribute)(message))
        rows = np.concatenate([together, np.array(single, np.intp)])
        order = np.argsort(rows)
        columns = {}
        for each in self._columns:
            own = _column_of(each, values[each.name])
            columns[each.name] = _joined(each, found[each.name], own, order) if found else own
        return FieldValues(rows[order], columns, tuple(errors))


def _computed(column: Column, fields: Mapping[str, Any], count: int) -> np.ndarray | Sequences:
    """Return the values of a column from fields that are columns themselves."""
    value: Any = fields
    for name in column.attribute.split("."):
        value = value[name]
    if column.kind in (Kind.TIME, Kind.DURATION):
        time = np.asarray(value["sec"], np.int64) * SECOND + np.asarray(value["nanosec"], np.int64)
        return np.array(np.broadcast_to(time, count))
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return objects([value] * count)
    if column.kind is Kind.NUMBER:
        return np.array(np.broadcast_to(value, count), column.dtype)
    if isinstance(value, Sequences):
        return value
    values = np.asarray(value, column.dtype)
    values = np.array(np.broadcast_to(values, (count, values.shape[-1])))
    return Sequences.of_counts(values.reshape(-1), np.full(count, values.shape[1]))


def _flat_fields(members: Members, prefix: str = "") -> list[tuple[str, Node]] | None:
    """Return path and type of each field, also of members; None with lists of messages."""
    found: list[tuple[str, Node]] = []
    for name, node in members.members:
        if isinstance(node, Members):
            inner = _flat_fields(node, f"{prefix}{name}.")
            if inner is None:
                return None
            found += inner
        elif isinstance(node, str) or isinstance(node.element, str):
            found.append((prefix + name, node))
        else:
            return None
    return found or [(prefix, CODES["uint8"])]  # CDR needs a field


class _UndecodableMessages(Exception):  # noqa: N818 - it is not for users
    """Messages that cannot be read together with the others."""

    def __init__(self, messages: np.ndarray) -> None:
        super().__init__()
        self.messages = messages  # whether each is one, shape (n,)


# Place or length in messages: one for all, or of each.
_Places: TypeAlias = "int | np.ndarray"


class _Walk:
    """Walk from field to field in all messages of a batch together."""

    def __init__(self, codec: Codec, batch: Batch) -> None:
        self._codec = codec
        self._data, self._starts, self._sizes = batch.data, batch.starts, batch.sizes
        self._place: _Places = HEAD
        self._memory: _Places = codec.shape.memory
        self._spare: _Places = PADDING

    def read(
        self, fields: Sequence[tuple[str, Node]], texts: Collection[str]
    ) -> dict[str, np.ndarray | Sequences]:
        """Return the values of each field by its path; a row of numbers for each message.

        ``texts`` are the paths of the fields whose single texts are wanted.
        """
        self._check(self._sizes >= HEAD)
        self._check(items(self._data, "<u2")[self._starts] == 0x0100)  # little-endian
        found: dict[str, np.ndarray | Sequences] = {}
        for path, node in fields:
            if node == TEXT:
                places = self._text_places()
                if path in texts:
                    found[path] = objects(self._texts(*places))
                continue
            if isinstance(node, str):
                found[path] = self._numbers(number_dtype(node), 1)
                continue
            assert isinstance(node, Several)
            count: _Places | None = node.length
            if count is None:
                least = self._codec.shape_of(node.element).size
                count = self._length(least, self._codec.element_memory(node.element))
            if node.element == TEXT:
                found[path] = objects(self._lists_of_texts(count))
            else:
                found[path] = self._numbers(number_dtype(str(node.element)), count)
        end = np.asarray(self._place)
        self._check((end <= self._sizes) & (self._sizes <= end + self._spare))
        self._check(np.asarray(self._memory) <= DECODED_LIMIT)
        return found

    def _check(self, fits: np.ndarray) -> None:
        if not fits.all():
            raise _UndecodableMessages(~np.broadcast_to(fits, len(self._starts)))

    def _reach(self, size: _Places) -> None:
        self._check(np.asarray(self._place + size) <= self._sizes)

    def _length(self, least: int, memory: int) -> _Places:
        self._place = aligned(self._place, 4)
        self._reach(4)
        counts = items(self._data, "<u4")[self._starts + self._place].astype(np.int64)
        count: _Places = int(counts[0]) if (counts == counts[0]).all() else counts
        self._place = self._place + 4
        self._reach(count * least)
        self._memory = self._memory + count * memory
        self._spare = self._spare + UNUSED * np.equal(count, 0)
        return count

    def _numbers(self, dtype: np.dtype, count: _Places) -> np.ndarray | Sequences:
        size = dtype.itemsize
        if isinstance(count, np.ndarray):
            self._place = np.where(count > 0, aligned(self._place, size), self._place)
        elif count:
            self._place = aligned(self._place, size)
        self._reach(count * size)
        starts = self._starts + self._place
        self._place = self._place + count * size
        if not isinstance(count, np.ndarray) and count == 1:
            return items(self._data, dtype)[starts][:, None]
        counts = np.broadcast_to(count, len(starts))
        values = gathered(self._data, starts, counts * size).view(dtype)
        if isinstance(count, np.ndarray):
            return Sequences.of_counts(values, count)
        return values.reshape(len(starts), count)

    def _text_places(self) -> tuple[np.ndarray, _Places]:
        """Return where texts begin, and their lengths with the zero at the end."""
        counts = self._length(1, self._codec.shape_of(TEXT).growth)
        self._check(np.asarray(counts) >= 1)
        starts = self._starts + self._place
        self._place = self._place + counts
        self._check(self._data[self._starts + self._place - 1] == 0)
        return starts, counts

    def _texts(self, starts: np.ndarray, counts: _Places) -> list[str]:
        ends = starts + counts - 1
        if not isinstance(counts, np.ndarray):
            content = gathered(self._data, starts, np.full(len(starts), counts - 1)).tobytes()
            with suppress(UnicodeDecodeError):
                if content == content[: counts - 1] * len(starts):  # as for the name of a frame
                    return [content[: counts - 1].decode()] * len(starts)
        known: dict[bytes, str] = {}  # equal ones are decoded once, as a frame's name
        view, odd, found = self._data.data, [], []
        for row, (start, end) in enumerate(zip(starts.tolist(), ends.tolist(), strict=True)):
            content = bytes(view[start:end])
            if content not in known:
                if len(known) >= _KNOWN_TEXTS:
                    known.clear()
                try:
                    known[content] = content.decode()
                except UnicodeDecodeError:
                    odd.append(row)
                    known[content] = ""
            found.append(known[content])
        if odd:
            self._check(~np.isin(np.arange(len(starts)), odd))
        return found

    def _lists_of_texts(self, count: _Places) -> list[list[str]]:
        if isinstance(count, np.ndarray):
            self._check(count == count[0])
        if int(np.max(count)) > _MOST_TEXTS:
            self._check(np.zeros(len(self._starts), bool))
        elements = [self._texts(*self._text_places()) for _ in range(int(np.max(count)))]
        rows = zip(*elements, strict=True) if elements else [()] * len(self._starts)
        return [list(row) for row in rows]


def _column(column: Column, fields: Mapping[str, np.ndarray | Sequences]) -> np.ndarray | Sequences:
    """Return the values of a column from the values of fields, by their paths."""
    if column.kind in (Kind.TIME, Kind.DURATION):
        seconds, rest = (fields[f"{column.attribute}.{part}"] for part in ("sec", "nanosec"))
        assert isinstance(seconds, np.ndarray)
        assert isinstance(rest, np.ndarray)
        return seconds[:, 0].astype(np.int64) * SECOND + rest[:, 0]
    values = fields[column.attribute]
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return values
    if isinstance(values, Sequences):
        return Sequences(_numbers_of(column, values.values), values.cuts)
    values = _numbers_of(column, values)
    if column.kind is Kind.SEQUENCE:
        return Sequences.of_counts(values.reshape(-1), np.full(len(values), values.shape[1]))
    return values[:, 0] if column.kind is Kind.NUMBER else values


def _numbers_of(column: Column, values: np.ndarray) -> np.ndarray:
    values = values != 0 if column.dtype.kind == "b" else values
    return values.astype(column.dtype, copy=False)


def _column_of(column: Column, values: list[Any]) -> np.ndarray | Sequences:
    """Return the values of a column from the values in decoded messages."""
    if not values:
        return column.empty
    if column.kind in (Kind.TIME, Kind.DURATION):
        return np.array([each.sec * SECOND + each.nanosec for each in values], np.int64)
    if column.kind is Kind.SEQUENCE:
        return Sequences.of(values, column.dtype)
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return objects([to_plain(each) for each in values])
    return np.array(values, column.dtype)


def _joined(
    column: Column, first: np.ndarray | Sequences, second: np.ndarray | Sequences, order: np.ndarray
) -> np.ndarray | Sequences:
    if isinstance(first, Sequences) and isinstance(second, Sequences):
        if not len(second):
            return first
        return Sequences.of(objects([*first.rows(), *second.rows()])[order], column.dtype)
    assert isinstance(first, np.ndarray)
    assert isinstance(second, np.ndarray)
    return np.concatenate([first, second])[order] if len(second) else first
