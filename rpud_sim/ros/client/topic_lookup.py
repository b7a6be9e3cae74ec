"""Type and QoS with which to subscribe to a topic of the graph."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.exceptions import NameValidationException
from rclpy.expand_topic_name import expand_topic_name
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.ros.graph import request_for
from rpud_sim.ros.starting import name_error

_DEPTH = 5_000  # messages that may wait for a listener; Fast DDS keeps no more


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
