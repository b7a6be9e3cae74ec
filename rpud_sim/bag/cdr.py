"""Codec between plain values and the bytes that ROS exchanges (CDR), without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.base import normalize_fieldname
from rosbags.typesys.store import Typestore

from rpud_sim.bag.encoder import CODES, Encoder, Members, Sequence
from rpud_sim.bag.errors import DAMAGED, BagFormatError
from rpud_sim.bag.layout import MessageType

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

# Greatest definition of a type, with all types that it needs [characters].
DEFINITION_LIMIT = 256 * 2**10

FIELDS_SIZE_LIMIT = 64 * 2**10  # greatest definition of a type without its comments [characters]

_COMMENT = re.compile(r"#.*")
_SEPARATOR = re.compile(r"^={80}\nMSG: ", re.MULTILINE)
_WRITTEN_OUT_LIMIT = 10_000
_PADDING = 3  # bytes behind the last field, so that messages follow each other aligned


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
            self.type = MessageType(self._store, type_name)

    @property
    def type_hash(self) -> str:
        """``RIHS01_...`` hash of the type."""
        return str(self._store.hash_rihs01(self._type))

    def fields(self, type_name: str) -> list[tuple[str, str, Any]]:
        """Return the fields of this type, or of one that it needs.

        Each has its name, its attribute in decoded messages, and its type in ``rosbags``.
        """
        return self.type.fields[type_name]

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Return a serialized message; values and errors are those of ``Encoder.encode``."""
        return self.encoder.encode(fields)

    def decode(self, data: bytes) -> Any:
        """Return a message as an object with its fields, and with NumPy arrays for sequences."""
        self.type.check(data)
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
