"""Topics of a client: of any type with the publishers' QoS, or fast ones without rclpy."""

from __future__ import annotations

import re
import time
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from typing import Any

from rclpy.exceptions import NameValidationException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.bag import BagFormatError
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.foundation.time import join_seconds
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.definitions import find_definition
from rpud_sim.ros.client.listening_node import ClientError, ListeningNode, NoAnswerError
from rpud_sim.ros.endpoints import FollowedTopic, SequenceGaps
from rpud_sim.ros.graph import UnknownTypeError, element_of, member_class, message_class
from rpud_sim.ros.process import name_error
from rpud_sim.simulation.topics import TOPICS

CUT = 128  # elements of an array, or characters of a text, that are shown unless all are wanted

_PART = re.compile(r"([A-Za-z]\w*)((?:\[\d+\])*)")
_DEPTH = 5_000  # messages that may wait for a listener; Fast DDS keeps no more
_PUBLISHER_WAIT = 1.0  # for a publisher of a topic that has a subscription [s]
_REFRESH_PERIOD = 0.5  # between looks at the publishers [s]
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

Sink = Callable[[int, tuple[Any, ...], int], object]


class FastTopics:
    """Subscriptions to fast topics of a drill, decoded without rclpy, and counts of losses.

    ``sinks`` has, by topic, a function of a message's stamp [ns], its values of ``FIELDS`` and when
    it was published [ns]. The values of ``waveform`` are its sequence, its sample_period and a
    tuple of six NumPy arrays.
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

        def on_message(data: bytes, info: dict[str, Any]) -> None:
            gaps.record(info["publication_sequence_number"])
            with suppress(BagFormatError):  # of another process: not of this type
                stamp, values = decoded(kind, data)
                values = (*values[:2], values[2:]) if is_wave else values
                sink(stamp, values, info["source_timestamp"])

        qos = QoSProfile(depth=_WAVES if is_wave else _DEPTH)
        listening.subscribe(kind, topic, on_message, qos, raw=True)


def decoded(kind: Any, data: bytes) -> tuple[int, tuple[Any, ...]]:
    """Return the stamp of a message [ns] and its other fields, or raise a BagFormatError."""
    header, *values = vars(_codec(kind).decode(data)).values()
    return join_seconds(header.stamp.sec, header.stamp.nanosec), tuple(values)


@cache
def _codec(kind: Any) -> Codec:
    name = f"rpud_msgs/msg/{kind.__name__}"
    return Codec(name, find_definition(name))


class TopicListener(FollowedTopic):
    """Subscription to a topic of any type, and its messages in the order of their arrival.

    Without a class of messages it waits ``patience`` for the topic [s]: a missing one is a
    NoAnswerError, one with several or unknown types a ClientError.
    """

    def __init__(
        self,
        listening: ListeningNode,
        topic: str,
        kind: Any = None,
        qos: QoSProfile | None = None,
        patience: float | None = None,
    ) -> None:
        self._listening = listening
        self.messages: list[Any] = []  # that have come and were not taken
        self.number = 0  # of the latest message, by its publisher
        name = absolute_name(listening.node, topic)
        patience = listening.patience if patience is None else patience
        kind = kind or _find_type(listening, name, patience)
        super().__init__(listening.node, name, kind, _DEPTH, qos)
        self._looked_at = time.monotonic()

    def take(self, seconds: float) -> list[Any]:
        """Return the messages that have come, or wait some seconds for the next one."""
        deadline = time.monotonic() + seconds
        while True:
            now = time.monotonic()
            if now >= self._looked_at + _REFRESH_PERIOD:
                self._looked_at = now
                if self._has_another_offer():
                    self.renew()
            self._listening.spin(min(0.1, max(0.0, deadline - now)))
            if self.messages or time.monotonic() >= deadline:
                messages = self.messages.copy()
                self.messages.clear()
                return messages

    def close(self) -> None:
        self._listening.unsubscribe(self.subscription)

    def _subscribe(self) -> Subscription:
        return self._listening.subscribe(self.kind, self.name, self._on_message, self.request)

    def _on_message(self, message: Any, info: dict[str, Any]) -> None:
        self.received_at = time.monotonic()
        self.messages.append(message)
        self.number = info["publication_sequence_number"] or 0
        self.gaps.record(self.number or None)


def _find_type(listening: ListeningNode, topic: str, patience: float) -> Any:
    node, until = listening.node, listening.wait_until
    try:
        types = until(lambda: types_of_topic(node, topic), "", patience)
    except NoAnswerError:
        hint = did_you_mean(topic, [name for name, _ in node.get_topic_names_and_types()])
        raise NoAnswerError(f"no topic {topic} within {patience:g} s; {hint}") from None
    if len(types) > 1:
        raise ClientError(f"topic {topic} has several types: {', '.join(types)}")
    # A subscription may be discovered before the publisher, whose QoS decides.
    with suppress(NoAnswerError):
        until(lambda: node.count_publishers(topic), "", min(patience, _PUBLISHER_WAIT))
    try:
        return message_class(types[0])
    except UnknownTypeError as error:
        raise ClientError(f"topic {topic}: {error}") from error


def absolute_name(node: Node, topic: str) -> str:
    """Return the absolute name of a topic."""
    try:
        validate_topic_name(topic)
        return expand_topic_name(topic, node.get_name(), node.get_namespace())
    except NameValidationException as error:
        raise name_error(error) from error


def types_of_topic(node: Node, topic: str) -> list[str]:
    """Return the types of the publishers and subscriptions of a topic, by its absolute name."""
    return sorted(dict(node.get_topic_names_and_types()).get(topic, []))


def to_plain(value: Any, cut: int | None = None) -> Any:
    """Convert a message or a field to plain values; arrays and texts end at ``cut`` in ``...``."""
    if hasattr(value, "get_fields_and_field_types"):
        names = value.get_fields_and_field_types()
        return {name: to_plain(getattr(value, name), cut) for name in names}
    if isinstance(value, bytes) and len(value) == 1:
        return value[0]
    if not hasattr(value, "__len__"):
        return value.item() if hasattr(value, "item") else value  # a number, also of NumPy
    kept = value[:cut]
    if isinstance(value, str):
        return kept if len(kept) == len(value) else kept + "..."
    plain = kept.tolist() if hasattr(kept, "tolist") else [to_plain(each, cut) for each in kept]
    return plain if len(kept) == len(value) else [*plain, "..."]


def field_getter(text: str, kind: Any) -> Callable[[Any], Any]:
    """Return the getter of a path such as ``faults[0].kind``; it gives None beyond an array."""
    steps: list[str | int] = []
    described = kind.__name__
    for part in text.split("."):
        match = _PART.fullmatch(part)
        if match is None:
            raise ParameterError(
                f"field {shown(text)} is not a path such as header.stamp or faults[0].kind"
            )
        name, indices = match.groups()
        if steps:
            is_message = "/" in described and not element_of(described)
            kind = member_class(described) if is_message else None
        fields = kind.get_fields_and_field_types() if kind else {}
        if name not in fields:
            hint = did_you_mean(name, fields) if fields else f"{described} has no fields"
            raise ParameterError(f"field {shown(text)}: there is no {shown(name)}; {hint}")
        steps.append(name)
        described = fields[name]
        for index in re.findall(r"\d+", indices):
            if not (element := element_of(described)):
                raise ParameterError(f"field {shown(text)}: {described} is not an array")
            described = element
            steps.append(int(index))

    def get(message: Any) -> Any:
        for step in steps:
            if isinstance(step, str):
                message = getattr(message, step)
            elif step < len(message):
                message = message[step]
            else:
                return None
        return message

    return get
