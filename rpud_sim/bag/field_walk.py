"""Places of the fields of many messages of one type, from one walk along all of them."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from rosbags.interfaces import Nodetype

from rpud_sim.bag.cdr import Codec

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
