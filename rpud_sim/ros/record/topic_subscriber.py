"""Subscriptions of recorded topics: with the QoS that publishers offer, renewed where necessary."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.bag import BagError, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import SequenceGaps
from rpud_sim.ros.qos import is_satisfied, recorded_profile, request_for
from rpud_sim.ros.record.message_queue import Declaration
from rpud_sim.ros.record.recorded_topic import RecordedTopic
from rpud_sim.ros.types import message_class


class TopicSubscriber:
    """Subscribes to topics, and follows the publishers of each.

    Args:
        node: that owns the subscriptions.
        drain: receives what a subscription still holds before it is renewed.
    """

    def __init__(self, node: Node, drain: Callable[[RecordedTopic], None]) -> None:
        self._node = node
        self._drain = drain

    def subscribe(self, name: str, type_name: str) -> RecordedTopic:
        message = message_class(type_name)
        endpoints = self._publishers(name, type_name)
        # Before the first publisher its subscribers show what it will have to offer.
        known = endpoints or self._node.get_subscriptions_info_by_topic(name)
        request = request_for([endpoint.qos_profile for endpoint in known])
        subscription = self._subscribe(name, message, request)
        self._node.get_logger().info(f"subscribed {name} [{type_name}]")
        return RecordedTopic(
            name=name,
            type=type_name,
            message=message,
            subscription=subscription,
            request=request,
            gaps=SequenceGaps(lambda: self._node.count_publishers(name)),
            endpoints=endpoints,
        )

    def follow(self, topic: RecordedTopic) -> None:
        """Subscribe again if the publishers of a topic need it."""
        endpoints = self._publishers(topic.name, topic.type)
        if not endpoints:
            topic.note_silence()
            return
        topic.endpoints = endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if not is_satisfied(topic.request, offers):
            topic.request = request_for(offers)
            self.renew(topic, "a publisher offers less than before")
            return
        if topic.misses(offers):
            topic.renewals += 1
            self.renew(topic, "a publisher that is there was not heard")

    def renew(self, topic: RecordedTopic, reason: str) -> None:
        """Subscribe to a topic again, and log why."""
        self._drain(topic)
        self._node.destroy_subscription(topic.subscription)
        topic.unmatched = None
        topic.subscription = self._subscribe(topic.name, topic.message, topic.request)
        self._node.get_logger().warning(f"subscribed {topic.name} again, as {reason}")

    def declaration(self, topic: RecordedTopic, *, received: bool) -> Declaration:
        """Return the bag's declaration of a topic, of which a message may have been received."""
        endpoints = self._publishers(topic.name, topic.type) or topic.endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if received and not offers:
            # Its publisher is gone already; it offered at least what was requested.
            offers = [topic.request]
        hashes = [str(endpoint.topic_type_hash) for endpoint in endpoints]
        return Declaration(
            Topic(
                name=topic.name,
                type=topic.type,
                type_hash=hashes[0] if hashes else self._find(find_type_hash, topic.type) or "",
                offered_qos=tuple(recorded_profile(offer) for offer in offers),
            ),
            self._find(find_definition, topic.type),
        )

    def _publishers(self, name: str, type_name: str) -> list[TopicEndpointInfo]:
        endpoints = self._node.get_publishers_info_by_topic(name)
        return [endpoint for endpoint in endpoints if endpoint.topic_type == type_name]

    def _subscribe(self, name: str, message: Any, request: QoSProfile) -> Subscription:
        # The recorder takes messages in batches, so nothing ever calls the callback: an executor
        # costs several times as much for each message as the message itself.
        return self._node.create_subscription(message, name, lambda _: None, request, raw=True)

    def _find(self, find: Callable[[str], str], type_name: str) -> str | None:
        try:
            return find(type_name)
        except BagError as error:
            self._node.get_logger().warning(f"{error}; the bag lacks it")
            return None
