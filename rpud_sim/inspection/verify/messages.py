"""Messages of a proof: computed ones by topic, keys, bytes, and the fields in which two differ."""

from __future__ import annotations

from array import array
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, is_dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import join_seconds
from rpud_sim.inspection.offline_bag import encoded_columns
from rpud_sim.inspection.verify.coverage import Position
from rpud_sim.simulation.fields import stamp_of
from rpud_sim.simulation.telemetry import Columns, Together
from rpud_sim.simulation.topics import Fields

# Stamp [ns] and sequence number: unique within a topic, unless something is wrong.
Key = tuple[int, int]

_KEY_FIELDS = ("header", "sequence")  # of which it is made; not every type has the second one

UNREADABLE: Key = (-1, -1)  # key of a recorded message that cannot be decoded


@dataclass(frozen=True)
class ComputedBlock:
    """Computed messages of one topic, at least one; their keys ascend."""

    messages: MessageBlock  # serialized
    source: Columns  # the same as columns
    stretch: int  # of the journal in which they were computed
    ends: np.ndarray  # stamp of the end of each message's block [ns]

    def fields(self, number: int) -> Fields:
        return self.source.row(number)

    def key(self, number: int) -> Key:
        return computed_key(self.source.row(number, _KEY_FIELDS))

    def position(self, number: int) -> Position:
        """Return the progress of the drill at a message."""
        return self.stretch, int(self.ends[number])


def computed_blocks(
    together: Together, codecs: Mapping[str, Codec], stretch: int, origin: int
) -> Iterator[tuple[str, ComputedBlock]]:
    """Yield each topic's messages, by its name in the run; ``origin`` is time zero's stamp [ns]."""
    ends = together.ends + origin
    for columns in together.columns:
        if columns.topic in codecs:
            messages = encoded_columns(columns, codecs[columns.topic].encoder, "")
            yield columns.topic, ComputedBlock(messages, columns, stretch, ends[columns.blocks])


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


def first_difference(codec: Codec, recorded: bytes, expected: bytes) -> tuple[str, str, str]:
    """Return the first field in which two messages differ, and its value in each, as texts.

    If the recorded bytes cannot be decoded, the field is empty.
    """
    try:
        found = codec.decode(recorded)
    except BagFormatError as error:
        return "", str(error), "a message"
    return next(differing_fields(found, codec.decode(expected)))


def differing_fields(found: Any, expected: Any, path: str = "") -> Iterator[tuple[str, str, str]]:
    """Yield each field in which two decoded messages differ, and its value in each, as texts."""
    if is_dataclass(found) or isinstance(found, SimpleNamespace):
        for name in vars(found):
            if not name.startswith("__"):
                inner = f"{path}.{name}" if path else name
                yield from differing_fields(getattr(found, name), getattr(expected, name), inner)
    elif isinstance(found, (list, np.ndarray, array)):
        if len(found) != len(expected):
            yield f"length of {path}", str(len(found)), str(len(expected))
        for i in range(min(len(found), len(expected))):
            yield from differing_fields(found[i], expected[i], f"{path}[{i}]")
    elif _bits(found) != _bits(expected):
        yield path, _to_text(found, expected), _to_text(expected, found)


def _bits(value: Any) -> Any:
    return np.float64(value).tobytes() if isinstance(value, float) else value


def _to_text(value: Any, other: Any) -> str:
    """Return a value as text; with its bits, if the other one would have the same text."""
    if isinstance(value, float) and repr(float(value)) == repr(float(other)):
        return f"{value!r} (bits {np.float64(value).tobytes()[::-1].hex()})"
    return f"{float(value)!r}" if isinstance(value, float) else f"{value!r:.100}"
