"""Columns of a table from the fields of a message type, with units from its comments."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from itertools import pairwise
from operator import attrgetter
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.batches import SerializedBatch, gathered, items
from rpud_sim.bag.cdr import (
    DECODED_LIMIT,
    HEAD,
    PADDING,
    UNUSED,
    Codec,
    aligned,
    is_number,
    number_dtype,
)
from rpud_sim.bag.encoder import Decoded
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Ragged

_GREATEST = 1e150  # squares of values beyond would overflow

COLUMNS_LIMIT = 10_000  # greatest number of columns of a table

# Columns of every table; a field with such a name gets underscores until it is unique.
RECEIVED = ("log_time", "publish_time")

_DTYPES = {"bool": np.dtype(bool), "byte": np.dtype(np.uint8), "char": np.dtype(np.uint8)}
_TYPE_LINE = re.compile(r"^={80}\s*^MSG: *(\S+)[^\n]*$", re.MULTILINE)
_FIELD_LINE = re.compile(r"^ *[^\s#]+ +(\w+)[^#\n=]*#+ *(.*?) *$", re.MULTILINE)
_TEXT = (Nodetype.BASE, ("string", 0))  # type of a text in ``rosbags``
_LEAST_TOGETHER = 4  # messages; fewer are decoded faster one by one
_KNOWN_TEXTS = 1000
_MOST_TEXTS = 1000  # of a list in messages that are read together
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
_TIME_FIELDS = [("sec", ("int32", 0)), ("nanosec", ("uint32", 0))]


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str  # of the field, with dots between messages and the fields in them
    kind: Kind  # of its values
    dtype: np.dtype = np.dtype(object)  # noqa: RUF009 - it never changes
    length: int = 0  # of an array
    unit: str = ""  # from the comment behind the field; empty without one
    description: str = ""  # the comment; empty without one
    attribute: str = ""  # of decoded messages, with dots; empty if there is no field

    @property
    def empty(self) -> np.ndarray | Ragged:
        """Values of no message, in the form of ``kind``; those of a sequence are ``Ragged``."""
        if self.kind is Kind.SEQUENCE:
            return Ragged.of([], self.dtype)
        return np.empty((0, self.length) if self.kind is Kind.ARRAY else 0, self.dtype)


def columns_of(codec: Codec, definition: str) -> tuple[Column, ...]:
    """Return the columns of a type in the order of its fields; messages give one for each field."""
    columns: list[Column] = []
    taken = {*RECEIVED}
    comments = _comments(codec.type, definition)
    for column in _columns(codec, comments, codec.type, "", ""):
        name = column.name
        while name in taken:
            name += "_"
        taken.add(name)
        columns.append(replace(column, name=name))
        if len(columns) > COLUMNS_LIMIT:
            raise BagFormatError(
                f"{codec.type:.80} has more than {COLUMNS_LIMIT} fields, too many for a table"
            )
    return tuple(columns)


def _columns(
    codec: Codec,
    comments: dict[tuple[str, str], str],
    type_name: str,
    names: str,
    outer_unit: str,
) -> Iterator[Column]:
    for name, (node, description) in codec.fields(type_name):
        comment = comments.get((type_name, name), "")
        units = _UNIT.findall(comment)
        unit = units[0] if len(units) == 1 else outer_unit
        name = names + name

        column = partial(Column, name, unit=unit, description=comment, attribute=name)
        if node == Nodetype.BASE:
            dtype = _dtype(description)
            yield column(Kind.NUMBER, dtype) if dtype else column(Kind.TEXT)
        elif node == Nodetype.NAME and (kind := _time_kind(codec, description)):
            yield column(kind, np.dtype(np.int64))
        elif node == Nodetype.NAME:
            yield from _columns(codec, comments, description, f"{name}.", unit)
        else:
            (element, item), length = description
            dtype = _dtype(item) if element == Nodetype.BASE else None
            if dtype is None:
                yield column(Kind.NESTED)
            elif node == Nodetype.ARRAY:
                yield column(Kind.ARRAY, dtype, length)
            else:
                yield column(Kind.SEQUENCE, dtype)


def _time_kind(codec: Codec, type_name: str) -> Kind | None:
    """Return the kind of a time or duration; a bag may define these types otherwise."""
    if [(name, kind[1]) for name, kind in codec.fields(type_name)] != _TIME_FIELDS:
        return None
    return _TIME_KINDS.get(type_name)


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


def _dtype(base: tuple[str, int]) -> np.dtype | None:
    """Return the dtype of a primitive type; None for a text."""
    name, _ = base
    return None if name == "string" else _DTYPES.get(name) or np.dtype(name)


def _comments(type_name: str, definition: str) -> dict[tuple[str, str], str]:
    """Return the comments behind fields, by the long name of their type and their own."""
    texts = _TYPE_LINE.split(definition)
    names = [type_name]
    for name in texts[1::2]:
        package, _, short = name.rpartition("/")
        names.append(f"{package.removesuffix('/msg')}/msg/{short}")
    return {
        (name, field): comment
        for name, text in zip(names, texts[::2], strict=True)
        for field, comment in _FIELD_LINE.findall(text)
    }


def usable(values: np.ndarray) -> np.ndarray:
    """Return which values can be counted and drawn: finite ones, and not beyond 1e150."""
    return np.abs(values.astype(float, copy=False)) < _GREATEST


@dataclass(frozen=True)
class FieldValues:
    """Values of fields of a batch's messages."""

    rows: np.ndarray  # places of the readable messages in the batch, in their order, shape (n,)
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
    """Reader of some columns of one type, from many messages together.

    It goes from field to field in all messages at once. Messages that are not as the others, and
    all of a type with lists of messages, are decoded one by one.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)
        self._fields = _flat_fields(codec, codec.type, "")

    def read(self, batch: SerializedBatch) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        together = np.arange(len(batch) if self._fields is not None else 0)
        found: dict[str, np.ndarray | Ragged] = {}
        while len(together) >= _LEAST_TOGETHER:
            try:
                fields = _Walk(self._codec, batch.part(together)).read(self._fields or ())
                found = {each.name: _column(each, fields) for each in self._columns}
                break
            except _OddMessages as odd:
                together = together[~odd.messages]
        else:
            together = together[:0]
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


def _flat_fields(
    codec: Codec, type_name: str, prefix: str
) -> list[tuple[str, Nodetype, Any]] | None:
    """Return path and type of each field, also of members; None with lists of messages."""
    found: list[tuple[str, Nodetype, Any]] = []
    fields = codec.fields(type_name)
    for name, (node, described) in fields:
        if node == Nodetype.NAME:
            inner = _flat_fields(codec, described, f"{prefix}{name}.")
            if inner is None:
                return None
            found += inner
        elif node != Nodetype.BASE and described[0][0] == Nodetype.NAME:
            return None
        else:
            found.append((prefix + name, node, described))
    if not fields:
        found.append((prefix, Nodetype.BASE, ("uint8", 0)))  # CDR needs a field
    return found


class _OddMessages(Exception):  # noqa: N818 - it is no error of a user's
    """Messages that cannot be read together with the others."""

    def __init__(self, messages: np.ndarray) -> None:
        super().__init__()
        self.messages = messages  # whether each is one, shape (n,)


# Place or length in messages: one for all, or of each.
_Places: TypeAlias = "int | np.ndarray"


class _Walk:
    """Walk from field to field in all messages of a batch at once."""

    def __init__(self, codec: Codec, batch: SerializedBatch) -> None:
        self._codec = codec
        self._data, self._starts, self._sizes = batch.data, batch.starts, batch.sizes
        self._place: _Places = HEAD
        self._memory: _Places = codec.shape.memory
        self._spare: _Places = PADDING

    def read(self, fields: Sequence[tuple[str, Nodetype, Any]]) -> dict[str, np.ndarray | Ragged]:
        """Return the values of each field by its path; a row of numbers for each message."""
        self._check(self._sizes >= HEAD)
        self._check(items(self._data, "<u2")[self._starts] == 0x0100)  # little-endian
        found: dict[str, np.ndarray | Ragged] = {}
        for path, node, described in fields:
            element, count = ((node, described), 1) if node == Nodetype.BASE else described
            if node == Nodetype.SEQUENCE:
                shape = self._codec.shape_of(*element)
                count = self._length(shape.size, self._codec.element_memory(*element))
            if is_number(*element):
                found[path] = self._numbers(number_dtype(element[1][0]), count)
            elif node == Nodetype.BASE:
                found[path] = objects(self._texts())
            else:
                found[path] = objects(self._lists_of_texts(count))
        end = np.asarray(self._place)
        self._check((end <= self._sizes) & (self._sizes <= end + self._spare))
        self._check(np.asarray(self._memory) <= DECODED_LIMIT)
        return found

    def _check(self, fits: np.ndarray) -> None:
        if not fits.all():
            raise _OddMessages(~np.broadcast_to(fits, len(self._starts)))

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

    def _numbers(self, dtype: np.dtype, count: _Places) -> np.ndarray | Ragged:
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
            return Ragged.of_counts(values, count)
        return values.reshape(len(starts), count)

    def _texts(self) -> list[str]:
        counts = self._length(1, self._codec.shape_of(*_TEXT).growth)
        self._check(np.asarray(counts) >= 1)
        starts = self._starts + self._place
        self._place = self._place + counts
        self._check(self._data[self._starts + self._place - 1] == 0)
        ends = starts + counts - 1
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
        elements = [self._texts() for _ in range(int(np.max(count)))]
        rows = zip(*elements, strict=True) if elements else [()] * len(self._starts)
        return [list(row) for row in rows]


def _column(column: Column, fields: Mapping[str, np.ndarray | Ragged]) -> np.ndarray | Ragged:
    """Return the values of a column from those of fields by their paths."""
    if column.kind in (Kind.TIME, Kind.DURATION):
        seconds, rest = (fields[f"{column.attribute}.{part}"] for part in ("sec", "nanosec"))
        assert isinstance(seconds, np.ndarray)
        assert isinstance(rest, np.ndarray)
        return seconds[:, 0].astype(np.int64) * SECOND + rest[:, 0]
    values = fields[column.attribute]
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return values
    if isinstance(values, Ragged):
        return Ragged(_numbers_of(column, values.values), values.cuts)
    values = _numbers_of(column, values)
    if column.kind is Kind.SEQUENCE:
        return Ragged.of_counts(values.reshape(-1), np.full(len(values), values.shape[1]))
    return values[:, 0] if column.kind is Kind.NUMBER else values


def _numbers_of(column: Column, values: np.ndarray) -> np.ndarray:
    values = values != 0 if column.dtype.kind == "b" else values
    return values.astype(column.dtype, copy=False)


def _column_of(column: Column, values: list[Any]) -> np.ndarray | Ragged:
    """Return the values of a column from those of decoded messages."""
    if not values:
        return column.empty
    if column.kind in (Kind.TIME, Kind.DURATION):
        return np.array([each.sec * SECOND + each.nanosec for each in values], np.int64)
    if column.kind is Kind.SEQUENCE:
        return Ragged.of(values, column.dtype)
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return objects([to_plain(each) for each in values])
    return np.array(values, column.dtype)


def _joined(
    column: Column, first: np.ndarray | Ragged, second: np.ndarray | Ragged, order: np.ndarray
) -> np.ndarray | Ragged:
    if isinstance(first, Ragged) and isinstance(second, Ragged):
        if not len(second):
            return first
        return Ragged.of(objects([*first.rows(), *second.rows()])[order], column.dtype)
    assert isinstance(first, np.ndarray)
    assert isinstance(second, np.ndarray)
    return np.concatenate([first, second])[order] if len(second) else first


# Column with the exact time of each row.
TIME = Column("time", Kind.TIME, np.dtype(np.int64), description="of the sample or segment")

# Columns from which the time of a row is calculated, by type.
_TIME_COLUMNS = {
    "rpud_msgs/msg/Trajectory": {"origin", "sequence", "start_seconds", "start_fraction"},
    "rpud_msgs/msg/Waveform": {"header.stamp", "sample_period", "sequence"},
}
_MAX_DURATION = 7e9  # s; with any stamp the times are 64-bit nanoseconds


def holds_rows(type_name: str, columns: tuple[Column, ...]) -> bool:
    """Return whether messages of a type with these columns are blocks of rows."""
    names = {column.name for column in columns}
    simple = all(column.kind not in (Kind.ARRAY, Kind.NESTED) for column in columns)
    return type_name in _TIME_COLUMNS and _TIME_COLUMNS[type_name] <= names and simple


def row_columns(columns: tuple[Column, ...]) -> tuple[Column, ...]:
    """Return the columns of the table of rows: ``TIME``, and numbers in place of sequences."""
    return (
        TIME,
        *(
            replace(column, kind=Kind.NUMBER) if column.kind is Kind.SEQUENCE else column
            for column in columns
        ),
    )


def to_rows(
    columns: tuple[Column, ...], blocks: Mapping[str, np.ndarray | Ragged]
) -> dict[str, np.ndarray]:
    """Return the values of ``row_columns``, one for each row, from those of each block.

    Each row has the values that its block has once. ``sequence`` is the number of the row.
    """
    sequences = {name: each for name, each in blocks.items() if isinstance(each, Ragged)}
    single = {name: each for name, each in blocks.items() if not isinstance(each, Ragged)}
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
    # Blocks of one rate together: the offsets of one block take as long as those of a hundred.
    edges = np.flatnonzero(np.diff(periods, prepend=np.nan, append=np.nan))
    for start, end in pairwise(edges.tolist()):
        offsets.append(_offsets(float(periods[start]), firsts[start:end], counts[start:end]))
    return np.repeat(stamps, counts) + np.concatenate(offsets)


def _offsets(period: float, firsts: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """Return the times of samples after the first of their block [ns].

    At a whole rate each time is rounded as that of the first one. Otherwise the times of samples
    would depend on how they are divided into blocks. ``period`` is in s.
    """
    most = int(counts.max())
    if not (math.isfinite(period) and period > 0.0 and period * most < _MAX_DURATION):
        count = int(counts[0])
        raise BagFormatError(f"sample_period = {period:g} s is no time between {count} samples")
    numbers = np.arange(counts.sum()) - np.repeat(np.cumsum(counts) - counts, counts)
    rate = round(1.0 / period) if period > 1.0 / SECOND else 0
    if rate and abs(rate * period - 1.0) < 1e-12:
        starts = np.repeat((firsts % np.uint64(rate)).astype(np.int64), counts)
        return (starts + numbers) * SECOND // rate - starts * SECOND // rate
    return np.rint(numbers * (period * SECOND)).astype(np.int64)
