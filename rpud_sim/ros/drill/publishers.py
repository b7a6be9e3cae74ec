"""Publishers of the drill node: one for each topic, of messages as plain fields."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from typing import TypeVar

from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from rpud_sim.bag.encoder import Encoder
from rpud_sim.ros.graph import members_of, message_class
from rpud_sim.simulation.fields import time_fields
from rpud_sim.simulation.telemetry import Stream
from rpud_sim.simulation.topics import TOPICS, DrillTopic, Fields

Message = TypeVar("Message")
Encoded = tuple[str, bytes]  # topic and serialized message

RESULTS = "command_results"
# Topics of a running drill alone, no part of a simulation.
OF_NODE = {
    "/diagnostics": DrillTopic("diagnostic_msgs/msg/DiagnosticArray", 10, complete=False),
    RESULTS: DrillTopic("rpud_msgs/msg/CommandResults", 100, latched=True, complete=False),
}
# A node that joins a drill at a standstill has the time at once.
CLOCK = DrillTopic("rosgraph_msgs/msg/Clock", 1, latched=True, frame="", complete=False)
# A simulation that nothing paces waits for its subscribers when a depth is used up, but not longer
# than this for one that does not answer [s].
_LONGEST_WAIT = 1.0
_STATUS_WAIT = 0.5  # for those that lack the last status [s]


def filled(message: Message, values: Fields) -> Message:
    """Set the message's fields, and those of the messages in it, and return it."""
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    return filled(Time(), time_fields(nanoseconds))


class DrillPublishers:
    """All publishers of the drill node; with ``publish_clock`` also of ``/clock``."""

    def __init__(
        self,
        node: Node,
        publish_clock: bool,
        offered: Mapping[str, DrillTopic] = TOPICS,
    ) -> None:
        self._node = node
        self._offered = offered  # topics of the node's namespace
        self.complete = False  # whether topics without a subscriber are published too
        self.dropped = 0  # messages that the middleware did not accept
        # whether to wait for reliable subscribers before overwriting messages they lack
        self.patient = False
        self._unacknowledged = Counter[str]()
        self._published = Counter[str]()
        self._deferred: deque[Stream] = deque()  # messages without a deadline, not published yet
        self._wanted = set[str]()  # topics that have had a subscriber
        self._awaits_status = True  # not for ever: a subscriber that was killed never acknowledges
        self._topics = {**offered, **OF_NODE, **({"/clock": CLOCK} if publish_clock else {})}
        types = {name: message_class(topic.type) for name, topic in self._topics.items()}
        self._encoders = {name: Encoder(members_of(kind)) for name, kind in types.items()}
        self._publishers = {
            name: node.create_publisher(types[name], name, _qos_of(topic))
            for name, topic in self._topics.items()
        }
        # Without the checks of rclpy: they take a fifth of the time of each message.
        self._publish_raw = {
            name: publisher.handle.publish_raw for name, publisher in self._publishers.items()
        }

    @property
    def unheard(self) -> list[str]:
        """Topics of the node's namespace that have no subscriber."""
        return [name for name, count in self.subscribers().items() if not count]

    @property
    def published(self) -> Mapping[str, int]:
        """Messages of each topic of the node's namespace since its publisher exists.

        The middleware numbers messages alike: a subscriber can tell what it still lacks.
        """
        return {name: self._published[name] for name in self._offered}

    def subscribers(self) -> dict[str, int]:
        """Return the number of subscriptions that each topic of the node's namespace reaches."""
        return {name: self._publishers[name].get_subscription_count() for name in self._offered}

    def acknowledged(self) -> bool:
        """Return whether all reliable subscribers have every message of the namespace."""
        return all(self._acknowledged(name, 0.0) for name in self._offered)

    def wanted(self, topic: str) -> bool:
        """Return whether to publish a topic: it has had a subscriber, or all are complete.

        A subscriber that stood still is dropped. The numbers of the messages tell it what it lost,
        so they are published meanwhile.
        """
        if topic not in self._wanted and self._publishers[topic].get_subscription_count():
            self._wanted.add(topic)
        return self.complete or topic in self._wanted

    def encode(self, entries: Iterable[tuple[int, str, Fields]]) -> list[Encoded]:
        """Serialize messages: ``(time, topic, fields)`` as a run yields them."""
        return [(name, self._encoders[name].encode(values)) for _, name, values in entries]

    def publish(self, entries: Iterable[tuple[int, str, Fields]]) -> None:
        """Publish messages.

        All are serialized before the first one is sent: messages in quick succession find a
        subscriber awake, and waking one costs more than the rest of sending.
        """
        self.send(self.encode(entries))

    def send(self, messages: Iterable[Encoded]) -> None:
        for name, message in messages:
            self._send(name, message)

    def defer(self, stream: Stream) -> None:
        """Keep messages without a deadline for ``publish_deferred``."""
        self._deferred.append(stream)

    def publish_deferred(self, has_time: Callable[[], bool]) -> None:
        """Publish messages without a deadline, part by part while there is time.

        Without it a stream that has waited for a period of streams goes on by a part in each call,
        and one that has waited for two is finished: so their number is bounded.
        """
        if len(self._deferred) > 1:
            self._publish_part()
        while self._deferred and (len(self._deferred) > 2 or has_time()):
            self._publish_part()

    def publish_clock(self, stamp: int) -> None:
        """Publish a time [ns] on ``/clock``, if the node is its source."""
        if "/clock" in self._publishers:
            self.publish([(stamp, "/clock", {"clock": time_fields(stamp)})])

    def wait_for_subscribers(self, seconds: float = _LONGEST_WAIT) -> None:
        """Wait until reliable subscribers have everything, at most for this time in all [s]."""
        end = time.monotonic() + seconds
        for name in self._publishers:
            if not name.startswith("/"):
                self._acknowledged(name, max(0.0, end - time.monotonic()))

    def destroy(self) -> None:
        for publisher in self._publishers.values():
            self._node.destroy_publisher(publisher)
        self._publishers.clear()
        self._publish_raw.clear()

    def _acknowledged(self, name: str, seconds: float) -> bool:
        """Wait until reliable subscribers of a topic have everything; return whether they have."""
        return bool(self._publishers[name].wait_for_all_acked(Duration(seconds=seconds)))

    def _publish_part(self) -> None:
        for entry in self._deferred[0]:
            if entry is not None:
                self.publish([entry])
            return
        self._deferred.popleft()

    def _send(self, name: str, message: bytes) -> None:
        try:
            if self.patient and name == "status":
                # Else the next one would overwrite it: in steps two commands follow each other at
                # once, and a test counts every status.
                wait = _STATUS_WAIT if self._awaits_status else 0.0
                self._awaits_status = self._acknowledged(name, wait)
            self._publish_raw[name](message)
            self._unacknowledged[name] += 1
            self._published[name] += 1
            topic = self._topics[name]
            if self.patient and topic.complete and self._unacknowledged[name] >= topic.depth:
                # For all at once: waiting for the subscribers of one topic takes as long.
                self.wait_for_subscribers()
                self._unacknowledged.clear()
        except RuntimeError:  # RCLError: the middleware did not accept it
            self.dropped += 1


def _qos_of(topic: DrillTopic) -> QoSProfile:
    """Return the QoS that a topic is offered with; reliable serves best-effort subscribers too."""
    latched = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=topic.depth, durability=latched)
