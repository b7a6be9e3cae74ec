"""Codec between plain values and the bytes that ROS exchanges (CDR), without ROS."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.serde.utils import SIZEMAP
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from rpud_sim.bag.encoder import CODES, Encoder, Members, Sequence
from rpud_sim.bag.errors import DAMAGED, BagFormatError

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

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
            _CodecWalk(self, data).member(self._type, 4)

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


class _CodecWalk:
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


# Greatest definition of a type, with all types that it needs [characters].
DEFINITION_LIMIT = 256 * 2**10

FIELDS_SIZE_LIMIT = 64 * 2**10  # greatest definition of a type without its comments [characters]

_COMMENT = re.compile(r"#.*")
_SEPARATOR = re.compile(r"^={80}\nMSG: ", re.MULTILINE)
_WRITTEN_OUT_LIMIT = 10_000
_PADDING = 3  # bytes behind the last field, so that messages follow each other aligned
_NO_FIELDS = "structure_needs_at_least_one_member"  # field of a type without fields in CDR


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


class Codec:
    """Encoder and decoder of the messages of one type, from its complete ``ros2msg`` text."""

    def __init__(self, type_name: str, definition: str) -> None:
        self._type = type_name
        self._store = get_typestore(Stores.EMPTY)
        if len(definition) > DEFINITION_LIMIT:
            raise BagFormatError(
                f"the definition of {type_name:.80} has {len(definition)} characters; "
                f"at most {DEFINITION_LIMIT} are read"
            )
        if definition_size(definition) > FIELDS_SIZE_LIMIT:
            raise BagFormatError(
                f"the definition of {type_name:.80} has more than {FIELDS_SIZE_LIMIT} characters "
                "without its comments, too many to compile"
            )
        with self._understanding("definition"):
            types = _types_of(definition, type_name)
            if sum(map(_written_out, types.values())) > _WRITTEN_OUT_LIMIT:
                raise ValueError(f"arrays have more than {_WRITTEN_OUT_LIMIT} elements together")
            self._store.register(types)
            # Code that decodes takes longer to make than all else; tables need none of it.
            self.budget = Budget(self._store, type_name)

    @property
    def type_name(self) -> str:
        """Name of the type, such as ``std_msgs/msg/Header``."""
        return self._type

    @property
    def type_hash(self) -> str:
        """``RIHS01_...`` hash of the type."""
        return str(self._store.hash_rihs01(self._type))

    def fields(self, type_name: str) -> list[tuple[str, str, Any]]:
        """Return the fields of this type, or of one that it needs.

        Each has its name, its attribute in decoded messages, and its type in ``rosbags``.
        """
        return [
            (name, normalize_fieldname(name), kind)
            for name, kind in self._store.fielddefs[type_name][1]
            if name != _NO_FIELDS
        ]

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Return a serialized message; values and errors are those of ``Encoder.encode``."""
        return self.encoder.encode(fields)

    def decode(self, data: bytes) -> Any:
        """Return a message as an object with its fields, and with NumPy arrays for sequences."""
        self.budget.check(data)
        with self._understanding("message"):
            if data[:2] not in (b"\0\0", b"\0\1"):
                raise ValueError("its encapsulation is not plain CDR")
            kind = self._store.get_msgdef(self._type)
            read = kind.deserialize_cdr_le if data[1] else kind.deserialize_cdr_be
            message, end = read(data[4:], 0, kind.cls, self._store)
            rest = len(data) - 4 - end
            # ROS allots each empty sequence an alignment that it does not use, of any content.
            if rest > _PADDING and rest > _PADDING + 8 * _empty_sequences(message):
                raise ValueError(f"{rest} bytes follow its last field")
            return message

    def without_padding(self, data: bytes) -> bytes:
        """Return the same message with zeros for the padding between fields, as ``encode`` does."""
        message = self.decode(data)
        with self._understanding("message"):
            return bytes(self._store.serialize_cdr(message, self._type))

    @cached_property
    def encoder(self) -> Encoder:
        return Encoder(_members(self._store, self._type))

    @contextmanager
    def _understanding(self, what: str) -> Iterator[None]:
        try:
            yield
        except (*DAMAGED, AssertionError, SerdeError, TypesysError) as error:
            reason = " ".join(f"{error!r:.200}".split())
            raise BagFormatError(
                f"a {what} of {self._type:.80} cannot be understood: {reason}"
            ) from error


def definition_size(definition: str) -> int:
    """Return the characters without comments, which determine the time to compile."""
    return len(_COMMENT.sub("", definition))


def _empty_sequences(value: Any) -> int:
    if isinstance(value, np.ndarray | list):
        nested = sum(map(_empty_sequences, value)) if isinstance(value, list) else 0
        return nested if len(value) else 1
    return sum(map(_empty_sequences, vars(value).values())) if hasattr(value, "__dict__") else 0


def _written_out(kind: Any) -> int:
    """Return the number of array elements that the library writes out as code."""
    count = 0
    for _, (node, description) in kind[1]:
        if node == Nodetype.ARRAY:
            (element, item), length = description
            if element == Nodetype.NAME or item[0] in ("string", "wstring"):
                count += length
    return count


def _members(store: Typestore, type_name: str) -> Members:
    fields = store.fielddefs[type_name][1]
    return Members(
        tuple((normalize_fieldname(name), _member(store, *described)) for name, described in fields)
    )


def _member(store: Typestore, node: Nodetype, described: Any) -> Any:
    if node == Nodetype.NAME:
        return _members(store, described)
    if node == Nodetype.SEQUENCE:
        return Sequence(_member(store, *described[0]))
    if node == Nodetype.BASE and described[0] in CODES:
        return CODES[described[0]]
    raise BagFormatError(f"no message with a member {described!r:.80} can be written")
