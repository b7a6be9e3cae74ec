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
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from rpud_sim.foundation.terminal import error_text
from rpud_sim.messages.definition_text import fields_of, parts_of
from rpud_sim.messages.encoder import CODES, TEXT, Decoded, Encoder, Members, Node, Sequence
from rpud_sim.messages.errors import DAMAGED, BagFormatError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

# Limits, so that a few bytes cannot take all memory.
FIELDS_LIMIT = 100_000  # greatest number of fields of a type, including its members' fields
DECODED_LIMIT = 256 * 2**20  # greatest decoded message, with its text in exported files [bytes]

HEAD = 4  # bytes before the first field: the encoding of a message
PADDING = 3  # bytes behind the last field, so that messages follow each other aligned
UNUSED = 8  # bytes that ROS allots each empty sequence, of any content

# Bytes that parts of a message take as objects, as plain values, and as text.
_MEMBER = 500  # a message within a message
_FIELD = 100
_BYTE = 6  # bytes for each byte of texts, and of sequences and arrays of numbers
_LEAST_NUMBER = 10  # bytes in sequences and arrays: Parquet adds levels to each
_LEAST_TEXT = 4  # its length: some writers leave out the zero of an empty one

_WIDE_TEXT = re.compile(r"wstring\b")
_NAME = re.compile(r"[A-Za-z]\w*(/[A-Za-z]\w*){1,2}", re.ASCII)  # name of a type
# Types of ROS that some tools leave out of a definition, since everybody knows them.
_KNOWN = {
    "builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec",
    "builtin_interfaces/msg/Duration": "int32 sec\nuint32 nanosec",
}
_ORDERS = {b"\0\0": ">", b"\0\1": "<"}  # of the bytes of numbers, by the beginning of a message
_XCDR2 = bytes(range(6, 12))  # second byte of a message
_ZSTD = b"\x28\xb5\x2f\xfd"  # beginning of a compressed frame

Sizes = TypeVar("Sizes", int, np.ndarray)


class Shape(NamedTuple):
    """Bounds of the values of a type."""

    fields: int  # number of fields
    memory: int  # memory without the content of texts and sequences [bytes]
    size: int  # least number of bytes in a message
    growth: int  # greatest memory for each byte of texts and sequences [bytes]

    def most(self, size: Sizes) -> Sizes:
        """Return the greatest memory that a message of ``size`` bytes takes [bytes]."""
        return self.memory + size * self.growth


