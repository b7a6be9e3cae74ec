"""Subscriptions without an executor, with the QoS that all publishers of a topic offer."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from math import inf
from typing import Any

from rclpy.node import Node
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo

from rpud_sim.ros.sequence_gaps import SequenceGaps

_MOST_AT_ONCE = 10_000  # messages of a topic; more would keep its owner from looking


def taken(subscription: Subscription, most: int = _MOST_AT_ONCE) -> Iterator[tuple[Any, Any]]:
    """Yield the messages that have arrived, with their information.

    An executor costs several times as much for each message as the message itself.
    """
    handle = subscription.handle
    with handle:
        for _ in range(most):
            found = handle.take_message(subscription.msg_type, subscription.raw)
            if found is None:
                return
            yield found


def request_for(offers: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return the strongest request that every offer satisfies, so that all of them connect.

    Without an offer it is reliable and volatile.
    """
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = bool(offers) and all(map(_is_latched, offers))
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def _is_latched(profile: QoSProfile) -> bool:
    return bool(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


class FollowedTopic:
    """Topic of one type, subscribed with the strongest QoS that all of its publishers offer.

    Its messages are serialized. Before the first publisher its subscribers show what that will have
    to offer. ``request`` is a QoS in place of that.
    """

    def __init__(
        self, node: Node, name: str, kind: Any, depth: int, request: QoSProfile | None = None
    ) -> None:
        self.name = name  # absolute
        self.kind = kind  # class of the messages
        self.received_at = -inf  # when a message came last, by the monotonic clock [s]
        self.gaps = SequenceGaps(lambda: node.count_publishers(name))
        self._node = node
        self._depth = depth
        self.endpoints = self._publishers()  # publishers that were found last
        self._offers = [each.qos_profile for each in self.endpoints]  # of those that are there
        known = self.endpoints or node.get_subscriptions_info_by_topic(name)
        self.request = request or request_for([each.qos_profile for each in known], depth)
        self.subscription = self._subscribe()

    @property
    def latched(self) -> bool:
        """Whether the last messages of before are requested, too."""
        return _is_latched(self.request)

    @property
    def lost(self) -> int:
        """Messages that are missing between those that came."""
        return self.gaps.missing

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self.subscription)

    def renew(self) -> None:
        """Subscribe again; what the old subscription holds is lost."""
        self.close()
        self.subscription = self._subscribe()

    def _has_another_offer(self) -> bool:
        """Look at the publishers; return whether their offers are for another subscription.

        They are if one connects to less than is requested, or if they have become latched before
        the first message: later their messages would come twice.
        """
        endpoints = self._publishers()
        self.endpoints = endpoints or self.endpoints
        self._offers = [each.qos_profile for each in endpoints]
        request = request_for(self._offers, self._depth)
        gains = _is_latched(request) and not self.latched and self.received_at == -inf
        if gains or not is_satisfied(self.request, self._offers):
            self.request = request
            return True
        return False

    def _publishers(self) -> list[TopicEndpointInfo]:
        return list(self._node.get_publishers_info_by_topic(self.name))

    def _subscribe(self) -> Subscription:
        # The owner takes the messages, so nothing ever calls the callback.
        return self._node.create_subscription(
            self.kind, self.name, lambda _: None, self.request, raw=True
        )


def is_satisfied(request: QoSProfile, offers: Sequence[QoSProfile]) -> bool:
    """Return whether a request connects to every offer."""
    return all(
        qos_check_compatible(offer, request)[0] != QoSCompatibility.ERROR for offer in offers
    )
