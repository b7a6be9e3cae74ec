"""Messages of a proof: computed ones in blocks, keys, and the field in which two differ."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.encoder import Decoded
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.foundation.time import join_seconds
from rpud_sim.inspection.offline_bag import encoded
from rpud_sim.simulation.telemetry import Entry, Together

# Stamp [ns] and sequence number: unique within a topic, unless something is wrong.
Key = tuple[int, int]

UNREADABLE: Key = (-1, -1)  # key of a recorded message that cannot be decoded


class ComputedBlock(NamedTuple):
    """Consecutive computed messages of one topic."""

    messages: MessageBlock
    stretch: int  # of the journal in which they were computed
    ends: np.ndarray  # stamp that the drill had reached at each [ns]


def computed_blocks(
    found: Entry | Together, codecs: Mapping[str, Codec], stretch: int, reached: int
) -> Iterator[ComputedBlock]:
    """Yield what a simulation gave, by the run's names of topics; ``reached`` is a stamp [ns]."""
    if isinstance(found, Together):
        ends = found.ends + (reached - found.end)
        for columns, block in encoded(found, codecs, ""):
            yield ComputedBlock(block, stretch, ends[columns.blocks])
        return
    time, name, fields = found
    if name in codecs:
        data = np.frombuffer(codecs[name].encode(fields), np.uint8)
        times = np.array([time])
        block = MessageBlock(name, times, times, data, np.array([0]), np.array([len(data)]))
        yield ComputedBlock(block, stretch, np.array([reached]))


def key_of(data: bytes, codec: Codec) -> Key:
    """Return the key of a message, ``UNREADABLE`` if it cannot be decoded."""
    try:
        message = codec.decode(data)
    except BagFormatError:
        return UNREADABLE
    stamp = message.header.stamp
    return join_seconds(stamp.sec, stamp.nanosec), getattr(message, "sequence", 0)


def without_padding(data: bytes, codec: Codec) -> bytes:
    """Return a message's bytes with zeros between fields; unchanged if it cannot be decoded."""
    try:
        return codec.without_padding(data)
    except BagFormatError:
        return data


def first_difference(codec: Codec, recorded: bytes, expected: bytes) -> tuple[str, str, str]:
    """Return the first field in which two messages differ, and its value in each, as texts.

    If the recorded bytes cannot be decoded, the field is empty.
    """
    try:
        found = codec.decode(recorded)
    except BagFormatError as error:
        return "", str(error), "a message"
    return first_field(found, codec.decode(expected)) or ("", "a message", "the same one")


def first_field(found: Any, expected: Any) -> tuple[str, str, str] | None:
    """Return the first field in which decoded messages differ, and its values; None if none is."""
    # The length of a sequence comes before its items, so both sides keep the same pace.
    for (path, own), (_, other) in zip(_leaves(found), _leaves(expected), strict=False):
        if _bits(own) != _bits(other):
            first, second = _text(own), _text(other)
            if first == second:  # only the bits of NaN differ
                first, second = (f"{each} (bits {_bits(each).hex()})" for each in (own, other))
            return path, first, second
    return None


def _leaves(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    if isinstance(value, Decoded):
        for name, inner in vars(value).items():
            yield from _leaves(inner, f"{path}.{name}" if path else name)
    elif isinstance(value, list | np.ndarray):
        yield f"length of {path}", len(value)
        for number, inner in enumerate(value):
            yield from _leaves(inner, f"{path}[{number}]")
    else:
        yield path, value


def _bits(value: Any) -> Any:
    return struct.pack(">d", value) if isinstance(value, float) else value


def _text(value: Any) -> str:
    return f"{float(value)!r}" if isinstance(value, float) else f"{value!r:.100}"
