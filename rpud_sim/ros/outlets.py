"""Publishers of serialized messages, which can wait for their subscribers."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from rclpy.duration import Duration
from rclpy.publisher import Publisher


@dataclass
class Outlet:
    """Publisher of a topic, and how far it may run ahead of reliable subscribers."""

    publisher: Publisher
    send: Callable[[bytes], object]
    depth: float  # messages that it keeps; infinite where one may be overwritten
    room: float  # messages that may follow before a wait

    def acknowledged(self, seconds: float = 0.0) -> bool:
        """Wait until reliable subscribers have all messages; return whether they have."""
        return bool(self.publisher.wait_for_all_acked(Duration(seconds=seconds)))


class Outlets(dict[str, Outlet]):
    """Publishers by topic; messages in a hurry wait for reliable subscribers.

    The middleware overwrites the oldest message when the depth of a publisher is used up, whether
    subscribers have it or not. ``longest`` limits the wait for them [s].
    """

    def __init__(self, longest: float) -> None:
        super().__init__()
        self._longest = longest

    def add(self, name: str, publisher: Publisher, depth: float) -> Outlet:
        # Without the checks of rclpy: they take a fifth of the time of each message.
        send = publisher.handle.publish_raw
        self[name] = outlet = Outlet(publisher, send, depth, depth)
        return outlet

    @property
    def subscribers(self) -> dict[str, int]:
        """Numbers of subscriptions that the topics reach."""
        return {name: each.publisher.get_subscription_count() for name, each in self.items()}

    @property
    def unheard(self) -> list[str]:
        """Topics without a subscriber."""
        return [name for name, count in self.subscribers.items() if not count]

    def send(self, name: str, message: bytes, *, hurried: bool) -> None:
        """Publish a message; one that is ``hurried`` lets none be overwritten."""
        outlet = self[name]
        outlet.send(message)
        # If its time has paced it, some of those before it may be unacknowledged all the same.
        outlet.room = outlet.room - 1 if hurried else outlet.depth / 2
        if outlet.room <= 0:
            # For all at once: waiting for the subscribers of one topic takes as long. All of the
            # depth is used the next time: Fast DDS asks for acknowledgement at once where it is,
            # and otherwise at every heartbeat.
            self.wait(self._longest)

    def wait(self, seconds: float) -> list[str]:
        """Wait until reliable subscribers have all messages; return topics where some lack."""
        deadline = time.monotonic() + seconds
        lacking = []
        for name, outlet in self.items():
            outlet.room = outlet.depth
            if not outlet.acknowledged(max(0.0, deadline - time.monotonic())):
                lacking.append(name)
        return lacking
