"""Memory that a decoded message takes, calculated before it is decoded."""

from __future__ import annotations

import struct
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP
from rosbags.typesys.store import Typestore

from rpud_sim.bag.errors import BagFormatError

DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, with those of its members

# Bytes that parts of a message take as objects, as plain values, and as text.
_MEMBER = 500  # a message within a message
_FIELD = 100
_BYTE = 6  # for each byte of texts, and of sequences and arrays of numbers
_LEAST_NUMBER = 10  # in sequences and arrays: Parquet adds levels to each
_TEXTS = ("string", "wstring")
_LEAST_TEXT = 5  # its length, and the zero at its end


class _Shape(NamedTuple):
    fields: int  # number of fields
    memory: int  # that it takes without the content of texts and sequences [bytes]
    size: int  # least number of bytes in the message
    share: float  # greatest memory for each byte of texts and sequences [bytes]


class Budget:
    """Bounds of the memory that decoded messages of one type take."""

    def __init__(self, store: Typestore, type_name: str) -> None:
        self._store = store
        self._type = type_name
        self._shapes: dict[str, _Shape] = {}
        self._whole = self._member(type_name)

    def most(self, size: int) -> int:
        """Return the greatest memory that a message of ``size`` bytes takes [bytes]."""
        return self._whole.memory + int(size * self._whole.share)

    def sizes(self, sizes: np.ndarray) -> np.ndarray:
        """Return ``most`` of many sizes [bytes]."""
        return self._whole.memory + (sizes * self._whole.share).astype(np.int64)

    def largest(self, memory: int) -> int:
        """Return a size of messages up to which ``most`` is not more than ``memory`` [bytes]."""
        left = memory - self._whole.memory
        if not self._whole.share:
            return 2**62 if left >= 0 else 0
        return int(left / self._whole.share)

    def check(self, data: bytes) -> None:
        """Check that a message takes at most ``DECODED_LIMIT``."""
        if self.most(len(data)) > DECODED_LIMIT:
            _Walk(self, data).member(self._type, 4)

    def shape(self, node: Nodetype, described: Any) -> _Shape:
        if node == Nodetype.NAME:
            return self._member(described)
        if node == Nodetype.BASE:
            if described[0] in _TEXTS:
                return _Shape(1, _FIELD, _LEAST_TEXT, _BYTE)
            return _Shape(1, _FIELD, SIZEMAP[described[0]], 0.0)
        element, count = described
        each = self.shape(*element)
        if node == Nodetype.SEQUENCE:
            memory = _number(each.size) if _is_number(*element) else each.memory
            return _Shape(1, _FIELD, 4, max(memory / each.size, each.share))
        if _is_number(*element):
            return _Shape(1, _FIELD + count * _number(each.size), count * each.size, 0.0)
        return _Shape(
            1 + count * each.fields, _FIELD + count * each.memory, count * each.size, each.share
        )

    def _member(self, type_name: str) -> _Shape:
        if type_name not in self._shapes:
            parts = [self.shape(*field) for _, field in self._store.fielddefs[type_name][1]]
            fields, memory, size, shares = zip(*parts, strict=True)
            if sum(fields) > FIELDS_LIMIT:
                raise BagFormatError(
                    f"{type_name:.80} has {sum(fields)} fields with those of its members; "
                    f"at most {FIELDS_LIMIT} are read"
                )
            self._shapes[type_name] = _Shape(
                1 + sum(fields), _MEMBER + sum(memory), max(1, sum(size)), max(shares)
            )
        return self._shapes[type_name]

    @cached_property
    def members(self) -> dict[str, list[Any]]:
        return {
            name: [field for _, field in self._store.fielddefs[name][1]] for name in self._shapes
        }


def _number(size: int) -> int:
    """Return the memory of a number of ``size`` bytes in a sequence or array [bytes]."""
    return max(_LEAST_NUMBER, size * _BYTE)


def _is_number(node: Nodetype, described: Any) -> bool:
    return node == Nodetype.BASE and described[0] not in _TEXTS


class _Walk:
    def __init__(self, budget: Budget, data: bytes) -> None:
        self._budget = budget
        self._data = data
        self._length = struct.Struct("<I" if data[1:2] == b"\x01" else ">I")
        self._memory = budget.most(0)

    def member(self, type_name: str, place: int) -> int:
        """Add a message's fields and return its end, which may be behind the end of the data."""
        for node, described in self._budget.members[type_name]:
            place = self._field(node, described, place)
        return place

    def _field(self, node: Nodetype, described: Any, place: int) -> int:
        if node == Nodetype.NAME:
            return self.member(described, place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            count, place = self._count(place)
            self._add(count * _BYTE)
            return place + count
        if node == Nodetype.BASE:
            return _aligned(place, SIZEMAP[described[0]]) + SIZEMAP[described[0]]
        element, count = described
        if node == Nodetype.SEQUENCE:
            count, place = self._count(place)
            shape = self._budget.shape(*element)
            each = _number(shape.size) if _is_number(*element) else shape.memory
            self._add(count * each)
        if _is_number(*element):
            size = SIZEMAP[element[1][0]]
            return _aligned(place, size) + count * size if count else place
        for _ in range(count):
            if place >= len(self._data):
                break
            place = self._field(element[0], element[1], place)
        return place

    def _count(self, place: int) -> tuple[int, int]:
        """Return a length and the place behind it; 0 beyond the end, which decoding reports."""
        place = _aligned(place, 4)
        if place + 4 > len(self._data):
            return 0, place + 4
        return self._length.unpack_from(self._data, place)[0], place + 4

    def _add(self, memory: int) -> None:
        self._memory += memory
        if self._memory > DECODED_LIMIT:
            raise BagFormatError(
                f"a message of {len(self._data)} bytes takes {self._memory} or more when it is "
                f"decoded; at most {DECODED_LIMIT} are read"
            )


def _aligned(place: int, size: int) -> int:
    return place + (4 - place) % size  # alignment counts from behind the encapsulation
