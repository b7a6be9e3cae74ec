"""Codec between plain values and the bytes that ROS exchanges (CDR), without ROS."""

from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache, partial
from typing import TYPE_CHECKING, Any, NamedTuple, TypeVar

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from rpud_sim.bag.encoder import CODES, Decoded, Encoder, Members, Sequence
from rpud_sim.bag.errors import DAMAGED, BagFormatError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

# Greatest definition of a type, with all types that it needs [characters].
DEFINITION_LIMIT = 256 * 2**10
DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, with those of its members

HEAD = 4  # bytes before the first field: the encoding of a message
PADDING = 3  # bytes behind the last field, so that messages follow each other aligned
UNUSED = 8  # bytes that ROS allots each empty sequence, of any content

# Bytes that parts of a message take as objects, as plain values, and as text.
_MEMBER = 500  # a message within a message
_FIELD = 100
_BYTE = 6  # for each byte of texts, and of sequences and arrays of numbers
_LEAST_NUMBER = 10  # in sequences and arrays: Parquet adds levels to each
_TEXT = "string"
_LEAST_TEXT = 5  # its length, and the zero at its end

_SEPARATOR = re.compile(r"^={80}\nMSG: ", re.MULTILINE)
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes of numbers, by the beginning of a message

Sizes = TypeVar("Sizes", int, np.ndarray)


class Shape(NamedTuple):
    """Bounds of the values of a type."""

    fields: int  # number of fields
    memory: int  # that it takes without the content of texts and sequences [bytes]
    size: int  # least number of bytes in a message
    growth: int  # greatest memory for each byte of texts and sequences [bytes]

    def most(self, size: Sizes) -> Sizes:
        """Return the greatest memory that a message of ``size`` bytes takes [bytes]."""
        return self.memory + size * self.growth


