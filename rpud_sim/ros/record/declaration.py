"""Declaration of a recorded topic in its bag: type, definition and offered QoS."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from enum import Enum

from rclpy.duration import Duration
from rclpy.qos import QoSProfile

from rpud_sim.bag import BagError, Topic
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.messages.definitions import find_definition, find_type_hash
from rpud_sim.ros.received import ReceivedTopic


def declaration(topic: ReceivedTopic, *, received: bool) -> tuple[Topic, str | None]:
    """Return the topic and its definition for the bag; ``received`` if it has had a message."""
    endpoints = topic.publishers() or topic.endpoints
    offers = [endpoint.qos_profile for endpoint in endpoints]
    if received and not offers:
        # Its publisher is gone already; it offered at least what was requested.
        offers = [topic.request]

    def find(what: Callable[[str], str]) -> str | None:
        try:
            return what(topic.type)
        except BagError as error:
            topic.node.get_logger().warning(f"{error}; the bag lacks it")
            return None

    type_hash = str(endpoints[0].topic_type_hash) if endpoints else find(find_type_hash) or ""
    profiles = tuple(map(_recorded, offers))
    return Topic(topic.name, topic.type, type_hash, profiles), find(find_definition)


def _recorded(profile: QoSProfile) -> RecordedProfile:
    """Return a QoS as a bag holds it: names of policies, durations in ns."""
    values = {field.name: getattr(profile, field.name) for field in fields(RecordedProfile)}
    for name, value in values.items():
        if isinstance(value, Enum):
            values[name] = value.name.lower()
        elif isinstance(value, Duration):
            values[name] = value.nanoseconds
    return RecordedProfile(**values)
