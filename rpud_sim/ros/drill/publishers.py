"""Publishers of the drill node: one for each topic, of messages as plain fields."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from rpud_sim.bag.encoder import Encoder
from rpud_sim.ros.drill.journal_store import JournalStore
from rpud_sim.ros.endpoints import Outlets
from rpud_sim.ros.graph import members_of, message_class
from rpud_sim.simulation.fields import time_fields
from rpud_sim.simulation.telemetry import Stream
from rpud_sim.simulation.topics import TOPICS, DrillTopic, Fields

Encoded = tuple[str, bytes]  # topic and serialized message

RESULTS = "command_results"
# Topics of a running drill alone, no part of a simulation.
OF_NODE = {
    "/diagnostics": DrillTopic("diagnostic_msgs/msg/DiagnosticArray", 10, complete=False),
    RESULTS: DrillTopic("rpud_msgs/msg/CommandResults", 100, latched=True, complete=False),
}
# A node that joins a drill at a standstill has the time at once.
CLOCK = DrillTopic("rosgraph_msgs/msg/Clock", 1, latched=True, frame="", complete=False)
# That a simulation which nothing paces waits for a subscriber that does not answer [s].
_LONGEST_WAIT = 1.0
_STATUS_WAIT = 0.5  # for those that lack the last status [s]


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    return Time(**time_fields(nanoseconds))


class DrillPublishers:
    """All publishers of the drill node; with ``publish_clock`` also of ``/clock``."""

    def __init__(
        self,
        node: Node,
        publish_clock: bool,
        offered: Mapping[str, DrillTopic] = TOPICS,
    ) -> None:
        self._node = node
        self.complete = False  # whether topics without a subscriber are published too
        self.dropped = 0  # messages that the middleware did not accept
        # whether to wait for reliable subscribers before overwriting messages they lack
        self.patient = False
        self._published = Counter[str]()
        self._deferred: deque[Stream] = deque()  # messages without a deadline, not published yet
        self._wanted = set[str]()  # topics that have had a subscriber
        self._awaits_status = True  # not for ever: a subscriber that was killed never acknowledges
        self.outlets = Outlets(_LONGEST_WAIT)  # of the topics that a simulation has
        self._others = Outlets(_LONGEST_WAIT)
        self.journal = JournalStore()
        self._encoders: dict[str, Encoder] = {}
        others = {**OF_NODE, **({"/clock": CLOCK} if publish_clock else {})}
        for outlets, topics in (self.outlets, offered), (self._others, others):
            for name, topic in topics.items():
                kind = message_class(topic.type)
                self._encoders[name] = Encoder(members_of(kind))
                publisher = node.create_publisher(kind, name, _qos_of(topic))
                outlet = outlets.add(name, publisher, topic.depth if topic.complete else math.inf)
                if name == "journal":
                    outlet.send = partial(self._send_entry, outlet.send)

    @property
    def published(self) -> Mapping[str, int]:
        """Messages of each topic of the node's namespace since its publisher exists.

        The middleware numbers messages alike: a subscriber can tell what it still lacks.
        """
        return {name: self._published[name] for name in self.outlets}

    def wanted(self, topic: str) -> bool:
        """Return whether to publish a topic: it has had a subscriber, or all are complete.

        A subscriber that stood still is dropped. The numbers of the messages tell it what it lost,
        so they are published meanwhile.
        """
        if topic not in self._wanted and self.outlets[topic].publisher.get_subscription_count():
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
        if "/clock" in self._encoders:
            self.publish([(stamp, "/clock", {"clock": time_fields(stamp)})])

    def destroy(self) -> None:
        for outlet in (*self.outlets.values(), *self._others.values()):
            self._node.destroy_publisher(outlet.publisher)

    def _publish_part(self) -> None:
        for entry in self._deferred[0]:
            if entry is not None:
                self.publish([entry])
            return
        self._deferred.popleft()

    def _send_entry(self, send: Callable[[bytes], object], entry: bytes) -> None:
        self.journal.add(entry)
        send(entry)

    def _send(self, name: str, message: bytes) -> None:
        try:
            if self.patient and name == "status":
                # Else the next one would overwrite it: in steps two commands follow each other at
                # once, and a test counts every status.
                wait = _STATUS_WAIT if self._awaits_status else 0.0
                self._awaits_status = self.outlets[name].acknowledged(wait)
            outlets = self.outlets if name in self.outlets else self._others
            outlets.send(name, message, hurried=self.patient)
            self._published[name] += 1
        except RuntimeError:  # RCLError: the middleware did not accept it
            self.dropped += 1


def _qos_of(topic: DrillTopic) -> QoSProfile:
    """Return the QoS that a topic is offered with; reliable serves best-effort subscribers too."""
    latched = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=topic.depth, durability=latched)
