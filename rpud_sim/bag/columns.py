"""Columns of a table from the fields of a message type, with units from its comments."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from enum import Enum
from functools import partial
from operator import attrgetter
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.foundation.time import SECOND

_GREATEST = 1e150  # squares of values beyond would overflow

COLUMNS_LIMIT = 10_000  # greatest number of columns of a table

# Columns of every table; a field with such a name gets underscores until it is unique.
RECEIVED = ("log_time", "publish_time")

_TIME, _DURATION = "builtin_interfaces/msg/Time", "builtin_interfaces/msg/Duration"
_DTYPES = {"bool": np.dtype(bool), "byte": np.dtype(np.uint8), "char": np.dtype(np.uint8)}
_TYPE_LINE = re.compile(r"^={80}\s*^MSG: *(\S+)[^\n]*$", re.MULTILINE)
_FIELD_LINE = re.compile(r"^ *[^\s#]+ +(\w+)[^#\n=]*#+ *(.*?) *$", re.MULTILINE)
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


@dataclass(frozen=True)
class Column:
    """One column of a table."""

    name: str  # of the field, with dots between messages and the fields in them
    kind: Kind  # of its values
    dtype: np.dtype = np.dtype(object)  # noqa: RUF009 - it never changes
    length: int = 0  # of an array
    unit: str = ""  # from the comment behind the field; empty without one
    description: str = ""  # the comment; empty without one
    attribute: str = ""  # of the field in decoded messages, with dots; empty if there is no field

    def values(self, messages: Sequence[Any]) -> np.ndarray | Sequences:
        """Return the values of decoded messages, one for each, in the form of ``kind``.

        Those of a sequence of numbers are ``Sequences``. Values that do not fit raise a ValueError
        or an OverflowError.
        """
        found = [*map(attrgetter(self.attribute), messages)]
        if self.kind is Kind.NUMBER:
            if self.dtype == np.uint8:  # the library has single bytes with a sign
                return np.array(found, np.int16).astype(np.uint8)
            return np.array(found, self.dtype)
        if self.kind in (Kind.TIME, Kind.DURATION):
            seconds = np.array([time.sec for time in found], np.int64)
            return seconds * SECOND + np.array([time.nanosec for time in found], np.int64)
        if self.kind is Kind.ARRAY:
            numbers = np.array(found).reshape(len(found), self.length)
            return numbers.astype(self.dtype, copy=False)
        if self.kind is Kind.SEQUENCE:
            return Sequences.of(found, self.dtype)
        if self.kind is Kind.NESTED:
            return objects([to_plain(value) for value in found])
        return objects(found)


@dataclass(frozen=True)
class Sequences:
    """Sequences of numbers, one for each message."""

    values: np.ndarray  # of all of them, one behind the other
    counts: np.ndarray  # numbers in each, int64, shape (n,)

    @classmethod
    def of(cls, rows: Iterable[np.ndarray], dtype: np.dtype) -> Sequences:
        parts = [part.astype(dtype, copy=False) for part in rows]
        counts = np.array([len(part) for part in parts], np.int64)
        return cls(np.concatenate([np.empty(0, dtype), *parts]), counts)

    def rows(self) -> np.ndarray:
        """Return an array of arrays, views of ``values``."""
        ends = np.cumsum(self.counts).tolist()
        starts = [0, *ends[:-1]]
        return objects([self.values[i:j] for i, j in zip(starts, ends, strict=False)])


def columns_of(codec: Codec, definition: str) -> tuple[Column, ...]:
    """Return the columns of a type in the order of its fields; messages give one for each field."""
    columns: list[Column] = []
    taken = {*RECEIVED}
    comments = _comments(codec.type_name, definition)
    for column in _columns(codec, comments, codec.type_name, "", "", ""):
        name = column.name
        while name in taken:
            name += "_"
        taken.add(name)
        columns.append(replace(column, name=name))
        if len(columns) > COLUMNS_LIMIT:
            raise BagFormatError(
                f"{codec.type_name:.80} has more than {COLUMNS_LIMIT} fields, too many for a table"
            )
    return tuple(columns)


def _columns(
    codec: Codec,
    comments: dict[tuple[str, str], str],
    type_name: str,
    names: str,
    attributes: str,
    outer_unit: str,
) -> Iterator[Column]:
    for name, attribute, (node, description) in codec.fields(type_name):
        comment = comments.get((type_name, name), "")
        units = _UNIT.findall(comment)
        unit = units[0] if len(units) == 1 else outer_unit
        name, attribute = names + name, attributes + attribute

        column = partial(Column, name, unit=unit, description=comment, attribute=attribute)
        if node == Nodetype.BASE:
            dtype = _dtype(description)
            yield column(Kind.NUMBER, dtype) if dtype else column(Kind.TEXT)
        elif node == Nodetype.NAME and description in (_TIME, _DURATION):
            kind = Kind.TIME if description == _TIME else Kind.DURATION
            yield column(kind, np.dtype(np.int64))
        elif node == Nodetype.NAME:
            yield from _columns(codec, comments, description, f"{name}.", f"{attribute}.", unit)
        else:
            (element, item), length = description
            dtype = _dtype(item) if element == Nodetype.BASE else None
            if dtype is None:
                yield column(Kind.NESTED)
            elif node == Nodetype.ARRAY:
                yield column(Kind.ARRAY, dtype, length)
            else:
                yield column(Kind.SEQUENCE, dtype)


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
    if hasattr(value, "__msgtype__"):
        fields = {name: item for name, item in vars(value).items() if name != "__msgtype__"}
        return {name: to_plain(item) for name, item in fields.items()}
    return value


def _dtype(base: tuple[str, int]) -> np.dtype | None:
    """Return the dtype of a primitive type; None for texts."""
    name, _ = base
    if name in ("string", "wstring"):
        return None
    return _DTYPES.get(name) or np.dtype(name)


def _comments(type_name: str, definition: str) -> dict[tuple[str, str], str]:
    names = [type_name]
    texts = _TYPE_LINE.split(definition)
    names += [_long_name(name) for name in texts[1::2]]
    return {
        (name, field): comment
        for name, text in zip(names, texts[::2], strict=True)
        for field, comment in _FIELD_LINE.findall(text)
    }


def _long_name(name: str) -> str:
    package, _, short = name.rpartition("/")
    return f"{package.removesuffix('/msg')}/msg/{short}"


def usable(values: np.ndarray) -> np.ndarray:
    """Return which values can be counted and drawn: finite ones, and not beyond 1e150."""
    return np.abs(values.astype(float, copy=False)) < _GREATEST
