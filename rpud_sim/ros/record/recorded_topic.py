"""Topics that are recorded: what arrived of each, what is lost, and what nobody can know."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import fields
from enum import Enum
from math import inf
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.bag import BagError, Message, Topic
from rpud_sim.bag.metadata import Losses
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.ros.endpoints import FollowedTopic
from rpud_sim.ros.graph import message_class

# Messages that may wait in the middleware for the recorder: ten seconds of a 1 kHz topic.
RECORDING_DEPTH = 10_000

_ENCAPSULATION = 4  # bytes before the fields of every message (CDR)
_MATCHING = 3.0  # s in which a publisher that was found should be connected
_DISCOVERY = 3.5  # s in which every publisher is found; the middleware announces itself every 3 s
_LATEST = 2**63 - 1  # in a bag [ns since the epoch]
_AWAY = 86_400_000_000_000  # that our clock may be set while a message waits [ns]


class RecordedTopic(FollowedTopic):
    """Topic of one type, with counts of its received, lost and damaged messages."""

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        self.type = type_name
        super().__init__(node, name, message_class(type_name), RECORDING_DEPTH)
        self.declared = False  # whether the bag has its declaration
        self.further_types: set[str] = set()  # of the topic, which are not recorded
        self.received_until = 0  # log time of the last message [ns]
        self.damaged = 0  # messages that were damaged
        self.renewals = 0  # subscriptions that were renewed as a publisher was silent
        self._numbered = True  # whether the middleware numbers messages
        self._uncounted = 0  # damaged messages whose numbers are a gap in the next ones
        self._latest: dict[tuple[int, int | None, int], None] = {}
        # By the monotonic clock [s]: when every publisher that was there is known, and when as many
        # as are known should be connected.
        self._settled_at = time.monotonic() + _DISCOVERY
        self._matched_by = inf

    def losses(self, refused: int) -> Losses:
        """Return the losses; ``refused`` are messages that did not fit into the queue."""
        return Losses(self.gaps.missing if self._numbered else None, refused, self.damaged)

    def follow(self) -> str:
        """Look at the publishers; return why to subscribe again because of them, or ""."""
        now = time.monotonic()
        if self._has_another_offer():
            return "its publishers offer something else"
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
        super().renew()
        self._matched_by = inf

    def declaration(self, *, received: bool) -> tuple[Topic, str | None]:
        """Return the topic and its definition for the bag; ``received`` if it has had a message."""
        endpoints = self._publishers() or self.endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if received and not offers:
            # Its publisher is gone already; it offered at least what was requested.
            offers = [self.request]
        hashes = [str(endpoint.topic_type_hash) for endpoint in endpoints]
        topic = Topic(
            name=self.name,
            type=self.type,
            type_hash=hashes[0] if hashes else self._find(find_type_hash) or "",
            offered_qos=tuple(map(recorded_profile, offers)),
        )
        return topic, self._find(find_definition)

    def accept(self, data: bytes, info: dict[str, Any], *, counts: bool) -> Message | None:
        """Return the message, None if damaged or repeated; ``counts`` makes a gap a loss."""
        log_time = info["received_timestamp"] or time.time_ns()
        publish_time, number = info["source_timestamp"], info["publication_sequence_number"]
        if is_damaged(data, log_time, publish_time):
            self.damaged += 1
            self._uncounted += 1
            return None
        if self.latched:
            key = publish_time, number, hash(data)  # publishers may have no clock
            if key in self._latest:
                return None
            self._latest[key] = None
            if len(self._latest) > RECORDING_DEPTH:
                del self._latest[next(iter(self._latest))]
        self.received_at = time.monotonic()
        self._numbered = self._numbered and number is not None
        before = self.gaps.missing
        self.gaps.record(number)
        if not counts:
            self.gaps.missing = before
        elif found := self.gaps.missing - before:
            self.gaps.missing -= min(found, self._uncounted)
            self._uncounted = 0
        return Message(self.name, log_time, publish_time, data)

    def _publishers(self) -> list[TopicEndpointInfo]:
        return [each for each in super()._publishers() if each.topic_type == self.type]

    def _find(self, find: Callable[[str], str]) -> str | None:
        try:
            return find(self.type)
        except BagError as error:
            self._node.get_logger().warning(f"{error}; the bag lacks it")
            return None


def is_damaged(data: bytes, log_time: int, publish_time: int) -> bool:
    """Return whether these cannot be a message and its times [ns since the epoch].

    Shared memory that a killed process has left behind gives such messages.
    """
    received_about_now = abs(log_time - time.time_ns()) <= _AWAY
    return len(data) < _ENCAPSULATION or not (received_about_now and 0 <= publish_time <= _LATEST)


def recorded_profile(profile: QoSProfile) -> RecordedProfile:
    """Return a QoS as a bag holds it: names of policies, durations in ns."""
    values = {field.name: getattr(profile, field.name) for field in fields(RecordedProfile)}
    for name, value in values.items():
        if isinstance(value, Enum):
            values[name] = value.name.lower()
        elif isinstance(value, Duration):
            values[name] = value.nanoseconds
    return RecordedProfile(**values)
