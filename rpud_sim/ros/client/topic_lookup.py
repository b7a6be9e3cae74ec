"""Type and QoS with which to subscribe to a topic that somebody publishes."""

from __future__ import annotations

from collections.abc import Sequence

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy

LISTENING_DEPTH = 5_000
"""Messages that may wait for a listener; Fast DDS keeps no more."""


def types_of_topic(node: Node, topic: str) -> list[str]:
    """Return the types with which a topic is published, by its absolute name."""
    return sorted({each.topic_type for each in node.get_publishers_info_by_topic(topic)})


def published_topics(node: Node) -> list[str]:
    """Return the absolute names of all topics that somebody publishes."""
    names = [name for name, _ in node.get_topic_names_and_types()]
    return sorted(name for name in names if node.count_publishers(name))


def listening_qos(offers: Sequence[QoSProfile]) -> QoSProfile:
    """Return the strongest request that all offers satisfy; reliable and volatile without one.

    A latched topic then gives its last messages at once.
    """
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = bool(offers) and all(
        offer.durability == DurabilityPolicy.TRANSIENT_LOCAL for offer in offers
    )
    return QoSProfile(
        depth=LISTENING_DEPTH,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )
