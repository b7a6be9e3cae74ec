"""Numbers of many messages of one type at once, without decoding each message."""

from __future__ import annotations

import struct
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.serde.utils import SIZEMAP

from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.errors import BagFormatError

ELEMENTS_LIMIT = 10_000
"""Greatest number of messages within one message that are passed one by one."""

_HEAD = 4  # bytes before the first field: the encoding of a message
_TEXTS = ("string", "wstring")
_DTYPES = {"bool": "u1", "byte": "u1", "char": "u1", "octet": "u1"}


@dataclass(frozen=True)
class Numbers:
    """Numbers of messages.

    Attributes:
        rows: places of the readable messages among all, shape (n,).
        columns: values of the wanted fields, by attribute, each of shape (n,).
        unreadable: number of messages that are not of the type.
        reason: of the first of these; empty without one.
    """

    rows: np.ndarray
    columns: dict[str, np.ndarray]
    unreadable: int = 0
    reason: str = ""


@dataclass(frozen=True)
class _Layout:
    """Places in messages that have the same lengths of texts and sequences.

    Args:
        fields: attribute, dtype and place of each wanted number.
        lengths: places of the lengths of texts and sequences [bytes].
    """

    fields: tuple[tuple[str, np.dtype, int], ...]
    lengths: np.ndarray


class Stack:
    """Reader of single numbers in messages of one type.

    Messages of equal size whose texts and sequences have equal lengths hold each number at the same
    place. So the layout of the first one gives the numbers of all, in one array.

    Args:
        codec: of the type.
        wanted: attributes of numbers, as in ``Column.attribute``; of a time, those of its parts.
    """

    def __init__(self, codec: Codec, wanted: Collection[str]) -> None:
        self._codec = codec
        self._wanted = frozenset(wanted)
        self._members = {codec.type_name: codec.fields(codec.type_name)}

    def numbers(self, messages: Sequence[bytes]) -> Numbers:
        """Return the wanted numbers of messages."""
        sizes: dict[tuple[int, bytes], list[int]] = {}
        for place, data in enumerate(messages):
            sizes.setdefault((len(data), data[:_HEAD]), []).append(place)
        groups: list[tuple[np.ndarray, dict[str, np.ndarray]]] = []
        unreadable, reason = 0, ""
        for places in sizes.values():
            rest = np.array(places)
            table = np.frombuffer(b"".join(messages[place] for place in places), np.uint8)
            table = table.reshape(len(places), -1)
            while len(rest):
                try:
                    layout = self._layout(table[0].tobytes())
                except BagFormatError as error:
                    reason = reason or str(error)
                    unreadable += 1
                    rest, table = rest[1:], table[1:]
                    continue
                words = table[:, layout.lengths]
                same = (words == words[0]).all(axis=1)
                groups.append((rest[same], _columns(table[same], layout)))
                rest, table = rest[~same], table[~same]
        if not groups:
            none = {name: np.empty(0) for name in self._wanted}
            return Numbers(np.empty(0, np.intp), none, unreadable, reason)
        rows = np.concatenate([places for places, _ in groups])
        order = np.argsort(rows, kind="stable")
        columns = {
            name: np.concatenate([found[name] for _, found in groups])[order]
            for name in groups[0][1]
        }
        return Numbers(rows[order], columns, unreadable, reason)

    def _layout(self, data: bytes) -> _Layout:
        walk = _Walk(self._codec, self._members, self._wanted, data)
        try:
            end = walk.member(self._codec.type_name, "", _HEAD)
        except struct.error:
            end = len(data) + 1
        if end > len(data):
            raise BagFormatError(f"a message of {self._codec.type_name:.80} is too short")
        places = np.array(walk.lengths, np.intp)
        lengths = (places[:, None] + np.arange(4)).ravel()
        return _Layout(tuple(walk.fields), lengths)


def _columns(table: np.ndarray, layout: _Layout) -> dict[str, np.ndarray]:
    found = {}
    for name, dtype, place in layout.fields:
        values = np.ascontiguousarray(table[:, place : place + dtype.itemsize])
        found[name] = values.view(dtype)[:, 0].astype(dtype.newbyteorder("="))
    return found


class _Walk:
    """Walk along one message that notes where its numbers and lengths are."""

    def __init__(
        self, codec: Codec, members: dict[str, Any], wanted: frozenset[str], data: bytes
    ) -> None:
        self._codec = codec
        self._members = members
        self._wanted = wanted
        self._data = data
        self._order = "<" if data[1:2] == b"\x01" else ">"
        self._elements = 0
        self.fields: list[tuple[str, np.dtype, int]] = []
        self.lengths: list[int] = []

    def member(self, type_name: str, prefix: str | None, place: int) -> int:
        """Pass a message and return its end; numbers in sequences have no prefix."""
        if type_name not in self._members:
            self._members[type_name] = self._codec.fields(type_name)
        fields = self._members[type_name]
        if not fields:
            return place + 1  # CDR needs one member
        for _, attribute, (node, described) in fields:
            name = None if prefix is None else prefix + attribute
            place = self._field(node, described, name, place)
        return place

    def _field(self, node: Nodetype, described: Any, name: str | None, place: int) -> int:
        if node == Nodetype.NAME:
            return self.member(described, None if name is None else f"{name}.", place)
        if node == Nodetype.BASE and described[0] in _TEXTS:
            count, place = self._length(place)
            return place + count
        if node == Nodetype.BASE:
            size = SIZEMAP[described[0]]
            place = _aligned(place, size)
            if name in self._wanted and name is not None:
                code = _DTYPES.get(described[0]) or np.dtype(described[0]).str[1:]
                self.fields.append((name, np.dtype(self._order + code), place))
            return place + size
        (element, item), count = described
        if node == Nodetype.SEQUENCE:
            count, place = self._length(place)
        if element == Nodetype.BASE and item[0] not in _TEXTS:
            size = SIZEMAP[item[0]]
            return _aligned(place, size) + count * size if count else place
        for _ in range(count):
            self._elements += 1
            if place >= len(self._data) or self._elements > ELEMENTS_LIMIT:
                raise BagFormatError(f"a message of {self._codec.type_name:.80} is too long")
            place = self._field(element, item, None, place)
        return place

    def _length(self, place: int) -> tuple[int, int]:
        place = _aligned(place, 4)
        self.lengths.append(place)
        return struct.unpack_from(self._order + "I", self._data, place)[0], place + 4


def _aligned(place: int, size: int) -> int:
    return place + (_HEAD - place) % size  # alignment counts from behind the head
