"""Topics of a client: of any type, or fast ones as bytes; messages as plain values."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from functools import partial
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, short_repr
from rpud_sim.messages.batch import Batch
from rpud_sim.ros.client.listening_node import ClientError, ListeningNode, NoAnswerError
from rpud_sim.ros.graph import (
    UnknownTypeError,
    element_of,
    member_class,
    message_class,
    resolve_topic,
)
from rpud_sim.ros.received import DEPTH, ReceivedTopic
from rpud_sim.simulation.topics import TOPICS

CUT = 128  # elements of an array, or characters of a text, that are shown unless all are wanted

_PART = re.compile(r"([A-Za-z]\w*)((?:\[\d+\])*)")
_PUBLISHER_WAIT = 1.0  # for a publisher of a topic that has a subscription [s]
_WAVES = 200  # blocks that may wait, each of some 100 kB


class FastTopics(dict[str, ReceivedTopic]):
    """Fast topics of a drill by name, whose messages wait as bytes until ``batches`` is called."""

    def __init__(self, listening: ListeningNode, topics: Iterable[str]) -> None:
        self._waiting: dict[str, list[tuple[bytes, int, int]]] = {}
        for topic in topics:
            waiting = self._waiting[topic] = []
            kind = message_class(TOPICS[topic].type)
            qos = QoSProfile(depth=_WAVES if topic == "waveform" else DEPTH)
            self[topic] = listening.subscribe(kind, topic, partial(_keep, waiting), qos)

    @property
    def lost(self) -> Mapping[str, int]:
        """Messages by topic that were sent and never arrived."""
        return {name: topic.lost for name, topic in self.items()}

    def batches(self) -> list[Batch]:
        """Return what came since the last call: of each topic with messages one batch."""
        found = [Batch.of_bytes(topic, held) for topic, held in self._waiting.items() if held]
        for waiting in self._waiting.values():
            waiting.clear()
        return found


def _keep(waiting: list[tuple[bytes, int, int]], *message: Any) -> None:
    waiting.append(message)


def listen(
    listening: ListeningNode,
    topic: str,
    messages: list[Any],
    kind: Any = None,
    qos: QoSProfile | None = None,
    patience: float | None = None,
) -> ReceivedTopic:
    """Subscribe to a topic of any type, whose messages are appended to a list.

    Without a class of messages it waits ``patience`` for the topic [s]: a missing one is a
    NoAnswerError, one with several or unknown types a ClientError.
    """
    name = resolve_topic(listening.node, topic)
    kind = kind or _find_type(listening, name, listening.patience if patience is None else patience)

    def receive(data: bytes, publish_time: int, log_time: int) -> None:
        messages.append(deserialize_message(data, kind))

    return listening.subscribe(kind, name, receive, qos)


def _find_type(listening: ListeningNode, topic: str, patience: float) -> Any:
    node, until = listening.node, listening.wait_until
    try:
        types = until(lambda: types_of_topic(node, topic), "", patience)
    except NoAnswerError:
        hint = did_you_mean(topic, [name for name, _ in node.get_topic_names_and_types()])
        raise NoAnswerError(f"no topic {topic} within {patience:g} s{hint}") from None
    if len(types) > 1:
        raise ClientError(f"topic {topic} has several types: {', '.join(types)}")
    # A subscription may be discovered before the publisher, whose QoS decides.
    with suppress(NoAnswerError):
        until(lambda: node.count_publishers(topic), "", min(patience, _PUBLISHER_WAIT))
    try:
        return message_class(types[0])
    except UnknownTypeError as error:
        raise ClientError(f"topic {topic}: {error}") from error


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
                f"field {short_repr(text)} is not a path such as header.stamp or faults[0].kind"
            )
        name, indices = match.groups()
        if steps:
            is_message = "/" in described and not element_of(described)
            kind = member_class(described) if is_message else None
        fields = kind.get_fields_and_field_types() if kind else {}
        if name not in fields:
            hint = did_you_mean(name, fields) if fields else f"; {described} has no fields"
            raise ParameterError(f"field {short_repr(text)}: there is no {short_repr(name)}{hint}")
        steps.append(name)
        described = fields[name]
        for index in re.findall(r"\d+", indices):
            if not (element := element_of(described)):
                raise ParameterError(f"field {short_repr(text)}: {described} is not an array")
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
