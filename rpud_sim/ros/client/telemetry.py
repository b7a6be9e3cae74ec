"""Fast topics of a drill: raw messages, of which only the shown fields are decoded."""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping
from contextlib import suppress
from typing import Any

import numpy as np
from rclpy.event_handler import SubscriptionEventCallbacks, UnsupportedEventTypeError
from rclpy.qos import QoSProfile
from rpud_msgs.msg import (
    ActuatorState,
    Borehole,
    ContactForce,
    DrillTool,
    Mount,
    NodalPlane,
    ReactingForce,
    Rotation,
    Waveform,
)

from rpud_sim.bag.losses import SequenceGaps
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.client.listening_node import ListeningNode

_DEPTH = 5_000  # messages that may wait; Fast DDS keeps no more
_WAVES = 200  # blocks that may wait, each of some 100 kB

# What follows the header of each type; `struct` pads nothing. T is a text, which the rest follows.
_LAYOUTS = {
    "nodal_plane": (NodalPlane, "dd"),
    "drill_tool": (DrillTool, "dd?"),
    "reacting_force": (ReactingForce, "d"),
    "contact_force": (ContactForce, "Qdddddd?"),
    "actuator_state": (ActuatorState, "12d"),
    "rotation": (Rotation, "dddd?"),
    "mount": (Mount, "ddddd?7xd"),
    "borehole": (Borehole, "ddT4d"),
}
# Fields by topic, in the order of the values.
FIELDS: dict[str, tuple[str, ...]] = {
    topic: tuple(kind.get_fields_and_field_types())[1:] for topic, (kind, _) in _LAYOUTS.items()
}
_CHANNELS = 6  # arrays of a waveform
_PADDING = 4  # bytes to which a message is padded
_FIXED = 16  # bytes of a waveform's fields before its arrays


class Telemetry:
    """Subscriptions to fast topics of a drill, and counts of what they lost.

    A message costs its listener a few microseconds: rclpy converts nothing. ``sinks`` has, by
    topic, a function of the stamp [ns] and the values: those of ``FIELDS`` in this order, and for
    ``waveform`` its sequence, its sample_period and a tuple of six NumPy arrays.

    A message of another length or encapsulation is ignored: a stranger may publish there too.
    """

    def __init__(
        self,
        listening: ListeningNode,
        sinks: Mapping[str, Callable[[int, tuple[Any, ...]], object]],
    ) -> None:
        self._listening = listening
        self._gaps: dict[str, SequenceGaps] = {}
        self._events: dict[str, int] = {}
        for topic, sink in sinks.items():
            if topic == "waveform":
                self._subscribe(topic, Waveform, _waves_to(sink), _WAVES)
            else:
                kind, layout = _LAYOUTS[topic]
                self._subscribe(topic, kind, _values_to(sink, layout), _DEPTH)

    @property
    def lost(self) -> Mapping[str, int]:
        """Messages by topic that were sent and never arrived."""
        # Both count the same losses; not every middleware has both.
        return {topic: max(gaps.missing, self._events[topic]) for topic, gaps in self._gaps.items()}

    def _subscribe(
        self, topic: str, kind: Any, decode: Callable[[bytes], None], depth: int
    ) -> None:
        node = self._listening.node
        name = node.resolve_topic_name(topic)
        gaps = self._gaps[topic] = SequenceGaps(lambda: node.count_publishers(name))
        self._events[topic] = 0

        def heard(data: bytes, info: dict[str, Any]) -> None:
            number = info["publication_sequence_number"]
            if number is not None:
                gaps.note(number)
            with suppress(struct.error, ValueError):  # of a stranger: not a message of this type
                decode(data)

        def lost(event: Any) -> None:
            self._events[topic] = int(event.total_count)

        options: dict[str, Any] = {"raw": True}
        options["event_callbacks"] = SubscriptionEventCallbacks(message_lost=lost)
        try:
            self._listening.subscribe(kind, topic, heard, QoSProfile(depth=depth), **options)
        except UnsupportedEventTypeError:
            del options["event_callbacks"]
            self._listening.subscribe(kind, topic, heard, QoSProfile(depth=depth), **options)


def _values_to(
    sink: Callable[[int, tuple[Any, ...]], object], layout: str
) -> Callable[[bytes], None]:
    before, _, behind = layout.partition("T")
    layouts = {order: struct.Struct(order + before) for order in "<>"}
    rests = {order: struct.Struct(order + behind) for order in "<>"} if behind else {}

    def decode(data: bytes) -> None:
        order = _order(data)
        stamp, place = _header(data, order)
        values = layouts[order].unpack_from(data, place)
        end = place + layouts[order].size
        if rests:
            text, place = _text(data, order, end)
            values = (*values, text, *rests[order].unpack_from(data, place))
            end = place + rests[order].size
        _check_end(data, end)
        sink(stamp, values)

    return decode


def _waves_to(sink: Callable[[int, tuple[Any, ...]], object]) -> Callable[[bytes], None]:
    def decode(data: bytes) -> None:
        order = _order(data)
        stamp, place = _header(data, order)
        sequence, period = struct.unpack_from(f"{order}Qd", data, place)
        place += _FIXED
        arrays = []
        for _ in range(_CHANNELS):
            (length,) = struct.unpack_from(f"{order}I", data, place)
            place = _aligned(place + 4) if length else place + 4
            arrays.append(np.frombuffer(data, f"{order}f8", length, place))
            place += 8 * length
        if all(map(len, arrays)):  # the middleware allots padding also to an empty array
            _check_end(data, place)
        sink(stamp, (sequence, period, tuple(arrays)))

    return decode


def _order(data: bytes) -> str:
    """Return the byte order of plain CDR, as ``struct`` names it."""
    order = {b"\0\0": ">", b"\0\1": "<"}.get(bytes(data[:2]))
    if order is None:
        raise ValueError("another encapsulation than plain CDR")
    return order


def _check_end(data: bytes, end: int) -> None:
    """Check that a message ends with its last field, but for padding to four bytes."""
    if not 0 <= len(data) - end < _PADDING:
        raise ValueError("another length: the sender has another definition of the type")


def _header(data: bytes, order: str) -> tuple[int, int]:
    """Return the stamp of a header [ns], and the place of an eight-byte field that follows it."""
    seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
    return seconds * SECOND + nanoseconds, _aligned(16 + length)


def _text(data: bytes, order: str, place: int) -> tuple[str, int]:
    (length,) = struct.unpack_from(f"{order}I", data, place)
    end = place + 4 + length
    return data[place + 4 : end].rstrip(b"\0").decode(), _aligned(end)


def _aligned(place: int) -> int:
    """Return the next place of an eight-byte number: counted after four bytes of encapsulation."""
    return 4 + (place - 4 + 7) // 8 * 8
