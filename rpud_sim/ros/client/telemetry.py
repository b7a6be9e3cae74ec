"""Fast topics of a drill: raw messages, of which only the shown fields are decoded."""

from __future__ import annotations

import re
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

# What follows the header of each type; `struct` pads nothing. T is a text, A an array of numbers.
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
_WAVEFORM = "QdAAAAAA"
_PADDING = 4  # bytes to which a message is padded


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
                self._subscribe(topic, Waveform, _decoder(_of_arrays(sink), _WAVEFORM), _WAVES)
            else:
                kind, layout = _LAYOUTS[topic]
                self._subscribe(topic, kind, _decoder(sink, layout), _DEPTH)

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
            gaps.note(info["publication_sequence_number"])
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


def _decoder(
    sink: Callable[[int, tuple[Any, ...]], object], layout: str
) -> Callable[[bytes], None]:
    """Return what gives a sink the stamp and the values of a message in plain CDR."""
    parts = [
        part if part in "TA" else {order: struct.Struct(order + part) for order in "<>"}
        for part in re.findall("[TA]|[^TA]+", layout)
    ]

    def decode(data: bytes) -> None:
        order = {b"\0\0": ">", b"\0\1": "<"}.get(bytes(data[:2]))
        if order is None:
            raise ValueError("another encapsulation than plain CDR")
        seconds, nanoseconds, length = struct.unpack_from(f"{order}iII", data, 4)
        place = _aligned(16 + length)
        values: tuple[Any, ...] = ()
        ends = True  # the middleware allots padding also to an empty array
        for part in parts:
            if isinstance(part, dict):
                values += part[order].unpack_from(data, place)
                place += part[order].size
                continue
            (length,) = struct.unpack_from(f"{order}I", data, place)
            place += 4
            if part == "T":
                values += (data[place : place + length].rstrip(b"\0").decode(),)
                place = _aligned(place + length)
            else:
                place = _aligned(place) if length else place
                values += (np.frombuffer(data, f"{order}f8", length, place),)
                place += 8 * length
                ends = ends and length > 0
        if ends and not 0 <= len(data) - place < _PADDING:
            raise ValueError("another length: the sender has another definition of the type")
        sink(seconds * SECOND + nanoseconds, values)

    return decode


def _of_arrays(
    sink: Callable[[int, tuple[Any, ...]], object],
) -> Callable[[int, tuple[Any, ...]], object]:
    return lambda stamp, values: sink(stamp, (*values[:2], values[2:]))


def _aligned(place: int) -> int:
    """Return the next place of an eight-byte number: counted after four bytes of encapsulation."""
    return 4 + (place - 4 + 7) // 8 * 8
