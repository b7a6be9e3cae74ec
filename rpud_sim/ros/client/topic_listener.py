"""Listener to one topic of any type, and its messages as plain values."""

from __future__ import annotations

import re
import time
from collections import deque
from collections.abc import Sequence
from contextlib import suppress
from typing import Any

from rclpy.exceptions import NameValidationException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.bag.losses import SequenceGaps
from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.ros.client.listening_node import ClientError, ListeningNode, NoAnswerError
from rpud_sim.ros.graph import UnknownTypeError, is_satisfied, message_class, request_for
from rpud_sim.ros.starting import name_error

CUT = 128  # elements of an array, or characters of a text, that are shown unless all are wanted

_PART = re.compile(r"([A-Za-z]\w*)((?:\[\d+\])*)")
_ELEMENT = re.compile(r"sequence<(.+?)(?:, *\d+)?>|(.+)\[\d+\]")
_MESSAGE = re.compile(r"(\w+)/(\w+)")
_DEPTH = 5_000  # messages that may wait for a listener; Fast DDS keeps no more
_PUBLISHER_WAIT = 1.0  # for a publisher of a topic that has a subscription [s]
_REFRESH_PERIOD = 0.5  # between looks at the publishers [s]


class TopicListener:
    """Subscription to a topic, and its messages in the order in which they came.

    The name is absolute or relative to the node's namespace; it waits ``patience`` for the topic
    [s]. A topic that is missing, or has several types or one that is not installed, is a
    ClientError.
    """

    def __init__(self, listening: ListeningNode, topic: str, patience: float) -> None:
        self._listening = listening
        self._node = listening.node
        self.topic = absolute_name(self._node, topic)  # absolute name
        self.kind = self._find(patience)  # class of the messages
        self._gaps = SequenceGaps(lambda: self._node.count_publishers(self.topic))
        self._messages: deque[Any] = deque()
        self._heard = False
        self._subscription: Subscription | None = None
        self._request: QoSProfile | None = None
        self._due = 0.0
        self._refresh()

    @property
    def lost(self) -> int:
        """Messages that are missing between those that came."""
        return self._gaps.missing

    def take(self, seconds: float) -> list[Any]:
        """Return the messages that have come, or wait some seconds for the next one."""
        deadline = time.monotonic() + seconds
        while True:
            if time.monotonic() >= self._due:
                self._refresh()
            self._listening.spin(min(0.1, max(0.0, deadline - time.monotonic())))
            if self._messages or time.monotonic() >= deadline:
                messages = list(self._messages)
                self._messages.clear()
                return messages

    def _find(self, patience: float) -> Any:
        node, topic = self._node, self.topic
        try:
            types = self._listening.until(lambda: types_of_topic(node, topic), patience, "")
        except NoAnswerError:
            names = [name for name, _ in node.get_topic_names_and_types()]
            hint = did_you_mean(topic, names)
            raise ClientError(f"no topic {topic} within {patience:g} s; {hint}") from None
        if len(types) > 1:
            raise ClientError(f"topic {topic} has several types: {', '.join(types)}")
        try:
            kind = message_class(types[0])
        except UnknownTypeError as error:
            raise ClientError(f"topic {topic}: {error}") from error
        # A subscription may be discovered before the publisher, whose QoS decides.
        limit = min(patience, _PUBLISHER_WAIT)
        with suppress(NoAnswerError):
            self._listening.until(lambda: offers_of_topic(node, topic), limit, "")
        return kind

    def _refresh(self) -> None:
        self._due = time.monotonic() + _REFRESH_PERIOD
        request = listening_qos(offers_of_topic(self._node, self.topic))
        before = self._request
        if before is not None:
            same = (request.reliability, request.durability) == (
                before.reliability,
                before.durability,
            )
            # A stronger request would give latched messages a second time.
            if same or (self._heard and is_satisfied(before, [request])):
                return
        if self._subscription is not None:
            self._listening.unsubscribe(self._subscription)
        self._request = request
        self._subscription = self._listening.subscribe(
            self.kind, self.topic, self._on_message, request
        )

    def _on_message(self, message: Any, info: dict[str, Any]) -> None:
        self._heard = True
        self._messages.append(message)
        self._gaps.note(info["publication_sequence_number"])


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


def offers_of_topic(node: Node, topic: str) -> list[QoSProfile]:
    """Return the QoS of each publisher of a topic, by its absolute name."""
    return [endpoint.qos_profile for endpoint in node.get_publishers_info_by_topic(topic)]


def listening_qos(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strongest request that all offers satisfy; reliable and volatile without one.

    A latched topic then gives its last messages at once.
    """
    return request_for(offers, _DEPTH) if offers else QoSProfile(depth=_DEPTH)


def to_plain(value: Any, cut: int | None = None) -> Any:
    """Convert a message or a field to plain values; arrays and texts end at ``cut`` in ``...``."""
    if hasattr(value, "get_fields_and_field_types"):
        return {
            name: to_plain(getattr(value, name), cut) for name in value.get_fields_and_field_types()
        }
    if isinstance(value, str):
        return value if cut is None or len(value) <= cut else value[:cut] + "..."
    if isinstance(value, bytes):
        return value[0] if len(value) == 1 else list(value)
    if isinstance(value, (bool, int, float)):
        return value
    if not hasattr(value, "__len__"):  # NumPy's numbers
        return value.item()
    kept = value if cut is None else value[:cut]
    plain = kept.tolist() if hasattr(kept, "tolist") else [to_plain(each, cut) for each in kept]
    return plain if len(kept) == len(value) else [*plain, "..."]


class FieldPath:
    """Path to a field of a message, such as ``header.stamp.sec`` or ``faults[0].kind``."""

    def __init__(self, text: str, kind: Any) -> None:
        self._steps: list[str | int] = []
        described = ""
        for part in text.split("."):
            match = _PART.fullmatch(part)
            if match is None:
                raise ParameterError(
                    f"field {shown(text)} is not a path such as header.stamp or faults[0].kind"
                )
            name, indices = match.groups()
            fields = {} if kind is None else kind.get_fields_and_field_types()
            if name not in fields:
                hint = did_you_mean(name, fields) if fields else f"{described} has no fields"
                raise ParameterError(f"field {shown(text)}: there is no {shown(name)}; {hint}")
            self._steps.append(name)
            described = fields[name]
            for index in re.findall(r"\d+", indices):
                element = _ELEMENT.fullmatch(described)
                if element is None:
                    raise ParameterError(f"field {shown(text)}: {described} is not an array")
                described = element[1] or element[2]
                self._steps.append(int(index))
            message = _MESSAGE.fullmatch(described)
            kind = message_class(f"{message[1]}/msg/{message[2]}") if message else None

    def value(self, message: Any) -> Any:
        """Return the field of a message; None if an array is too short."""
        value = message
        for step in self._steps:
            if isinstance(step, str):
                value = getattr(value, step)
            elif step < len(value):
                value = value[step]
            else:
                return None
        return value
