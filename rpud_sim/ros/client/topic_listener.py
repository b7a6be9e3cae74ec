"""Listener to one topic of any type, whose QoS follows that of the publishers."""

from __future__ import annotations

import time
from collections import deque
from contextlib import suppress
from typing import Any

from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from rpud_sim.bag.sequence import SequenceGaps
from rpud_sim.foundation.quantities import did_you_mean
from rpud_sim.ros.client.errors import ClientError, NoAnswerError
from rpud_sim.ros.client.listening_node import ListeningNode
from rpud_sim.ros.client.topic_lookup import (
    absolute_name,
    listening_qos,
    offers_of_topic,
    types_of_topic,
)
from rpud_sim.ros.graph import UnknownTypeError, message_class

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
            weaker = (
                request.reliability.value > before.reliability.value
                or request.durability.value > before.durability.value
            )
            same = (request.reliability, request.durability) == (
                before.reliability,
                before.durability,
            )
            # A stronger request would give latched messages a second time.
            if same or (self._heard and not weaker):
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
        number = info["publication_sequence_number"]
        if number is not None:  # not every middleware counts
            self._gaps.note(number)
