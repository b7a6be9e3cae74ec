"""Places of the fields in a serialized message, and bounds of the memory that it takes decoded."""

from __future__ import annotations

import struct
from typing import Any, NamedTuple, TypeVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from rpud_sim.bag.errors import BagFormatError
from rpud_sim.bag.messages import items

DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, with those of its members
ELEMENTS_LIMIT = 10_000  # greatest number of messages in a sequence whose places are noted

HEAD = 4  # bytes before the first field: the encoding of a message

# Bytes that parts of a message take as objects, as plain values, and as text.
_MEMBER = 500  # a message within a message
_FIELD = 100
_BYTE = 6  # for each byte of texts, and of sequences and arrays of numbers
_LEAST_NUMBER = 10  # in sequences and arrays: Parquet adds levels to each
_TEXTS = ("string", "wstring")
_LEAST_TEXT = 5  # its length, and the zero at its end
_NO_FIELDS = "structure_needs_at_least_one_member"  # field of a type without fields in CDR
_DTYPES = {"bool": "u1", "byte": "u1", "char": "u1"}
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes of numbers, by the beginning of a message

Sizes = TypeVar("Sizes", int, np.ndarray)


class _Shape(NamedTuple):
    fields: int  # number of fields
    memory: int  # that it takes without the content of texts and sequences [bytes]
    size: int  # least number of bytes in the message
    share: int  # greatest memory for each byte of texts and sequences [bytes]


