"""Batches: messages of a topic as columns."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from itertools import groupby
from operator import attrgetter, itemgetter
from typing import Any

import numpy as np

from rpud_sim.foundation.values import Sequences
from rpud_sim.simulation.topics import Fields

# A message: simulation time at which it is published [ns], topic, fields.
Row = tuple[int, str, Fields]

_TYPE_CODES = {np.dtype(np.int64): "q", np.dtype(np.float64): "d", np.dtype(np.uint8): "B"}


@dataclass(frozen=True)
class Batch:
    """Messages of one topic, in order, as columns."""

    topic: str  # its name
    times: np.ndarray  # simulation time at which each is published [ns], shape (n,), int64
    # as of one message, with an array in place of each value that differs. A sequence has a
    # row for each message, or is ``Sequences``.
    fields: Fields
    # Messages of batches of one span alternate by their places; 0 if they follow each other.
    span: int = 0
    places: np.ndarray | None = None  # of each in the span, ascending, shape (n,), int64

    @staticmethod
    def of(time: int, topic: str, fields: Fields) -> Batch:
        """Return a batch of one message."""
        return Batch(topic, np.array([time], np.int64), fields)

    def __len__(self) -> int:
        return len(self.times)

    def row(self, number: int) -> Fields:
        """Return the fields of one message."""
        return _row(self.fields, number)

    def rows(self) -> Iterator[Row]:
        for number, time in enumerate(self.times.tolist()):
            yield time, self.topic, self.row(number)


def to_array(values: np.ndarray) -> array[Any]:
    """Return a copy of a NumPy array as the array type that message fields accept."""
    return array(_TYPE_CODES[values.dtype], np.ascontiguousarray(values).tobytes())


def _row(fields: Fields, number: int) -> Fields:
    row = {}
    for name, column in fields.items():
        kind = type(column)
        if kind is np.ndarray:
            row[name] = column.item(number) if column.ndim == 1 else to_array(column[number])
        elif kind is dict:
            row[name] = _row(column, number)
        elif kind is Sequences:
            row[name] = to_array(column.sequence(number))
        else:
            row[name] = list(column) if kind is list else column
    return row


def spans(batches: Iterable[Batch]) -> Iterator[list[Batch]]:
    """Yield batches whose messages alternate together, and each of the others by itself."""
    for span, group in groupby(batches, attrgetter("span")):
        if span:
            yield list(group)
        else:
            yield from ([batch] for batch in group)


def rows_of(batches: Iterable[Batch]) -> Iterator[Row]:
    """Yield the messages of batches one by one, in the order in which they are published."""
    for together in spans(batches):
        if len(together) == 1:
            yield from together[0].rows()
            continue
        found = [
            (place, number, batch)
            for batch in together
            if batch.places is not None
            for number, place in enumerate(batch.places.tolist())
        ]
        for _, number, batch in sorted(found, key=itemgetter(0)):
            yield int(batch.times[number]), batch.topic, batch.row(number)
