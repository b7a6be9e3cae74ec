"""Subscription to a topic of any type: what arrived, what is lost, and what is damaged."""

from __future__ import annotations

import time
from collections.abc import Callable
from math import inf
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.ros.endpoints import SequenceGaps, is_latched, is_satisfied, request_for, taken
from rpud_sim.ros.graph import type_name

DEPTH = 5_000  # messages that may wait to be taken; Fast DDS keeps no more of a publisher

_ENCAPSULATION = 4  # bytes before the fields of every message (CDR)
_MATCHING = 3.0  # s in which a publisher that was found should be connected
DISCOVERY = 3.5  # s in which every publisher is found; the middleware announces itself every 3 s
_LATEST = 2**63 - 1  # in a bag [ns since the epoch]
_AWAY = 86_400_000_000_000  # that our clock may be set while a message waits [ns]

Sink = Callable[[bytes, int, int], object]
"""It takes a serialized message, and when it was published and received [ns since the epoch]."""


class ReceivedTopic:
    """Topic of one type, with its received, lost and damaged messages, which ``sink`` takes.

    Without a ``request`` it is subscribed with the strongest QoS that all of its publishers offer.
    If its publishers are ``new`` here, what they have sent before is lost, too.
    ``take`` is called by the owner; an executor of the node has the same effect.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: Any,
        sink: Sink,
        request: QoSProfile | None = None,
        depth: int = DEPTH,
        *,
        new: bool = False,
    ) -> None:
        self.name = name  # absolute
        self.kind = kind  # class of the messages
        self.type = type_name(kind)
        self.number: int | None = None  # of the latest message, by its publisher
        self.received_at = -inf  # when a message came last, by the monotonic clock [s]
        self.gaps = SequenceGaps(lambda: node.count_publishers(name))
        self.counts = True  # whether a gap is a loss
        self.numbered = True  # whether the middleware numbers messages
        self.damaged = 0  # messages that were damaged
        self.renewals = 0  # subscriptions that were renewed as a publisher was silent
        self.node = node
        self._sink = sink
        self._uncounted = 0  # damaged messages whose numbers are a gap in the next ones
        self._latest: dict[tuple[int, int | None, int], None] = {}
        self._depth, self._chosen = depth, request is None
        # By the monotonic clock [s]: when every publisher that was there is known, and when as many
        # as are known should be connected.
        self._settled_at = time.monotonic() + DISCOVERY
        self._matched_by = inf
        self.endpoints = self.publishers()  # publishers that were found last
        known = self.endpoints or node.get_subscriptions_info_by_topic(name)
        self.request = request or request_for([each.qos_profile for each in known], depth)
        self.gaps.from_first = new and not self.latched
        self.subscription = self._subscribe()

    @property
    def latched(self) -> bool:
        """Whether the last messages of before are requested, too."""
        return is_latched(self.request)

    @property
    def lost(self) -> int:
        """Messages that are missing between those that came."""
        return self.gaps.missing

    def publishers(self) -> list[TopicEndpointInfo]:
        """Return the discovered publishers of this topic and type."""
        found = self.node.get_publishers_info_by_topic(self.name)
        return [each for each in found if each.topic_type == self.type]

    def take(self) -> None:
        """Take what has arrived."""
        for data, info in taken(self.subscription):
            self.receive(data, info)

    def receive(self, data: bytes, info: dict[str, Any]) -> None:
        """Count a message, and hand it to the sink unless it is damaged or repeated."""
        log_time = info["received_timestamp"] or time.time_ns()
        publish_time, number = info["source_timestamp"], info["publication_sequence_number"]
        if is_damaged(data, log_time, publish_time):
            self.damaged += 1
            self._uncounted += 1
            return
        if self.latched:
            key = publish_time, number, hash(data)  # publishers may have no clock
            if key in self._latest:
                return
            self._latest[key] = None
            if len(self._latest) > self._depth:
                del self._latest[next(iter(self._latest))]
        self.received_at = time.monotonic()
        self.note(number)
        self._sink(data, publish_time, log_time)

    def note(self, number: int | None) -> None:
        """Note the number of the latest message, by its publisher."""
        self.number = number
        self.numbered = self.numbered and number is not None
        before = self.gaps.missing
        self.gaps.record(number)
        if not self.counts:
            self.gaps.missing = before
        elif found := self.gaps.missing - before:
            self.gaps.missing -= min(found, self._uncounted)
            self._uncounted = 0

    def has_other_offers(self) -> bool:
        """Look at the publishers; return whether their offers need another subscription."""
        endpoints = self.publishers()
        self.endpoints = endpoints or self.endpoints
        self._offers = [each.qos_profile for each in endpoints]
        request = request_for(self._offers, self._depth)
        gains = is_latched(request) and not self.latched and self.received_at == -inf
        if self._chosen and (gains or not is_satisfied(self.request, self._offers)):
            self.request = request
            return True
        return False

    def follow(self) -> str:
        """Look at the publishers; return why to subscribe again because of them, or ""."""
        if self.has_other_offers():
            return "its publishers offer something else"
        now = time.monotonic()
        if not self.endpoints:
            # Those that come from now on are new: their first messages, before they know the
            # subscription, are lost.
            if now >= self._settled_at and not self.latched:
                self.gaps.from_first = True
        elif self.subscription.handle.get_publisher_count() >= len(self._offers):
            self._matched_by = inf
        elif now >= self._matched_by:
            self.renewals += 1
            return "a publisher that is there was not connected"
        elif self._matched_by == inf:
            self._matched_by = now + _MATCHING * 2 ** min(self.renewals, 5)
        return ""

    def renew(self) -> None:
        """Subscribe again; what the old subscription holds is lost."""
        self.close()
        self.subscription = self._subscribe()
        self._matched_by = inf

    def close(self) -> None:
        """Unsubscribe."""
        self.node.destroy_subscription(self.subscription)

    def _subscribe(self) -> Subscription:
        take: Any = self.receive  # with information, which the types of rclpy leave out
        return self.node.create_subscription(self.kind, self.name, take, self.request, raw=True)


def is_damaged(data: bytes, log_time: int, publish_time: int) -> bool:
    """Return whether these cannot be a message and its times [ns since the epoch].

    Shared memory that a killed process has left behind gives such messages.
    """
    received_about_now = abs(log_time - time.time_ns()) <= _AWAY
    return len(data) < _ENCAPSULATION or not (received_about_now and 0 <= publish_time <= _LATEST)