class MessageType:
    """Fields of a type and of those that it needs, and the memory that its messages take."""

    def __init__(self, store: Typestore, name: str) -> None:
        self.name = name
        # name, attribute in decoded messages, and type in ``rosbags`` of the fields, by type
        self.fields: dict[str, list[tuple[str, str, Any]]] = {}
        self._store = store
        self._shapes: dict[str, _Shape] = {}
        self._whole = self._member(name)

    def most(self, size: Sizes) -> Sizes:
        """Return the greatest memory that a message of ``size`` bytes takes [bytes]."""
        return self._whole.memory + size * self._whole.share

    def largest(self, memory: int) -> int:
        """Return a size of messages up to which ``most`` is not more than ``memory`` [bytes]."""
        left = memory - self._whole.memory
        if not self._whole.share:
            return 2**62 if left >= 0 else 0
        return left // self._whole.share

    def check(self, data: bytes) -> None:
        """Check that a message takes at most ``DECODED_LIMIT``."""
        if self.most(len(data)) > DECODED_LIMIT:
            Layout.of(self, data, noted=False)

    def shape(self, node: Nodetype, described: Any) -> _Shape:
        if node == Nodetype.NAME:
            return self._member(described)
        if node == Nodetype.BASE:
            text = described[0] in _TEXTS
            size, share = (_LEAST_TEXT, _BYTE) if text else (SIZEMAP[described[0]], 0)
            return _Shape(1, _FIELD, size, share)
        element, count = described
        each = self.shape(*element)
        memory = _memory(each, *element)
        if node == Nodetype.SEQUENCE:
            return _Shape(1, _FIELD, 4, max(-(-memory // each.size), each.share))
        fields = 1 if is_number(*element) else 1 + count * each.fields
        return _Shape(fields, _FIELD + count * memory, count * each.size, each.share)

    def element_memory(self, node: Nodetype, described: Any) -> int:
        """Return the memory of an element of a sequence, without texts and sequences in it."""
        return _memory(self.shape(node, described), node, described)

    def _member(self, name: str) -> _Shape:
        if name not in self._shapes:
            fields = self._store.fielddefs[name][1]
            parts = [self.shape(*field) for _, field in fields]
            counts, memory, size, shares = zip(*parts, strict=True)
            if sum(counts) > FIELDS_LIMIT:
                raise BagFormatError(
                    f"{name:.80} has {sum(counts)} fields with those of its members; "
                    f"at most {FIELDS_LIMIT} are read"
                )
            shape = _Shape(1 + sum(counts), _MEMBER + sum(memory), max(1, sum(size)), max(shares))
            self._shapes[name] = shape
            self.fields[name] = [
                (own, normalize_fieldname(own), kind) for own, kind in fields if own != _NO_FIELDS
            ]
        return self._shapes[name]


def _memory(shape: _Shape, node: Nodetype, described: Any) -> int:
    if is_number(node, described):
        return max(_LEAST_NUMBER, shape.size * _BYTE)
    return shape.memory


def is_number(node: Nodetype, described: Any) -> bool:
    """Return whether a type in ``rosbags`` is a number."""
    return node == Nodetype.BASE and described[0] not in _TEXTS


class Field(NamedTuple):
    """One field of a message."""

    place: int  # of its first byte [bytes]
    dtype: np.dtype | None  # of its numbers, as they are in the message; None for texts
    length: int  # of the numbers, or of the bytes
    texts: tuple[slice, ...] | None = None  # those of a list, from the first byte


class _NotOfTypeError(Exception):
    """Error of a message that is not of the type, or of too many parts."""


class Layout:
    """Places of the fields of a message, and what others have at the same places."""

    def __init__(self, kind: MessageType, message: bytes, noted: bool) -> None:
        self.fields: dict[str, Field] = {}  # by attribute
        self.fixed = [(0, "<u2", int.from_bytes(message[:2], "little"))]  # place, dtype, number
        self._kind, self._message, self._noted = kind, message, noted
        self._order = _ORDERS.get(message[:2], "")
        self._memory = kind.most(0)

    @classmethod
    def of(cls, kind: MessageType, message: bytes, noted: bool = True) -> Layout | None:
        """Return the layout of a message; None if it is not of the type, or of too many parts.

        Without ``noted`` it has no places: a message that would take more than ``DECODED_LIMIT`` is
        an error, and others may be anything.
        """
        layout = cls(kind, message, noted)
        try:
            end = layout._member(kind.name, "", HEAD) if layout._order else 0
        except (_NotOfTypeError, struct.error):
            return None
        # Serializers may align the end of a message.
        return layout if end <= len(message) <= end + 3 else None

    def fits(self, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return which messages, of the same size, have this layout."""
        same = np.ones(len(starts), bool)
        for place, dtype, number in self.fixed:
            same &= items(data, dtype)[starts + place] == number
        return same

    def _member(self, type_name: str, prefix: str | None, place: int) -> int:
        """Pass a message and return its end; fields in sequences have no prefix."""
        fields = self._kind.fields[type_name]
        for _, attribute, (node, described) in fields:
            name = None if prefix is None else prefix + attribute
            place = self._field(node, described, name, place)
        return place if fields else place + 1  # CDR needs one member

    def _field(self, node: Nodetype, described: Any, name: str | None, place: int) -> int:
        if node == Nodetype.NAME:
            return self._member(described, None if name is None else f"{name}.", place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            text, end = self._text(place)
            self._note(name, Field(text.start, None, text.stop - text.start))
            return end
        if node == Nodetype.BASE:
            return self._numbers(described[0], 1, name, place)
        (element, item), count = described
        if node == Nodetype.SEQUENCE:
            count, place = self._length(place)
            self._take(count * self._kind.element_memory(element, item))
        if is_number(element, item):
            return self._numbers(item[0], count, name, place)
        if self._noted and count > ELEMENTS_LIMIT:
            raise _NotOfTypeError
        start, texts = place, []
        for _ in range(count):
            if place >= len(self._message):
                raise _NotOfTypeError
            if element == Nodetype.BASE:
                text, place = self._text(place)
                texts.append(slice(text.start - start, text.stop - start))
            else:
                place = self._field(element, item, None, place)
        if element == Nodetype.BASE:
            self._note(name, Field(start, None, place - start, tuple(texts)))
        return place

    def _numbers(self, kind: Any, count: int, name: str | None, place: int) -> int:
        size = SIZEMAP[kind]
        place = _aligned(place, size) if count else place
        if self._noted:
            code = _DTYPES.get(kind) or np.dtype(kind).str[1:]
            self._note(name, Field(place, np.dtype(self._order + code), count))
        return self._reach(place + count * size)

    def _text(self, place: int) -> tuple[slice, int]:
        """Return the place of a text without the zero behind it, and its end."""
        count, place = self._length(place)
        end = self._reach(place + count)
        if self._noted:
            if count < 1 or self._message[end - 1] != 0:
                raise _NotOfTypeError
            self.fixed.append((end - 1, "u1", 0))
        else:
            self._take(count * _BYTE)
        return slice(place, end - 1), end

    def _length(self, place: int) -> tuple[int, int]:
        place = _aligned(place, 4)
        (count,) = struct.unpack_from(f"{self._order}I", self._message, place)
        if self._noted:
            self.fixed.append((place, f"{self._order}u4", count))
        return count, place + 4

    def _reach(self, end: int) -> int:
        if end > len(self._message):
            raise _NotOfTypeError
        return end

    def _note(self, name: str | None, found: Field) -> None:
        if name is not None:
            self.fields[name] = found

    def _take(self, memory: int) -> None:
        self._memory += memory
        if not self._noted and self._memory > DECODED_LIMIT:
            raise BagFormatError(
                f"a message of {len(self._message)} bytes takes {self._memory} or more when it is "
                f"decoded; at most {DECODED_LIMIT} are read"
            )


def _aligned(place: int, size: int) -> int:
    return place + (HEAD - place) % size  # alignment counts from behind the head