class Codec:
    """Encoder and decoder of the messages of one type, from its complete ``ros2msg`` text."""

    def __init__(self, type_name: str, definition: str) -> None:
        self.type = type_name
        if len(definition) > DEFINITION_LIMIT:
            raise BagFormatError(
                f"the definition of {type_name:.80} has {len(definition)} characters; "
                f"at most {DEFINITION_LIMIT} are read"
            )
        self._readers: dict[str, dict[str, _Reader]] = {">": {}, "<": {}}  # by order and type
        self._shapes: dict[str, Shape] = {}
        with self._understanding("definition"):
            self._types = _types_of(definition, type_name)
            self.shape = self._shape_of_member(type_name)

    @property
    def type_hash(self) -> str:
        """``RIHS01_...`` hash of the type."""
        store = get_typestore(Stores.EMPTY)
        store.register(self._types)
        return str(store.hash_rihs01(self.type))

    def fields(self, type_name: str) -> list[tuple[str, Any]]:
        """Return name and type, in ``rosbags``, of each field of this type or one that it needs."""
        return self._types[type_name][1]

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Return a serialized message; values and errors are those of ``Encoder.encode``."""
        return self.encoder.encode(fields)

    def decode(self, data: bytes) -> Any:
        """Return a message as ``Decoded``."""
        with self._understanding("message"):
            order = _ORDERS.get(data[:2])
            if order is None:
                raise ValueError("its encapsulation is not plain CDR")
            cursor = _Cursor(data, order, self.shape.memory)
            value = self._member(self.type, order)(cursor)
            if not cursor.place <= len(data) <= cursor.place + cursor.spare:
                raise ValueError(f"{len(data) - cursor.place} bytes follow its last field")
            return value

    def without_padding(self, data: bytes) -> bytes:
        """Return the same message with zeros for the padding between fields, as ``encode`` does."""
        return self.encoder.encode(self.decode(data))

    @cached_property
    def encoder(self) -> Encoder:
        return Encoder(self._members(self.type))

    def _members(self, name: str) -> Members:
        return Members(tuple((own, self._encoded(*kind)) for own, kind in self.fields(name)))

    def _encoded(self, node: Nodetype, described: Any) -> Any:
        if node == Nodetype.NAME:
            return self._members(described)
        if node == Nodetype.SEQUENCE:
            return Sequence(self._encoded(*described[0]))
        if node == Nodetype.BASE and described[0] in CODES:
            return CODES[described[0]]
        raise BagFormatError(f"no message with a member {described!r:.80} can be written")

    def shape_of(self, node: Nodetype, described: Any) -> Shape:
        """Return the bounds of a field, or of an element of a sequence or array."""
        if node == Nodetype.NAME:
            return self._shape_of_member(described)
        if node == Nodetype.BASE:
            text = described[0] == _TEXT
            size, growth = (_LEAST_TEXT, _BYTE) if text else (SIZEMAP[described[0]], 0)
            return Shape(1, _FIELD, size, growth)
        element, count = described
        each, memory = self.shape_of(*element), self.element_memory(*element)
        if node == Nodetype.SEQUENCE:
            return Shape(1, _FIELD, 4, max(-(-memory // each.size), each.growth))
        fields = 1 if is_number(*element) else 1 + count * each.fields
        return Shape(fields, _FIELD + count * memory, count * each.size, each.growth)

    def element_memory(self, node: Nodetype, described: Any) -> int:
        """Return the memory of an element without its texts and sequences [bytes]."""
        shape = self.shape_of(node, described)
        number = is_number(node, described)
        return max(_LEAST_NUMBER, shape.size * _BYTE) if number else shape.memory

    def _shape_of_member(self, name: str) -> Shape:
        if name not in self._shapes:
            fields = self.fields(name)
            # CDR needs a field, also of a type without one.
            parts = [self.shape_of(*field) for _, field in fields] or [Shape(1, _FIELD, 1, 0)]
            counts, memory, size, growth = zip(*parts, strict=True)
            if sum(counts) > FIELDS_LIMIT:
                raise BagFormatError(
                    f"{name:.80} has {sum(counts)} fields with those of its members; "
                    f"at most {FIELDS_LIMIT} are read"
                )
            if len(dict(fields)) < len(fields):
                raise ValueError(f"{name:.80} has two fields of one name")
            shape = Shape(1 + sum(counts), _MEMBER + sum(memory), max(1, sum(size)), max(growth))
            self._shapes[name] = shape
        return self._shapes[name]

    def _member(self, name: str, order: str) -> _Reader:
        readers = self._readers[order]
        if name not in readers:
            fields = [(own, self._reader(order, *kind)) for own, kind in self.fields(name)]

            def read(cursor: _Cursor) -> Decoded:
                if not fields:
                    cursor.place += 1
                return Decoded(name, {own: reader(cursor) for own, reader in fields})

            readers[name] = read
        return readers[name]

    def _reader(self, order: str, node: Nodetype, described: Any) -> _Reader:
        if node == Nodetype.NAME:
            return self._member(described, order)
        if node == Nodetype.BASE:
            return _Cursor.text if described[0] == _TEXT else _number_reader(order, described[0])
        element, count = described
        length: Callable[[_Cursor], int] = lambda cursor: count  # noqa: E731
        if node == Nodetype.SEQUENCE:
            least, memory = self.shape_of(*element).size, self.element_memory(*element)
            length = partial(_Cursor.length, least=least, memory=memory)
        if is_number(*element):
            return _numbers_reader(order, element[1][0], length)
        read = self._reader(order, *element)
        return lambda cursor: [read(cursor) for _ in range(length(cursor))]

    @contextmanager
    def _understanding(self, what: str) -> Iterator[None]:
        try:
            yield
        except (*DAMAGED, AssertionError, TypesysError) as error:
            reason = " ".join(f"{error!r:.200}".split())
            raise BagFormatError(
                f"a {what} of {self.type:.80} cannot be understood: {reason}"
            ) from error


def is_number(node: Nodetype, described: Any) -> bool:
    """Return whether a type in ``rosbags`` is a number."""
    return node == Nodetype.BASE and described[0] != _TEXT


def number_dtype(kind: str, order: str = "<") -> np.dtype:
    """Return the dtype of a number in messages, where a bool may be any byte."""
    return np.dtype(np.uint8 if kind == "bool" else order + CODES[kind])


def aligned(place: Any, size: int) -> Any:
    """Return the next place that is aligned to ``size``; alignment counts from behind the head."""
    return place + (HEAD - place) % size


class _Cursor:
    """Place in a message that is being decoded."""

    def __init__(self, content: bytes, order: str, memory: int) -> None:
        self.place = HEAD
        self.spare = PADDING  # bytes that may follow the last field
        self.content = content
        self._order, self._memory = order, memory

    def length(self, least: int, memory: int) -> int:
        """Read a number of elements.

        Each has at least ``least`` bytes, and takes ``memory`` when it is decoded.
        """
        place = aligned(self.place, 4)
        (count,) = struct.unpack_from(f"{self._order}I", self.content, place)
        self.place = place + 4
        self.reach(count * least)
        self._memory += count * memory
        if self._memory > DECODED_LIMIT:
            raise BagFormatError(
                f"a message of {len(self.content)} bytes takes {self._memory} or more when it is "
                f"decoded; at most {DECODED_LIMIT} are read"
            )
        self.spare += 0 if count else UNUSED
        return int(count)

    def reach(self, size: int) -> int:
        """Return the place behind so many bytes, which the message must have."""
        if self.place + size > len(self.content):
            raise ValueError("it ends too early")
        return self.place + size

    def text(self) -> str:
        count = self.length(1, _BYTE)
        start, self.place = self.place, self.place + count
        if not count or self.content[self.place - 1] != 0:
            raise ValueError("a text has no end")
        return self.content[start : self.place - 1].decode()


_Reader = Callable[[_Cursor], Any]


def _number_reader(order: str, kind: Any) -> _Reader:
    size = SIZEMAP[kind]
    unpack = struct.Struct(order + CODES[kind]).unpack_from

    def read(cursor: _Cursor) -> Any:
        place = aligned(cursor.place, size)
        cursor.place = place + size
        return unpack(cursor.content, place)[0]

    return read


def _numbers_reader(order: str, kind: str, length: Callable[[_Cursor], int]) -> _Reader:
    dtype, own = number_dtype(kind, order), np.dtype(CODES[kind])

    def read(cursor: _Cursor) -> np.ndarray:
        if count := length(cursor):
            cursor.place = aligned(cursor.place, dtype.itemsize)
        end = cursor.reach(count * dtype.itemsize)
        values = np.frombuffer(cursor.content, dtype, count, cursor.place)
        cursor.place = end
        return values.astype(own, copy=False)

    return read


@lru_cache(64)
def _types_in(part: str, type_name: str) -> Typesdict:
    return get_types_from_msg(part, type_name)


def _types_of(definition: str, type_name: str) -> Typesdict:
    """Return a type and those that it needs; what definitions share is parsed once."""
    first, *others = _SEPARATOR.split(definition)
    types = dict(_types_in(first, type_name))
    for part in others:
        name, _, text = part.partition("\n")
        types.update(_types_in(text, name.strip()))
    return types
