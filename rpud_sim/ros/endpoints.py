"""Publishers that wait for their subscribers, requests of QoS, and gaps of sequences."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from rclpy.duration import Duration
from rclpy.publisher import Publisher
from rclpy.qos import (
    DurabilityPolicy,
    QoSCompatibility,
    QoSProfile,
    ReliabilityPolicy,
    qos_check_compatible,
)
from rclpy.subscription import Subscription

# That running subscribers have to take the last messages [s]: `launch` sends SIGTERM after 5 s.
LAST_WAIT = 4.0
_SHORT_WAIT = 0.05  # for acknowledgements, between looks at who lacks them [s]
_SEQUENCES = 64  # of one topic at most; the oldest, of publishers that left, are discarded
_MOST_AT_ONCE = 10_000  # messages of a topic; more would keep its owner from looking


@dataclass
class AcknowledgedPublisher:
    """Publisher of a topic, and how far it may run ahead of reliable subscribers."""

    publisher: Publisher
    send: Callable[[bytes], object]
    depth: float  # messages that it keeps; infinite where one may be overwritten
    left: float  # messages that may follow before a wait
    late: bool = False  # whether the last wait was in vain
    ended: bool = False  # whether that was because a subscriber had ended

    def acknowledged(self, seconds: float = 0.0) -> bool:
        """Wait until reliable subscribers have all messages; return whether they have."""
        return bool(self.publisher.wait_for_all_acked(Duration(seconds=seconds)))


class AcknowledgedPublishers(dict[str, AcknowledgedPublisher]):
    """Publishers by topic; messages in a hurry wait for reliable subscribers, ``longest`` [s].

    Beyond its depth a publisher overwrites messages, whether subscribers have them or not. A
    topic does not wait long where ``lost`` is true of its name: a subscriber has ended.
    """

    def __init__(self, longest: float, lost: Callable[[str], bool] = lambda _: False) -> None:
        super().__init__()
        # Messages that a subscriber may lack, at most, by topic and whether one had ended.
        self.overwritten = Counter[tuple[str, bool]]()
        self.lost = lost
        self._longest = longest

    def add(self, name: str, publisher: Publisher, depth: float) -> AcknowledgedPublisher:
        # Without the checks of rclpy: they take a fifth of the time of each message.
        send = publisher.handle.publish_raw
        self[name] = added = AcknowledgedPublisher(publisher, send, depth, depth)
        return added

    @property
    def subscribers(self) -> dict[str, int]:
        """Numbers of subscriptions that the topics reach."""
        return {name: each.publisher.get_subscription_count() for name, each in self.items()}

    @property
    def unsubscribed(self) -> list[str]:
        """Topics without a subscriber."""
        return [name for name, count in self.subscribers.items() if not count]

    def send(self, name: str, message: bytes, *, hurried: bool) -> None:
        """Publish a message; one that is ``hurried`` lets none be overwritten."""
        publisher = self[name]
        publisher.send(message)
        if publisher.late:
            self.overwritten[name, publisher.ended] += 1
        # If its time has paced it, some of those before it may be unacknowledged all the same.
        publisher.left = publisher.left - 1 if hurried else publisher.depth / 2
        if publisher.left <= 0:
            # For all together: waiting for the subscribers of one topic takes as long. All of the
            # depth is used the next time: Fast DDS then asks for acknowledgement immediately,
            # and otherwise at every heartbeat.
            self._make_room()

    def renew(self) -> None:
        """Use the whole depth again where subscribers have all messages by now, without a wait."""
        for publisher in self.values():
            if publisher.left < publisher.depth / 2 and publisher.acknowledged():
                publisher.left = publisher.depth

    def _make_room(self) -> None:
        # Where one had ended, those that are left have not been awaited.
        late = {name for name, each in self.items() if each.late and not each.ended}
        lacking = self.deliver(self._longest, late)
        for name, publisher in self.items():
            publisher.late, publisher.ended = name in lacking, lacking.get(name, False)

    def deliver(self, longest: float, late: Collection[str] = ()) -> dict[str, bool]:
        """Wait until reliable subscribers that run have all messages, at most ``longest`` [s].

        Topics of ``late`` are not awaited. Return those where a subscriber lacks some, and whether
        the wait was shorter because one has ended: the middleware may forget it the next moment.
        """
        deadline = time.monotonic() + longest
        while lacking := self.wait(min(_SHORT_WAIT, longest)):
            awaited = [name for name in lacking if name not in late]
            if all(map(self.lost, awaited)):
                return {name: name in awaited for name in lacking}
            if time.monotonic() >= deadline:
                return {name: name in awaited and self.lost(name) for name in lacking}
        return {}

    def wait(self, seconds: float) -> list[str]:
        """Wait until reliable subscribers have all messages; return topics where some lack."""
        deadline = time.monotonic() + seconds
        lacking = []
        for name, publisher in self.items():
            publisher.left = publisher.depth
            if not publisher.acknowledged(max(0.0, deadline - time.monotonic())):
                lacking.append(name)
        return lacking


def taken(subscription: Subscription, most: int = _MOST_AT_ONCE) -> Iterator[tuple[Any, Any]]:
    """Yield the messages that have arrived, with their information; faster than an executor."""
    handle = subscription.handle
    with handle:
        for _ in range(most):
            found = handle.take_message(subscription.msg_type, subscription.raw)
            if found is None:
                return
            yield found


def request_for(offers: Sequence[QoSProfile], depth: int) -> QoSProfile:
    """Return the strongest request that every offer satisfies; without one a reliable one."""
    reliable = all(offer.reliability == ReliabilityPolicy.RELIABLE for offer in offers)
    latched = bool(offers) and all(map(is_latched, offers))
    return QoSProfile(
        depth=depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def is_latched(profile: QoSProfile) -> bool:
    return bool(profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


class SequenceGaps:
    """Count of messages that never arrived, from the numbers that publishers give to messages.

    Messages do not name their publisher. With several, a number that continues no known
    sequence is a gap in the sequence just below it, or begins a sequence if there are more
    publishers.
    """

    def __init__(self, publisher_count: Callable[[], int]) -> None:
        self.missing = 0  # messages that never arrived
        self.from_first = False  # whether all publishers of new sequences began with number 1
        self._publisher_count = publisher_count
        self._last: list[int] = []  # number of each sequence, the most recent at the end

    def record(self, number: int | None) -> None:
        """Take the number of a message that came; None where the middleware gives none."""
        if number is None:
            return
        last = self._last
        if number - 1 in last:
            last.remove(number - 1)
        else:
            below = max((before for before in last if before < number), default=None)
            if below is None:
                self.missing += self.from_first * (number - 1)
            elif len(last) >= self._publisher_count():
                self.missing += number - below - 1
                last.remove(below)
        last.append(number)
        if len(last) > _SEQUENCES:
            del last[0]


def is_satisfied(request: QoSProfile, offers: Sequence[QoSProfile]) -> bool:
    """Return whether a request connects to every offer."""
    return all(
        qos_check_compatible(offer, request)[0] != QoSCompatibility.ERROR for offer in offers
    )
