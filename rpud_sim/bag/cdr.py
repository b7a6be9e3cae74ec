"""Codec between plain values and the bytes that ROS exchanges (CDR), without ROS."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore

from rpud_sim.bag.encoder import CODES, Encoder, Members, Sequence
from rpud_sim.bag.errors import DAMAGED, BagFormatError
from rpud_sim.bag.layout import MessageType, ReadMessage

if TYPE_CHECKING:
    from rosbags.interfaces.typing import Typesdict

# Greatest definition of a type, with all types that it needs [characters].
DEFINITION_LIMIT = 256 * 2**10

_SEPARATOR = re.compile(r"^={80}\nMSG: ", re.MULTILINE)


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
        if len(definition) > DEFINITION_LIMIT:
            raise BagFormatError(
                f"the definition of {type_name:.80} has {len(definition)} characters; "
                f"at most {DEFINITION_LIMIT} are read"
            )
        with self._understanding("definition"):
            self._types = _types_of(definition, type_name)
            self.type = MessageType(self._types, type_name)

    @property
    def type_hash(self) -> str:
        """``RIHS01_...`` hash of the type."""
        store = get_typestore(Stores.EMPTY)
        store.register(self._types)
        return str(store.hash_rihs01(self._type))

    def fields(self, type_name: str) -> list[tuple[str, Any]]:
        """Return name and type, in ``rosbags``, of each field of this type or one that it needs."""
        return self.type.fields[type_name]

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Return a serialized message; values and errors are those of ``Encoder.encode``."""
        return self.encoder.encode(fields)

    def decode(self, data: bytes) -> Any:
        """Return a message as ``Decoded``."""
        return self.read(data).values

    def read(self, data: bytes, noted: bool = False) -> ReadMessage:
        """Return a message, with the places of its fields if they are ``noted``."""
        with self._understanding("message"):
            return self.type.read(data, noted)

    def without_padding(self, data: bytes) -> bytes:
        """Return the same message with zeros for the padding between fields, as ``encode`` does."""
        return self.encoder.encode(self.decode(data))

    @cached_property
    def encoder(self) -> Encoder:
        return Encoder(_members(self.type, self._type))

    @contextmanager
    def _understanding(self, what: str) -> Iterator[None]:
        try:
            yield
        except (*DAMAGED, AssertionError, TypesysError) as error:
            reason = " ".join(f"{error!r:.200}".split())
            raise BagFormatError(
                f"a {what} of {self._type:.80} cannot be understood: {reason}"
            ) from error


def _members(kind: MessageType, name: str) -> Members:
    return Members(tuple((own, _member(kind, *type_)) for own, type_ in kind.fields[name]))


def _member(kind: MessageType, node: Nodetype, described: Any) -> Any:
    if node == Nodetype.NAME:
        return _members(kind, described)
    if node == Nodetype.SEQUENCE:
        return Sequence(_member(kind, *described[0]))
    if node == Nodetype.BASE and described[0] in CODES:
        return CODES[described[0]]
    raise BagFormatError(f"no message with a member {described!r:.80} can be written")
