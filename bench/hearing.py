"""An independent listener that counts what it hears on topics, message by message, as bytes."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message

from rpud_sim.foundation.time import join_seconds
from rpud_sim.ros.threads import DelayHistogram

_TAKE_PERIOD = 0.002  # [s]
_HEADER = 4  # bytes of the encapsulation, before the stamp of a header
_STAMP = struct.Struct("=iI")


class Hearing:
    """Counts messages and bytes, and keeps the last message of some topics.

    Messages are taken as bytes and in batches: an executor costs so much more for each that on a
    busy machine the listener would be what loses them.

    Args:
        node: to subscribe with.
        topics: the type of each.
        kept: topics whose last message is kept.
        stamped: topics with a header whose delays are counted, from the stamp to the arrival.
        depth: messages that may wait on each topic.
    """

    def __init__(
        self,
        node: Node,
        topics: Mapping[str, type],
        kept: Iterable[str] = (),
        stamped: Iterable[str] = (),
        depth: int = 5000,
    ) -> None:
        self.messages = dict.fromkeys(topics, 0)
        self.bytes = 0
        self.delays = {name: DelayHistogram() for name in stamped}
        self._kept: dict[str, bytes] = dict.fromkeys(kept, b"")
        self._kinds = dict(topics)
        self._subscriptions = {
            name: node.create_subscription(
                kind, name, lambda _: None, QoSProfile(depth=depth), raw=True
            )
            for name, kind in topics.items()
        }

    @property
    def count(self) -> int:
        """Messages heard so far."""
        return sum(self.messages.values())

    def last(self, topic: str) -> Any:
        """Return the last message of a topic that is kept, None before the first."""
        content = self._kept[topic]
        return deserialize_message(content, self._kinds[topic]) if content else None

    def take(self) -> None:
        """Hear what has come since the last call."""
        for name, subscription in self._subscriptions.items():
            handle, kind, count = subscription.handle, self._kinds[name], 0
            with handle:
                while (taken := handle.take_message(kind, True)) is not None:
                    count += 1
                    self.bytes += len(taken[0])
                    if name in self.delays:
                        stamp = join_seconds(*_STAMP.unpack_from(taken[0], _HEADER))
                        self.delays[name].add(taken[1]["received_timestamp"] - stamp)
                    if name in self._kept:
                        self._kept[name] = taken[0]
            self.messages[name] += count

    def take_until(self, condition: Callable[[], bool], seconds: float) -> bool:
        """Hear until a condition holds, but not longer than this; tell whether it does."""
        end = time.monotonic() + seconds
        while not (holds := condition()) and time.monotonic() < end:
            self.take()
            time.sleep(_TAKE_PERIOD)
        return holds
