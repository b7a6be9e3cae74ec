"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from operator import attrgetter
from typing import Any

import numpy as np

from rpud_sim.bag.batches import SerializedBatch, gathered, items
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Column, Kind, objects, to_plain
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.layout import Field, ReadMessage
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Ragged

_MOST_LAYOUTS = 100  # of messages of one size
_KNOWN_TEXTS = 1000


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
    same places: those are found in one message, and read in all. Messages with lists of messages
    are read one by one.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)

    def read(self, block: SerializedBatch) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        places: list[np.ndarray] = []
        values: dict[str, list[np.ndarray | Ragged]] = {each.name: [] for each in self._columns}
        errors: list[tuple[int, str]] = []
        order = np.argsort(block.sizes, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(block.sizes[order])) + 1):
            layouts = 0
            while len(rows):
                same, rest = rows[:1], rows[1:]
                try:
                    first = self._codec.read(block.message(int(same[0])), noted=True)
                    if layouts < _MOST_LAYOUTS and self._has_places(first):
                        fitting = first.fits(block.data, block.starts[rest])
                        same, rest = np.append(same, rest[fitting]), rest[~fitting]
                    starts = block.starts[same]
                    found = [_column(first, each, block.data, starts) for each in self._columns]
                except BagFormatError as error:
                    errors.append((int(same[0]), str(error)))
                except UnicodeDecodeError:  # of another one: each by itself from now on
                    layouts, rest = _MOST_LAYOUTS, rows
                else:
                    layouts += 1
                    places.append(same)
                    for column, each in zip(self._columns, found, strict=True):
                        values[column.name].append(each)
                rows = rest
        rows_of_all = np.concatenate([np.empty(0, np.intp), *places])
        order = np.argsort(rows_of_all, kind="stable")
        joined = {each.name: _together(each, values[each.name], order) for each in self._columns}
        return FieldValues(rows_of_all[order], joined, tuple(sorted(errors)))

    def _has_places(self, message: ReadMessage) -> bool:
        nested = (each.attribute for each in self._columns if each.kind is Kind.NESTED)
        return all(attribute in message.fields for attribute in nested)


def _column(
    message: ReadMessage, column: Column, data: np.ndarray, starts: np.ndarray
) -> np.ndarray | Ragged:
    """Return the values of a column from messages that have their fields where ``message`` has."""
    fields = message.fields
    if column.kind is Kind.NESTED and column.attribute not in fields:
        return objects([to_plain(attrgetter(column.attribute)(message.values))])
    if column.kind in (Kind.TIME, Kind.DURATION):
        parts = [fields[f"{column.attribute}.{part}"] for part in ("sec", "nanosec")]
        seconds, rest = (_numbers(part, data, starts) for part in parts)
        return seconds[:, 0].astype(np.int64) * SECOND + rest[:, 0]
    if column.kind in (Kind.TEXT, Kind.NESTED):
        return _texts(fields[column.attribute], data, starts)
    numbers = _numbers(fields[column.attribute], data, starts)
    numbers = numbers != 0 if column.dtype.kind == "b" else numbers
    numbers = numbers.astype(column.dtype, copy=False)
    if column.kind is Kind.NUMBER:
        return numbers[:, 0]
    if column.kind is Kind.ARRAY:
        return numbers
    return Ragged.of_counts(numbers.reshape(-1), np.full(len(numbers), numbers.shape[1]))


def _numbers(field: Field, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the numbers of a field, shape (messages, numbers of each)."""
    place, dtype, count, _ = field
    assert dtype is not None
    if count == 1:
        return items(data, dtype)[starts + place][:, None]
    found = gathered(data, starts + place, np.full(len(starts), count * dtype.itemsize))
    return found.view(dtype).reshape(len(starts), count)


def _texts(field: Field, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
    """Return the texts, or lists of texts, of messages; equal ones are decoded once."""
    place, _, size, texts = field
    content = gathered(data, starts + place, np.full(len(starts), size)).tobytes()
    known: dict[bytes, Any] = {}

    def decoded(part: bytes) -> Any:
        if part not in known:
            if len(known) >= _KNOWN_TEXTS:
                known.clear()
            known[part] = part.decode() if texts is None else [part[t].decode() for t in texts]
        return known[part] if texts is None else [*known[part]]

    if texts is None and content == content[:size] * len(starts):  # as a frame's name
        return np.full(len(starts), decoded(content[:size]), object)
    return objects([decoded(content[k * size : (k + 1) * size]) for k in range(len(starts))])


def _together(
    column: Column, parts: list[np.ndarray | Ragged], order: np.ndarray
) -> np.ndarray | Ragged:
    if len(parts) <= 1:
        return parts[0] if parts else column.empty
    ragged = [part for part in parts if isinstance(part, Ragged)]
    if ragged:
        rows = objects([row for part in ragged for row in part.rows()])[order]
        return Ragged.of(rows, column.dtype)
    return np.concatenate([part for part in parts if not isinstance(part, Ragged)])[order]
