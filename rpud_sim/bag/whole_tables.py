"""Whole tables in memory: the batches of topics as one array for each column, or as a frame."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

import numpy as np

from rpud_sim.bag.columns import Column, Kind, objects
from rpud_sim.bag.errors import BagError
from rpud_sim.bag.tables import Batch, Table

if TYPE_CHECKING:
    import pandas

# Size of messages that are copied into the arrays together [bytes]: a processor's cache holds it. A
# topic that fills half of a chunk is read from the chunk without a copy of its messages.
PART_SIZE = 2**19

# A damaged count of messages must not take all memory. The first step is smaller, since arrays that
# are nearly whole would take long to copy.
_FIRST_GROWTH = 32
_GREATEST_GROWTH = 256


def filled(
    tables: Mapping[str, Table], counts: Mapping[str, int], pieces: Iterable[Batch]
) -> dict[str, dict[str, np.ndarray]]:
    """Return the columns of each topic, from batches that come in any order of topics.

    Arrays are allocated for the counts of messages that the bag holds.
    """
    growing = {name: _Growing(table.columns, counts[name]) for name, table in tables.items()}
    for piece in pieces:
        growing[piece.topic].add(piece)
    for name, table in tables.items():
        if not growing[name].begun:
            growing[name].add(table.empty())
    return {name: each.whole() for name, each in growing.items()}


class _Growing:
    """Columns of one table that grow in arrays allocated for the whole."""

    def __init__(self, columns: Iterable[Column], count: int) -> None:
        self._columns = tuple(columns)
        self._count = count
        self._arrays: dict[str, np.ndarray] = {}
        self._room = self._rows = self._messages = 0

    @property
    def begun(self) -> bool:
        return bool(self._arrays)

    def add(self, batch: Batch) -> None:
        end = self._rows + len(batch)
        self._messages += batch.message_count
        if end > self._room or not self.begun:
            # As many rows in each message that is still to come as in those so far.
            expected = math.ceil(self._count * end / max(self._messages, 1))
            growth = _GREATEST_GROWTH if self.begun else _FIRST_GROWTH
            self._resize(batch, max(end, min(expected, end * growth)))
        for name, array in self._arrays.items():
            array[self._rows : end] = batch.columns[name]
        self._rows = end

    def whole(self) -> dict[str, np.ndarray]:
        for array in self._arrays.values():
            array.resize((self._rows, *array.shape[1:]), refcheck=False)
        return self._arrays

    def _resize(self, batch: Batch, room: int) -> None:
        # Pages that no row reaches take no memory.
        for column in self._columns:
            values = batch.columns[column.name]
            array = np.empty((room, *values.shape[1:]), values.dtype)
            if self.begun and column.name in self._arrays:
                array[: self._rows] = self._arrays[column.name][: self._rows]
            self._arrays[column.name] = array
        self._room = room


def to_frame(table: Table, columns: Mapping[str, np.ndarray]) -> pandas.DataFrame:
    """Return a pandas frame with the first column as index."""
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
