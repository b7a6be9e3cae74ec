"""Single messages of a proof: their keys, their bytes, and the fields in which two differ."""

from __future__ import annotations

import dataclasses
from array import array
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import join_seconds
from rpud_sim.simulation.fields import Fields, stamp_of

# Stamp [ns] and sequence number: unique within a topic, unless something is wrong.
Key = tuple[int, int]

# Fields of a computed message that its key is made of; not every type has the second one.
KEY_FIELDS = ("header", "sequence")

UNREADABLE: Key = (-1, -1)  # key of a recorded message that cannot be decoded


def computed_key(fields: Fields) -> Key:
    return stamp_of(fields), int(fields.get("sequence", 0))


def recorded_key(recorded: Message, codec: Codec) -> Key:
    """Return the key of a recorded message, ``UNREADABLE`` if it cannot be decoded."""
    try:
        message = codec.decode(recorded.data)
    except BagFormatError:
        return UNREADABLE
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec), getattr(message, "sequence", 0)


def without_padding(message: Message, codec: Codec) -> bytes:
    """Return a message's bytes with zeros between fields; unchanged if it cannot be decoded."""
    try:
        return codec.without_padding(message.data)
    except BagFormatError:
        return message.data


def without_repeats(recorded: Iterator[Message]) -> Iterator[Message]:
    """Skip messages equal to the one before, of a latched topic.

    They repeat where a bag's next file begins.
    """
    last = None
    for message in recorded:
        if message.data != last:
            yield message
        last = message.data


def first_difference(codec: Codec, recorded: bytes, expected: bytes) -> tuple[str, str, str]:
    """Return the first field in which two messages differ, and its value in each, as texts.

    If the recorded bytes cannot be decoded, the field is empty.
    """
    try:
        found = codec.decode(recorded)
    except BagFormatError as error:
        return "", str(error), "a message"
    return next(_differences("", found, codec.decode(expected)))


def differing_fields(found: Any, expected: Any) -> Iterator[tuple[str, str, str]]:
    """Yield each field in which two decoded messages differ, and its value in each, as texts."""
    return _differences("", found, expected)


def _differences(path: str, found: Any, expected: Any) -> Iterator[tuple[str, str, str]]:
    if dataclasses.is_dataclass(found) or isinstance(found, SimpleNamespace):
        for name in vars(found):
            if not name.startswith("__"):
                inner = f"{path}.{name}" if path else name
                yield from _differences(inner, getattr(found, name), getattr(expected, name))
    elif isinstance(found, (list, np.ndarray, array)):
        if len(found) != len(expected):
            yield f"length of {path}", str(len(found)), str(len(expected))
        for i in range(min(len(found), len(expected))):
            yield from _differences(f"{path}[{i}]", found[i], expected[i])
    elif _bits(found) != _bits(expected):
        yield path, _to_text(found, expected), _to_text(expected, found)


def _bits(value: Any) -> Any:
    return np.float64(value).tobytes() if isinstance(value, float) else value


def _to_text(value: Any, other: Any) -> str:
    """Return a value as text; with its bits, if the other one would have the same text."""
    if isinstance(value, float) and repr(float(value)) == repr(float(other)):
        return f"{value!r} (bits {np.float64(value).tobytes()[::-1].hex()})"
    return f"{float(value)!r}" if isinstance(value, float) else f"{value!r:.100}"
