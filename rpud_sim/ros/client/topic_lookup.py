"""Type and QoS with which to subscribe to a topic of the graph."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.qos import QoSProfile

from rpud_sim.ros.qos import request_for

_DEPTH = 5_000  # messages that may wait for a listener; Fast DDS keeps no more


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
    request = request_for(offers) if offers else QoSProfile(depth=_DEPTH)
    request.depth = _DEPTH
    return request
