"""Values of the fields of many messages of one type, without decoding each message."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Column, Kind, objects
from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.layout import DECODED_LIMIT, HEAD, Field, Layout
from rpud_sim.bag.messages import MessageBlock, gathered, items
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Ragged

_LEAST = 8  # messages of one layout that are not decoded one by one
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
    same places: those are found in one message, and read in all. Other messages are decoded one by
    one: lists of messages, the few of a layout, and what is not of the type, for the reason.
    """

    def __init__(self, codec: Codec, columns: Sequence[Column]) -> None:
        self._codec = codec
        self._columns = tuple(columns)
        self._largest = codec.type.largest(DECODED_LIMIT)

    def read(self, block: MessageBlock) -> FieldValues:
        """Return the values of messages; those that are not of the type are among the errors."""
        parts = self._laid_out(block)
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
                if len(rows) < _LEAST or not HEAD <= block.sizes[rows[0]] <= self._largest:
                    break
                layout = Layout.of(self._codec.type, block.message(int(rows[0])))
                same = np.arange(len(rows)) == 0
                if layout is not None:
                    same = layout.fits(block.data, block.starts[rows])
                    chosen = rows[same]
                    starts = block.starts[chosen]
                    # A KeyError is of a list of messages, whose places are not known.
                    with suppress(KeyError, UnicodeDecodeError):
                        values = {
                            column.name: _column(layout.fields, column, block.data, starts)
                            for column in self._columns
                        }
                        found.append((chosen, values))
                rows = rows[~same]
        return found


def _column(
    fields: Mapping[str, Field], column: Column, data: np.ndarray, starts: np.ndarray
) -> np.ndarray | Ragged:
    """Return the values of a column from messages whose fields have the same places."""
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


def _together(parts: list[np.ndarray | Ragged], order: np.ndarray) -> np.ndarray | Ragged:
    if len(parts) == 1:
        return parts[0]
    ragged = [part for part in parts if isinstance(part, Ragged)]
    if ragged:
        rows = objects([row for part in ragged for row in part.rows()])[order]
        return Ragged.of(rows, ragged[0].values.dtype)
    return np.concatenate([part for part in parts if not isinstance(part, Ragged)])[order]
