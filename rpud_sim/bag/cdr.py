"""Messages as plain values, to and from the bytes that ROS exchanges (CDR), without ROS."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from types import SimpleNamespace
from typing import Any

import numpy as np
from rosbags.typesys import Stores, get_types_from_msg, get_typestore


class Codec:
    """Encodes and decodes the messages of one type, given its complete `ros2msg` definition."""

    def __init__(self, type_name: str, definition: str) -> None:
        """Compile the definition; `type_name` is like `std_msgs/msg/Header`."""
        self._type = type_name
        self._store = get_typestore(Stores.EMPTY)
        self._store.register(get_types_from_msg(definition, type_name))

    @property
    def type_hash(self) -> str:
        """The `RIHS01_...` hash of the type."""
        return str(self._store.hash_rihs01(self._type))

    def encode(self, fields: Mapping[str, Any]) -> bytes:
        """Serialize the values of all fields.

        Messages are mappings, sequences `array.array`, those of messages or texts lists.
        """
        return bytes(self._store.serialize_cdr(_to_object(fields), self._type))

    def decode(self, data: bytes) -> Any:
        """Deserialize into an object with the fields as attributes, sequences as NumPy arrays."""
        return self._store.deserialize_cdr(data, self._type)


def _to_object(value: Any) -> Any:
    if isinstance(value, Mapping):
        return SimpleNamespace(**{name: _to_object(item) for name, item in value.items()})
    if isinstance(value, list):
        return [_to_object(item) for item in value]
    if isinstance(value, array):
        return np.asarray(value)
    return value
