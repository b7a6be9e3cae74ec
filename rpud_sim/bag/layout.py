"""Serialized messages of a type: their values, the places of the fields, bounds of the memory."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple, TypeVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP

from rpud_sim.bag.batches import items
from rpud_sim.bag.encoder import CODES, Decoded
from rpud_sim.bag.errors import BagFormatError

DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, with those of its members

HEAD = 4  # bytes before the first field: the encoding of a message

# Bytes that parts of a message take as objects, as plain values, and as text.
_MEMBER = 500  # a message within a message
_FIELD = 100
_BYTE = 6  # for each byte of texts, and of sequences and arrays of numbers
_LEAST_NUMBER = 10  # in sequences and arrays: Parquet adds levels to each
_TEXT = "string"
_LEAST_TEXT = 5  # its length, and the zero at its end
_PADDING = 3  # bytes behind the last field, so that messages follow each other aligned
_UNUSED = 8  # bytes that ROS allots each empty sequence, of any content
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes of numbers, by the beginning of a message

Sizes = TypeVar("Sizes", int, np.ndarray)


class Field(NamedTuple):
    """One field of a message."""

    place: int  # of its first byte [bytes]
    dtype: np.dtype | None  # of its numbers, as they are in the message; None for texts
    length: int  # of the numbers, or of the bytes
    texts: tuple[slice, ...] | None = None  # those of a list, from the first byte


class ReadMessage:
    """One message: its values, and the places of its fields, which others may have, too."""

    def __init__(self, message: bytes, order: str, memory: int, noted: bool) -> None:
        self.values: Any = None
        # By name, with dots; those in lists of messages have none. Empty unless ``noted``.
        self.fields: dict[str, Field] = {}
        self.content, self.noted = message, noted
        self._fixed = [(0, "<u2", int.from_bytes(message[:2], "little"))]  # place, dtype, number
        self._order, self._memory = order, memory
        self._spare = _PADDING

    def fits(self, data: np.ndarray, starts: np.ndarray) -> np.ndarray:
        """Return which messages, of the same size, have their fields at the same places."""
        same = np.ones(len(starts), bool)
        for place, dtype, number in self._fixed:
            same &= items(data, dtype)[starts + place] == number
        return same

    def length(self, place: int, least: int, memory: int) -> tuple[int, int]:
        """Return a length and the place behind it.

        Each of so many has at least ``least`` bytes, and takes ``memory`` when it is decoded.
        """
        place = _aligned(place, 4)
        (count,) = struct.unpack_from(f"{self._order}I", self.content, place)
        self.reach(place + 4 + count * least)
        self._memory += count * memory
        if self._memory > DECODED_LIMIT:
            raise BagFormatError(
                f"a message of {len(self.content)} bytes takes {self._memory} or more when it is "
                f"decoded; at most {DECODED_LIMIT} are read"
            )
        if not count:
            self._spare += _UNUSED
        self.note(place, f"{self._order}u4", count)
        return count, place + 4

    def note(self, place: int, dtype: str, number: int) -> None:
        """Note a number that decides where the fields are."""
        if self.noted:
            self._fixed.append((place, dtype, number))

    def reach(self, end: int) -> int:
        if end > len(self.content):
            raise ValueError("it ends too early")
        return end

    def check_end(self, end: int) -> None:
        if not end <= len(self.content) <= end + self._spare:
            raise ValueError(f"{len(self.content) - end} bytes follow its last field")


# Returns the value of a field that begins at a place, and the place behind it.
Step = Callable[[ReadMessage, int], tuple[Any, int]]
# The same of the number of elements: read, or that of an array.
Length = Callable[[ReadMessage, int], tuple[int, int]]


class _Shape(NamedTuple):
    fields: int  # number of fields
    memory: int  # that it takes without the content of texts and sequences [bytes]
    size: int  # least number of bytes in the message
    share: int  # greatest memory for each byte of texts and sequences [bytes]


_NO_FIELDS = _Shape(1, _FIELD, 1, 0)  # of a type without fields: CDR needs one


class MessageType:
    """Fields of a type and of those that it needs, and the memory that its messages take.

    ``types`` are definitions in ``rosbags``.
    """

    def __init__(self, types: Mapping[str, Any], name: str) -> None:
        self.name = name
        # name, and type in ``rosbags``, of the fields, by type
        self.fields: dict[str, list[tuple[str, Any]]] = {}
        self._types = types
        self._shapes: dict[str, _Shape] = {}
        self._whole = self._shape_of_member(name)
        self._steps: dict[str, Step] = {}  # by the order of bytes

    def most(self, size: Sizes) -> Sizes:
        """Return the greatest memory that a message of ``size`` bytes takes [bytes]."""
        return self._whole.memory + size * self._whole.share

    def read(self, message: bytes, noted: bool = False) -> ReadMessage:
        """Return the values of a message, and the places of its fields if they are ``noted``.

        Besides a BagFormatError of a message that would take more than ``DECODED_LIMIT``, what is
        not of the type raises a ValueError or struct.error.
        """
        order = _ORDERS.get(message[:2])
        if order is None:
            raise ValueError("its encapsulation is not plain CDR")
        if order not in self._steps:
            self._steps[order] = _Steps(self, order).member(self.name, "")
        found = ReadMessage(message, order, self._whole.memory, noted)
        found.values, end = self._steps[order](found, HEAD)
        found.check_end(end)
        return found

    def _shape(self, node: Nodetype, described: Any) -> _Shape:
        if node == Nodetype.NAME:
            return self._shape_of_member(described)
        if node == Nodetype.BASE:
            text = described[0] == _TEXT
            size, share = (_LEAST_TEXT, _BYTE) if text else (SIZEMAP[described[0]], 0)
            return _Shape(1, _FIELD, size, share)
        element, count = described
        each = self._shape(*element)
        _, memory = self.element_size(*element)
        if node == Nodetype.SEQUENCE:
            return _Shape(1, _FIELD, 4, max(-(-memory // each.size), each.share))
        fields = 1 if is_number(*element) else 1 + count * each.fields
        return _Shape(fields, _FIELD + count * memory, count * each.size, each.share)

    def element_size(self, node: Nodetype, described: Any) -> tuple[int, int]:
        """Return the least bytes of an element, and its memory without texts and sequences."""
        shape = self._shape(node, described)
        number = is_number(node, described)
        return shape.size, max(_LEAST_NUMBER, shape.size * _BYTE) if number else shape.memory

    def _shape_of_member(self, name: str) -> _Shape:
        if name not in self._shapes:
            fields = self._types[name][1]
            parts = [self._shape(*field) for _, field in fields] or [_NO_FIELDS]
            counts, memory, size, shares = zip(*parts, strict=True)
            if sum(counts) > FIELDS_LIMIT:
                raise BagFormatError(
                    f"{name:.80} has {sum(counts)} fields with those of its members; "
                    f"at most {FIELDS_LIMIT} are read"
                )
            if len(dict(fields)) < len(fields):
                raise ValueError(f"{name:.80} has two fields of one name")
            shape = _Shape(1 + sum(counts), _MEMBER + sum(memory), max(1, sum(size)), max(shares))
            self._shapes[name] = shape
            self.fields[name] = fields
        return self._shapes[name]


def is_number(node: Nodetype, described: Any) -> bool:
    """Return whether a type in ``rosbags`` is a number."""
    return node == Nodetype.BASE and described[0] != _TEXT


class _Steps:
    """Maker of the steps that read messages of one byte order.

    They are made once: to look at the kinds of fields again in each message takes longer than to
    read them. Fields in lists have no path; so the steps of their types are the same everywhere.
    """

    def __init__(self, kind: MessageType, order: str) -> None:
        self._kind, self._order = kind, order
        self._in_lists: dict[str, Step] = {}

    def member(self, type_name: str, prefix: str | None) -> Step:
        steps = [
            (name, self._field(described, None if prefix is None else prefix + name))
            for name, described in self._kind.fields[type_name]
        ]

        def read(found: ReadMessage, place: int) -> tuple[Any, int]:
            values = {}
            for name, step in steps:
                values[name], place = step(found, place)
            return Decoded(type_name, values), place if steps else place + 1  # CDR needs a member

        return read

    def _field(self, kind: tuple[Nodetype, Any], path: str | None) -> Step:
        node, described = kind
        if node == Nodetype.NAME and path is None:
            if described not in self._in_lists:
                self._in_lists[described] = self.member(described, None)
            return self._in_lists[described]
        if node == Nodetype.NAME:
            return self.member(described, f"{path}.")
        if node == Nodetype.BASE:
            return _text_step(path) if described[0] == _TEXT else self._number(described[0], path)
        element, count = described
        least, memory = self._kind.element_size(*element)
        length: Length = partial(_length_of_array, count)
        if node == Nodetype.SEQUENCE:
            length = partial(ReadMessage.length, least=least, memory=memory)
        if is_number(*element):
            return self._numbers(element[1][0], length, path)
        return _list_step(self._field(element, None), element[0], length, path)

    def _number(self, kind: str, path: str | None) -> Step:
        dtype = self._dtype(kind)
        size = dtype.itemsize
        unpack = struct.Struct(self._order + CODES[kind]).unpack_from

        def read(found: ReadMessage, place: int) -> tuple[Any, int]:
            place = _aligned(place, size)
            (value,) = unpack(found.content, place)
            if found.noted and path is not None:
                found.fields[path] = Field(place, dtype, 1)
            return value, place + size

        return read

    def _numbers(self, kind: str, length: Length, path: str | None) -> Step:
        dtype, own = self._dtype(kind), np.dtype(CODES[kind])
        size = dtype.itemsize

        def read(found: ReadMessage, place: int) -> tuple[Any, int]:
            count, place = length(found, place)
            place = _aligned(place, size) if count else place
            end = found.reach(place + count * size)
            if found.noted and path is not None:
                found.fields[path] = Field(place, dtype, count)
            values = np.frombuffer(found.content, dtype, count, place)
            return values.astype(own, copy=False), end

        return read

    def _dtype(self, kind: str) -> np.dtype:
        """Return the dtype of numbers in messages, where a bool may be any byte."""
        return np.dtype(np.uint8 if kind == "bool" else self._order + CODES[kind])


def _length_of_array(count: int, _: ReadMessage, place: int) -> tuple[int, int]:
    return count, place


def _text_step(path: str | None) -> Step:
    def read(found: ReadMessage, place: int) -> tuple[Any, int]:
        count, place = found.length(place, 1, _BYTE)
        end = place + count
        if count < 1 or found.content[end - 1] != 0:
            raise ValueError("a text has no end")
        found.note(end - 1, "u1", 0)
        if found.noted and path is not None:
            found.fields[path] = Field(place, None, count - 1)
        return found.content[place : end - 1].decode(), end

    return read


def _list_step(step: Step, element: Nodetype, length: Length, path: str | None) -> Step:
    """Return the step of a list of texts or messages; only texts have places."""

    def read(found: ReadMessage, place: int) -> tuple[Any, int]:
        count, place = length(found, place)
        start, values, texts = place, [], []
        noted = found.noted and element == Nodetype.BASE
        for _ in range(count):
            begin = _aligned(place, 4) + 4 - start  # of a text
            value, place = step(found, place)
            values.append(value)
            if noted:
                texts.append(slice(begin, place - 1 - start))
        if noted and path is not None:
            found.fields[path] = Field(start, None, place - start, tuple(texts))
        return values, place

    return read


def _aligned(place: int, size: int) -> int:
    return place + (HEAD - place) % size  # alignment counts from behind the head