class Codec:
    """Encoder and decoder of the messages of one type, from its complete ``ros2msg`` text."""

    def __init__(self, type_name: str, definition: str) -> None:
        self.type = type_name
        self._shapes: dict[str, Shape] = {}  # shapes by type
        self._readers: dict[tuple[str, str], _Reader] = {}  # readers by order of bytes and type
        with self._understanding("definition"):
            self._types = _types_of(definition, type_name)
            self.members = self._members(type_name, {})
            self.shape = self.shape_of(self.members)

    @property
    def type_hash(self) -> str:
        """``RIHS01_...`` hash of the type."""
        store = get_typestore(Stores.EMPTY)
        store.register(self._types)
        return str(store.hash_rihs01(self.type))

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Return a serialized message; values and errors are as in ``Encoder.encode``."""
        return self.encoder.encode(fields)

    def decode(self, data: bytes) -> Any:
        """Return a message as ``Decoded``."""
        with self._understanding("message"):
            if reason := foreign_encoding(data):
                raise ValueError(reason)
            order = _ORDERS[data[:2]]
            source = _ByteReader(data, order, self.shape.memory)
            value = self._reader(order, self.members)(source)
            if not source.place <= len(data) <= source.place + source.spare:
                raise ValueError(f"{len(data) - source.place} bytes follow its last field")
            return value

    @cached_property
    def encoder(self) -> Encoder:
        return Encoder(self.members)

    def _members(self, name: str, known: dict[str, Members]) -> Members:
        if name not in known:
            if name not in self._types:
                raise ValueError(f"it lacks the type {name:.80}")
            fields = self._types[name][1]
            if len(dict(fields)) < len(fields):
                raise ValueError(f"{name:.80} has two fields of one name")
            found = tuple((own, self._node(known, *kind)) for own, kind in fields)
            known[name] = Members(found, name)
        return known[name]

    def _node(self, known: dict[str, Members], node: Nodetype, described: Any) -> Node:
        """Return a type in ``rosbags`` as an encoder has it."""
        if node == Nodetype.NAME:
            return self._members(described, known)
        if node == Nodetype.BASE:
            return CODES[described[0]]
        element, count = described
        return Sequence(self._node(known, *element), count if node == Nodetype.ARRAY else None)

    def shape_of(self, node: Node) -> Shape:
        """Return the bounds of a field, or of an element of a sequence or array."""
        if isinstance(node, Members):
            if node.name not in self._shapes:
                # CDR needs a field, also of a type without one.
                parts = [self.shape_of(each) for _, each in node.members] or [_NO_FIELDS]
                counts, memory, size, growth = map(sum, zip(*parts, strict=True))
                if counts > FIELDS_LIMIT:
                    raise BagFormatError(
                        f"{node.name:.80} has {counts} fields, including its members'; "
                        f"at most {FIELDS_LIMIT} are read"
                    )
                growth = max(each.growth for each in parts)
                shape = Shape(1 + counts, _MEMBER + memory, max(1, size), growth)
                self._shapes[node.name] = shape
            return self._shapes[node.name]
        if isinstance(node, str):
            size = np.dtype(node).itemsize if node != TEXT else _LEAST_TEXT
            return Shape(1, _FIELD, size, _BYTE if node == TEXT else 0)
        each, memory = self.shape_of(node.element), self.element_memory(node.element)
        if node.length is None:
            return Shape(1, _FIELD, 4, max(-(-memory // each.size), each.growth))
        fields = 1 if is_number(node.element) else 1 + node.length * each.fields
        memory = _FIELD + node.length * memory
        return Shape(fields, memory, node.length * each.size, each.growth)

    def element_memory(self, node: Node) -> int:
        """Return the memory of an element without its texts and sequences [bytes]."""
        shape = self.shape_of(node)
        return max(_LEAST_NUMBER, shape.size * _BYTE) if is_number(node) else shape.memory

    def _reader(self, order: str, node: Node) -> _Reader:
        if isinstance(node, str):
            return _ByteReader.text if node == TEXT else _number_reader(order, node)
        if isinstance(node, Members):
            key = order, node.name
            if key not in self._readers:
                self._readers[key] = self._member_reader(order, node)
            return self._readers[key]
        count = node.length
        if count is None:
            least, memory = self.shape_of(node.element).size, self.element_memory(node.element)
            length: _Reader = partial(_ByteReader.length, least=least, memory=memory)
        else:
            length = lambda source: count  # noqa: E731
        if isinstance(node.element, str) and node.element != TEXT:
            return _numbers_reader(order, node.element, length)
        read = self._reader(order, node.element)
        return lambda source: [read(source) for _ in range(length(source))]

    def _member_reader(self, order: str, node: Members) -> _Reader:
        fields = [(name, self._reader(order, each)) for name, each in node.members]

        def read(source: _ByteReader) -> Decoded:
            if not fields:
                source.place += 1
            return Decoded(node.name, {name: reader(source) for name, reader in fields})

        return read

    @contextmanager
    def _understanding(self, what: str) -> Iterator[None]:
        try:
            yield
        except (*DAMAGED, AssertionError, TypesysError) as error:
            raise BagFormatError(
                f"a {what} of {self.type:.80} cannot be understood: {error_text(error)}"
            ) from error


_NO_FIELDS = Shape(1, _FIELD, 1, 0)


def foreign_encoding(data: bytes) -> str:
    """Return in words why the bytes of a message are not plain CDR; empty if they may be."""
    if len(data) < HEAD:
        return f"it has {len(data)} bytes, and is not plain CDR"
    if data[:2] in _ORDERS:
        return ""
    if data[:4] == _ZSTD:
        return "it is a frame of zstd, not plain CDR: rosbag2 compressed each message"
    if data[:1] == b"\0" and data[1:2] in _XCDR2:
        return "it is XCDR2, not plain CDR"
    return "its encapsulation is not plain CDR"


def is_number(node: Node) -> bool:
    return isinstance(node, str) and node != TEXT


def number_dtype(code: str, order: str = "<") -> np.dtype:
    """Return the dtype of a number in messages, where a bool may be any byte."""
    return np.dtype(np.uint8 if code == "?" else order + code)


def aligned(place: Any, size: int) -> Any:
    """Return the next place that is aligned to ``size``; alignment counts from behind the head."""
    return place + (HEAD - place) % size


class _ByteReader:
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
        if not count:
            return ""
        if self.content[self.place - 1] != 0:
            raise ValueError("a text has no end")
        return self.content[start : self.place - 1].decode()


_Reader = Callable[[_ByteReader], Any]


def _number_reader(order: str, code: str) -> _Reader:
    unpack, size = struct.Struct(order + code).unpack_from, np.dtype(code).itemsize

    def read(source: _ByteReader) -> Any:
        place = aligned(source.place, size)
        source.place = place + size
        return unpack(source.content, place)[0]

    return read


def _numbers_reader(order: str, code: str, length: _Reader) -> _Reader:
    dtype, own = number_dtype(code, order), np.dtype(code)

    def read(source: _ByteReader) -> np.ndarray:
        if count := length(source):
            source.place = aligned(source.place, dtype.itemsize)
        end = source.reach(count * dtype.itemsize)
        values = np.frombuffer(source.content, dtype, count, source.place)
        source.place = end
        return values.astype(own, copy=False)

    return read


@lru_cache(64)
def _types_in(type_name: str, text: str) -> Typesdict:
    if not _NAME.fullmatch(type_name):
        raise ValueError(f"{type_name!r:.80} is not a type name")
    lines = [f"{kind} {name}" for kind, name, _ in fields_of(type_name, text)]
    if any(_WIDE_TEXT.match(line) for line in lines):
        raise ValueError("it has a wstring, which releases of ROS serialize in different ways")
    return get_types_from_msg("\n".join(lines), type_name)


def _types_of(definition: str, type_name: str) -> Typesdict:
    """Return a type and those that it needs; what definitions share is parsed once."""
    types: Typesdict = {}
    for name, text in (*_KNOWN.items(), *parts_of(type_name, definition)):
        types.update(_types_in(name, text))
    return types
