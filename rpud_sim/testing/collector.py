"""Collector of what arrives over DDS: from the nodes under test, and status of the drill."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import rclpy
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile
from rclpy.serialization import deserialize_message
from rpud_msgs.srv import GetDelivery
from sensor_msgs.msg import JointState

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.client import DrillClient
from rpud_sim.ros.client.topics import types_of_topic
from rpud_sim.ros.drill.commands import joints_to_feed
from rpud_sim.ros.endpoints import SequenceGaps, request_for
from rpud_sim.ros.graph import message_class, resolve_topic
from rpud_sim.ros.received import DEPTH, ReceivedTopic
from rpud_sim.ros.waiting import WaitSet
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, TOPICS

_STAMPED = ("std_msgs/Header", "builtin_interfaces/Time")  # types of a first field with a time
_STAMP = {0: struct.Struct(">iI"), 1: struct.Struct("<iI")}  # by the byte order of the payload
_STAMP_AT = 4  # bytes from the beginning of a payload
_LONGEST_WAIT = 0.05  # between looks at processes, whose end sends no signal [s]


class StoredTopic(ReceivedTopic):
    """Messages of a topic in order, decoded when they are asked for.

    ``numbered_alone`` reports whether one publisher numbers the messages, so that a gap is a loss.
    With ``changes`` a message that repeats the one before, but for its timing, is left out. A
    message without a stamp has the time of ``clock`` [ns].
    """

    def __init__(
        self,
        node: Node,
        name: str,
        kind: Any,
        qos: QoSProfile,
        clock: Callable[[], int],
        numbered_alone: bool = False,
        changes: bool = False,
    ) -> None:
        self.commands = 0  # that the drill counts, if this is a topic of commands
        self.frame_prefix = ""  # of the drill's joints
        self.numbered_alone = numbered_alone
        self._clock = clock
        self._changes = changes
        self.payloads: list[bytes] = []
        self.stamps: list[int] = []  # [ns]
        self._messages: list[Any] = []
        fields = tuple(kind.get_fields_and_field_types().values())
        self.stamped = bool(fields) and fields[0] in _STAMPED
        super().__init__(node, name, kind, self._store, qos)
        self.counts = numbered_alone
        self.gaps = SequenceGaps(lambda: 1)

    def __len__(self) -> int:
        return len(self.payloads)

    def _store(self, payload: bytes, publish_time: int, log_time: int) -> None:
        self.commands += self.kind is not JointState or self._commands_feed(payload)
        if not (self._changes and self.payloads[-1:] == [payload]):
            self.payloads.append(payload)
            self.stamps.append(self._stamp(payload))

    def messages(self) -> list[Any]:
        for payload in self.payloads[len(self._messages) :]:
            self._messages.append(deserialize_message(payload, self.kind))
        return list(self._messages)

    def latest(self) -> Any:
        """Return the latest message, None without one."""
        if not self.payloads:
            return None
        if len(self._messages) == len(self.payloads):
            return self._messages[-1]
        return deserialize_message(self.payloads[-1], self.kind)

    def forget(self, until: int) -> None:
        del self.payloads[:until], self.stamps[:until], self._messages[:until]
        self.commands = self.gaps.missing = 0

    def _stamp(self, payload: bytes) -> int:
        if not self.stamped:
            return self._clock()
        second, nanosecond = _STAMP[payload[1] & 1].unpack_from(payload, _STAMP_AT)
        stamp = int(second * SECOND + nanosecond)
        # Zero is a time of the drill, but no stamp of others.
        return stamp if stamp or self.numbered_alone else self._clock()

    def _commands_feed(self, payload: bytes) -> bool:
        """Return whether the drill counts a message to joints, which may command none of its."""
        try:
            message = deserialize_message(payload, JointState)
            return joints_to_feed(message, self.frame_prefix) is not None
        except Exception:  # it is rejected, which counts too
            return True


class Collector:
    """Node that keeps every message of the topics it has subscribed to.

    Taking messages by hand costs a tenth of what an executor costs, which would be most of a step.
    ``client`` shows what the drill has published; both have one participant of the middleware.
    """

    def __init__(self, client: DrillClient) -> None:
        self.time = 0  # of the drill, for messages without a stamp [ns]
        self.delivery = GetDelivery.Response()  # the drill's latest account
        self.published: Mapping[str, int] = {}  # messages of the drill, by relative topic
        self._client = client
        self._context = client.node.context
        self.node = rclpy.create_node(
            "drill_test",
            namespace=client.namespace,
            context=self._context,
            use_global_arguments=False,
            enable_rosout=False,
            start_parameter_services=False,
        )
        self.topics: dict[str, StoredTopic] = {}  # by absolute name
        self._absolute: dict[str, str] = {}  # names by what they were called
        self._waiting = WaitSet(self._context)
        self.subscribe("status", TOPICS["status"].type)
        for name, kind in ALL_COMMAND_TOPICS.items():
            self.subscribe(name, kind)
        self._always = set(self.topics)

    def resolve(self, name: str) -> str:
        """Return the absolute name of a topic; a relative one is of the drill's namespace."""
        if (known := self._absolute.get(name)) is None:
            known = self._absolute[name] = resolve_topic(self.node, name)
        return known

    def own(self, name: str) -> StoredTopic:
        return self.topics[self.resolve(name)]

    def subscribe(self, name: str, kind: str = "") -> StoredTopic | None:
        """Subscribe to a topic, and return it; None if it has no publisher and no type.

        The name is relative or absolute; without a type the publisher's is taken.
        """
        absolute = self.resolve(name)
        if absolute in self.topics:
            return self.topics[absolute]
        own = TOPICS.get(name)
        if not kind:
            types = types_of_topic(self.node, absolute)
            if not types:
                return None
            kind = types[0]
        offers = [each.qos_profile for each in self.node.get_publishers_info_by_topic(absolute)]
        qos = request_for(offers, DEPTH) if own is None else _qos_of(own.latched)
        topic = StoredTopic(
            self.node,
            absolute,
            message_class(kind),
            qos,
            lambda: self.time,
            numbered_alone=own is not None,
            changes=name == "status",
        )
        self.topics[absolute] = topic
        return topic

    @property
    def hears_others(self) -> bool:
        """Whether it has subscribed to more than every test does."""
        return len(self.topics) > len(self._always)

    def ask(self, nodes: Sequence[str] = ()) -> GetDelivery.Response:
        """Ask the drill for its account; see ``DrillClient.delivery``."""
        found = self.delivery = self._client.delivery(nodes)
        self.published = dict(zip(found.topics, found.published, strict=True))
        return found

    def take(self) -> None:
        """Take what has arrived."""
        for topic in self.topics.values():
            topic.take()

    def until_complete(
        self,
        lack: Callable[[], str],
        seconds: float,
        check: Callable[[], object],
        period: float = _LONGEST_WAIT,
    ) -> str:
        """Take messages until nothing lacks; return what still does after some real time [s].

        ``lack`` returns it in words, or an empty text. It is called after each message and at least
        every ``period`` [s], and so often is ``check``, which may raise an error.
        """
        deadline = time.monotonic() + seconds
        self.take()
        while lacking := lack():
            check()
            remaining = deadline - time.monotonic()
            if remaining <= 0.0:
                return lacking
            self.wait(min(remaining, period))
            self.take()
        return ""

    def wait(self, seconds: float) -> None:
        """Wait until a message is there, at most for some seconds."""
        self._waiting.wait(seconds, [topic.subscription for topic in self.topics.values()])

    def missing(self) -> dict[str, int]:
        """Return how many messages of each topic the drill has published and are not here yet."""
        missing = {}
        for name, number in self.published.items():
            topic = self.topics.get(self.resolve(name))
            if topic is not None and (topic.number or 0) < number:
                missing[name] = number - (topic.number or 0)
        return missing

    def forget(self) -> None:
        """Forget everything before the reset that the drill has just done.

        Of latched topics the last message stays.
        """
        for topic in self.topics.values():
            topic.forget(len(topic) - 1 if topic.latched and len(topic) else len(topic))

    def forget_others(self) -> None:
        """Unsubscribe from all topics that not every test has."""
        for name in set(self.topics) - self._always:
            self.topics.pop(name).close()

    def close(self) -> None:
        self.node.destroy_node()


def _qos_of(latched: bool) -> QoSProfile:
    durability = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=DEPTH, durability=durability)
