"""Fast topics of a drill: raw messages, decoded without rclpy."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from typing import Any

from rclpy.qos import QoSProfile

from rpud_sim.bag import BagFormatError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.time import join_seconds
from rpud_sim.ros.client.listening_node import ListeningNode
from rpud_sim.ros.graph import message_class
from rpud_sim.ros.sequence_gaps import SequenceGaps
from rpud_sim.simulation.topics import TOPICS

_DEPTH = 5_000  # messages that may wait; Fast DDS keeps no more
_WAVES = 200  # blocks that may wait, each of some 100 kB
_TYPES = {
    name: message_class(TOPICS[name].type)
    for name in (
        *("nodal_plane", "drill_tool", "reacting_force", "contact_force", "actuator_state"),
        *("rotation", "mount", "borehole", "waveform"),
    )
}
# Fields by topic, in the order of the values.
FIELDS: dict[str, tuple[str, ...]] = {
    topic: tuple(kind.get_fields_and_field_types())[1:]
    for topic, kind in _TYPES.items()
    if topic != "waveform"
}

Sink = Callable[[int, tuple[Any, ...]], object]


class FastTopics:
    """Subscriptions to fast topics of a drill, and counts of what they lost.

    A message costs its listener a few microseconds: rclpy converts nothing. ``sinks`` has, by
    topic, a function of the stamp [ns] and the values: those of ``FIELDS`` in this order, and for
    ``waveform`` its sequence, its sample_period and a tuple of six NumPy arrays.

    A message of another length or encapsulation is ignored: a stranger may publish there too.
    """

    def __init__(self, listening: ListeningNode, sinks: Mapping[str, Sink]) -> None:
        self._gaps: dict[str, SequenceGaps] = {}
        for topic, sink in sinks.items():
            self._subscribe(listening, topic, sink)

    @property
    def lost(self) -> Mapping[str, int]:
        """Messages by topic that were sent and never arrived."""
        return {topic: gaps.missing for topic, gaps in self._gaps.items()}

    def _subscribe(self, listening: ListeningNode, topic: str, sink: Sink) -> None:
        name = listening.node.resolve_topic_name(topic)
        gaps = SequenceGaps(lambda: listening.node.count_publishers(name))
        self._gaps[topic] = gaps
        is_wave = topic == "waveform"
        kind = _TYPES[topic]

        def heard(data: bytes, info: dict[str, Any]) -> None:
            gaps.note(info["publication_sequence_number"])
            with suppress(BagFormatError):  # of a stranger: not a message of this type
                stamp, values = decoded(kind, data)
                sink(stamp, (*values[:2], values[2:]) if is_wave else values)

        qos = QoSProfile(depth=_WAVES if is_wave else _DEPTH)
        listening.subscribe(kind, topic, heard, qos, raw=True)


def decoded(kind: Any, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Return the stamp of a message [ns] and its other fields, or raise a BagFormatError."""
    header, *values = vars(_codec(kind).decode(data)).values()
    return join_seconds(header.stamp.sec, header.stamp.nanosec), tuple(values)


@cache
def _codec(kind: Any) -> Codec:
    name = f"rpud_msgs/msg/{kind.__name__}"
    return Codec(name, find_definition(name))
