"""Everything that was published on one topic since a test began, as it came over the wire."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from typing import Any

from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message

from rpud_sim.foundation.time import SECOND

_STAMPED = ("std_msgs/Header", "builtin_interfaces/Time")  # types of a first field with a time
_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}  # by the byte order of the payload
_STAMP_AT = 4  # bytes from the beginning of a payload
_TIMING = 24  # bytes at the end of a status: how fast the drill was, and how late


class HeardTopic:
    """Messages of a topic in order, decoded when they are asked for.

    ``numbered`` says whether one publisher alone numbers the messages, so that a gap is a loss.
    With ``changes`` a message that repeats the one before, but for its timing, is left out.
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: Any,
        qos: QoSProfile,
        numbered: bool = False,
        changes: bool = False,
    ) -> None:
        self.name = name
        self.kind = kind
        self.latched = qos.durability == DurabilityPolicy.TRANSIENT_LOCAL
        self.number: int | None = None  # of the latest message, by its publisher
        self.lost = 0
        self.arrived = 0  # messages since the test began, also those that are left out
        self._node = node
        self._numbered = numbered
        self._changes = changes
        self._payloads: list[bytes] = []
        self._stamps: list[int] = []
        self._messages: list[Any] = []
        fields = tuple(kind.get_fields_and_field_types().values())
        self.stamped = bool(fields) and fields[0] in _STAMPED
        self.subscription = node.create_subscription(kind, name, _ignore, qos, raw=True)

    def __len__(self) -> int:
        return len(self._payloads)

    @property
    def stamps(self) -> Sequence[int]:
        """Stamps of the messages [ns]; without one, the drill's time when they came."""
        return self._stamps

    @property
    def payloads(self) -> Sequence[bytes]:
        return self._payloads

    def take(self, time: int) -> bool:
        """Take what has arrived, unstamped at the time [ns]; return whether it was anything."""
        handle = self.subscription.handle
        before = self.arrived
        with handle:
            while taken := handle.take_message(self.kind, True):
                payload, info = taken
                self._count(info["publication_sequence_number"])
                if not self._repeats(payload):
                    self._payloads.append(payload)
                    self._stamps.append(self._stamp(payload, time))
        return self.arrived > before

    def messages(self) -> list[Any]:
        for payload in self._payloads[len(self._messages) :]:
            self._messages.append(deserialize_message(payload, self.kind))
        return list(self._messages)

    def latest(self) -> Any:
        """Return the latest message, None without one."""
        if not self._payloads:
            return None
        if len(self._messages) == len(self._payloads):
            return self._messages[-1]
        return deserialize_message(self._payloads[-1], self.kind)

    def forget(self, until: int) -> None:
        del self._payloads[:until], self._stamps[:until], self._messages[:until]
        self.arrived = len(self._payloads)
        self.lost = 0

    def close(self) -> None:
        """Unsubscribe."""
        self._node.destroy_subscription(self.subscription)

    def _count(self, number: int | None) -> None:
        self.arrived += 1
        if number is None:
            return
        if self._numbered and self.number is not None and number > self.number + 1:
            self.lost += number - self.number - 1
        self.number = number

    def _repeats(self, payload: bytes) -> bool:
        return (
            self._changes
            and bool(self._payloads)
            and self._payloads[-1][:-_TIMING] == payload[:-_TIMING]
        )

    def _stamp(self, payload: bytes, time: int) -> int:
        if not self.stamped:
            return time
        second, nanosecond = _STAMP[payload[1] & 1].unpack_from(payload, _STAMP_AT)
        stamp = int(second * SECOND + nanosecond)
        # Zero is a time of the drill, but no stamp of others.
        return stamp if stamp or self._numbered else time


def _ignore(payload: bytes) -> None:
    """Do nothing: messages are taken without an executor."""
