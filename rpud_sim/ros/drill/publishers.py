"""Publishers of the drill node: one for each topic; and what it keeps of its journal."""

from __future__ import annotations

import math
import threading
import time
import zlib
from array import array
from collections import Counter, deque
from collections.abc import Callable, Iterable, Mapping
from functools import partial
from time import sleep

from builtin_interfaces.msg import Time
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from rpud_sim.messages.batch import Batch, rows_of
from rpud_sim.messages.encoder import Encoder
from rpud_sim.ros.drill.drawn_order import ShuffledOrder
from rpud_sim.ros.endpoints import LAST_WAIT, AcknowledgedPublishers
from rpud_sim.ros.graph import has_lost_subscriber, members_of, message_class
from rpud_sim.simulation.fields import time_fields
from rpud_sim.simulation.plan import STRATA_REACH
from rpud_sim.simulation.telemetry import Stream
from rpud_sim.simulation.topics import TOPICS, DrillTopic

# Simulation time at which it is published [ns], topic, and serialized message.
Encoded = tuple[int, str, bytes]

RESULTS = "command_results"
# Topics of a running drill only, no part of a simulation.
OF_NODE = {
    "/diagnostics": DrillTopic("diagnostic_msgs/msg/DiagnosticArray", 10, complete=False),
    RESULTS: DrillTopic("rpud_msgs/msg/CommandResults", 100, latched=True, complete=False),
}
# As robot_state_publisher offers it.
DESCRIPTION = DrillTopic("std_msgs/msg/String", 1, latched=True, frame="", complete=False)
# Latched, so that a node that joins a paused drill receives the time.
CLOCK = DrillTopic("rosgraph_msgs/msg/Clock", 1, latched=True, frame="", complete=False)
# That a simulation which nothing paces waits for a running subscriber that does not answer [s].
_LONGEST_WAIT = 10.0
_REPORT_WAIT = 0.5  # for those that lack the last report [s]
_REPORTS = ("power", "timing", "status")

MOST = 1_000_000 + STRATA_REACH  # entries that are kept at least, about 15 MB
_PAGE = 500  # entries that are compressed, and returned, together

Entries = list[tuple[int, bytes]]  # publishing times [ns since the epoch], and serialized entries


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    return Time(**time_fields(nanoseconds))


class DrillPublishers:
    """All publishers of the drill node; with ``publish_clock`` also of ``/clock``.

    ``description`` is the URDF for ``robot_description``; without one there is no such topic.
    """

    def __init__(
        self,
        node: Node,
        publish_clock: bool,
        offered: Mapping[str, DrillTopic] = TOPICS,
        description: str = "",
    ) -> None:
        self._node = node
        self.complete = False  # whether topics without a subscriber are published, too
        self.wanted = frozenset[str]()  # topics to publish
        self.followed = False  # whether some topics of the telemetry are among them
        self.sets_pace = False  # whether ``/clock`` has a subscriber
        self.dropped = 0  # messages that the middleware did not accept
        # whether to wait for reliable subscribers before overwriting messages they lack
        self.patient = False
        self._published = Counter[str]()
        self._deferred: deque[Stream] = deque()  # messages without a deadline, not published yet
        # Not for ever: a subscriber that was killed never acknowledges.
        self._awaited = dict.fromkeys(_REPORTS, True)
        # Of the topics that a simulation has, and of the others.
        lost = partial(has_lost_subscriber, node)
        self.own = AcknowledgedPublishers(_LONGEST_WAIT, lost)
        self._others = AcknowledgedPublishers(_LONGEST_WAIT, lost)
        self.journal = JournalStore()
        self._encoders: dict[str, Encoder] = {}
        self._telemetry = frozenset(name for name, topic in offered.items() if not topic.latched)
        self._latched = frozenset({*offered, *OF_NODE} - self._telemetry)
        others = {**OF_NODE, **({"/clock": CLOCK} if publish_clock else {})}
        if description:
            others["robot_description"] = DESCRIPTION
        for publishers, topics in (self.own, offered), (self._others, others):
            for name, topic in topics.items():
                kind = message_class(topic.type)
                self._encoders[name] = Encoder(members_of(kind))
                publisher = node.create_publisher(kind, name, _qos_of(topic))
                added = publishers.add(name, publisher, topic.depth if topic.complete else math.inf)
                if name == "journal":
                    added.send = partial(self._send_entry, added.send)
        self.begin()
        if description:
            encoded = self._encoders["robot_description"].encode({"data": description})
            self._send("robot_description", encoded)

    @property
    def published(self) -> Mapping[str, int]:
        """Messages of each topic since its publisher exists, as the middleware numbers them."""
        return {name: self._published[name] for name in self.own}

    @property
    def diagnosed(self) -> bool:
        """Whether anyone subscribes to the diagnostics."""
        return bool(self._others["/diagnostics"].publisher.get_subscription_count())

    def undelivered(self) -> dict[str, bool]:
        """Return lines about messages that a subscriber may lack, new since the last call.

        And whether all subscribers of that topic run.
        """
        lines = {}
        for (name, ended), count in sorted(self.own.overwritten.items()):
            reason = (
                "has ended or is stopped" if ended else f"did not take them in {_LONGEST_WAIT:g} s"
            )
            lines[f"up to {count} messages of {name} are lost: a subscriber {reason}"] = not ended
        self.own.overwritten.clear()
        return lines

    def deliver(self) -> list[str]:
        """Wait until running subscribers have all messages; return lines on what one may lack."""
        lacking = self.own.deliver(LAST_WAIT)
        return [
            f"the last messages of {name} may be lost: a subscriber did not take them in "
            f"{LAST_WAIT:g} s"
            for name, ended in sorted(lacking.items())
            if not ended
        ]

    def look(self) -> None:
        """Find the topics to publish: those that have had a subscriber since the run began.

        One that is dropped and comes back finds by the numbers what it has missed. A latched topic
        is published in any case: a later subscriber gets its last messages.
        """
        own = self.own
        for name in self._telemetry - self.wanted:
            if self.complete or own[name].publisher.get_subscription_count():
                self.wanted |= {name}
        self.followed = len(self.wanted) > len(self._latched)
        clock = self._others.get("/clock")
        self.sets_pace = clock is not None and bool(clock.publisher.get_subscription_count())

    def begin(self) -> None:
        """Begin with those topics that have a subscriber now."""
        self.wanted = self._latched
        self.look()

    def encode(self, batches: Iterable[Batch]) -> list[Encoded]:
        """Serialize messages, in their order, of topics that are wanted."""
        wanted = (batch for batch in batches if batch.topic in self.wanted)
        return [
            (time, topic, self._encoders[topic].encode(fields))
            for time, topic, fields in rows_of(wanted)
        ]

    def publish(self, batches: Iterable[Batch]) -> None:
        """Publish messages, serialized before: in quick succession they wake a subscriber once."""
        self.send(self.encode(batches))

    def send(self, messages: Iterable[Encoded]) -> None:
        for _, name, message in messages:
            self._send(name, message)

    def send_shuffled(
        self, messages: Iterable[Encoded], time: int, stamp: int, order: ShuffledOrder
    ) -> None:
        """Publish the messages up to a simulation time [ns] in a drawn order, with pauses.

        ``/clock`` with the stamp of this time [ns] is one of their topics.
        """
        clock = [(time, "/clock", encoded)] if (encoded := self._clock(stamp)) else []
        for pause, part in order.parts([*messages, *clock]):
            sleep(pause)
            self.send(part)

    def defer(self, stream: Stream) -> None:
        """Keep messages without a deadline for ``publish_deferred``."""
        self._deferred.append(stream)

    def publish_deferred(self, has_time: Callable[[], bool]) -> None:
        """Publish messages without a deadline, part by part while there is time.

        Without it the oldest of two streams continues by a part, and of three it is finished.
        """
        if len(self._deferred) > 1:
            self._publish_part()
        while self._deferred and (len(self._deferred) > 2 or has_time()):
            self._publish_part()

    def publish_clock(self, stamp: int) -> None:
        """Publish a time [ns] on ``/clock``, if the node is its source."""
        if encoded := self._clock(stamp):
            self._send("/clock", encoded)

    def destroy(self) -> None:
        for each in (*self.own.values(), *self._others.values()):
            self._node.destroy_publisher(each.publisher)

    def _clock(self, stamp: int) -> bytes:
        """Return a message of ``/clock``; empty if the node is not its source."""
        encoder = self._encoders.get("/clock")
        return encoder.encode({"clock": time_fields(stamp)}) if encoder else b""

    def _publish_part(self) -> None:
        for batch in self._deferred[0]:
            if batch is not None:
                self.publish([batch])
            return
        self._deferred.popleft()

    def _send_entry(self, send: Callable[[bytes], object], entry: bytes) -> None:
        self.journal.add(entry)
        send(entry)

    def _send(self, name: str, message: bytes) -> None:
        try:
            if self.patient and name in _REPORTS:
                # Else the next one would overwrite it: in steps two commands follow each other at
                # once, and a test counts every status.
                wait = _REPORT_WAIT if self._awaited[name] else 0.0
                self._awaited[name] = self.own[name].acknowledged(wait)
            publishers = self.own if name in self.own else self._others
            publishers.send(name, message, hurried=self.patient)
            self._published[name] += 1
        except RuntimeError:  # RCLError: the middleware did not accept it
            self.dropped += 1


def _qos_of(topic: DrillTopic) -> QoSProfile:
    """Return the QoS that a topic is offered with; reliable serves best-effort subscribers too."""
    latched = DurabilityPolicy.TRANSIENT_LOCAL if topic.latched else DurabilityPolicy.VOLATILE
    return QoSProfile(depth=topic.depth, durability=latched)


class JournalStore:
    """The newest entries of a journal as they were published, compressed in pages."""

    def __init__(self, most: int = MOST) -> None:
        self.count = 0  # entries so far
        self._lock = threading.Lock()
        self._pages: deque[bytes] = deque(maxlen=most // _PAGE)
        self._newest: Entries = []  # not compressed yet

    @property
    def first_kept(self) -> int:
        """Number of the first entry that is still kept; those before were dropped."""
        with self._lock:
            return self._first_kept()

    def add(self, entry: bytes) -> None:
        """Add a serialized entry that is published now."""
        with self._lock:
            self._newest.append((time.time_ns(), entry))
            self.count += 1
            if len(self._newest) == _PAGE:
                self._pages.append(_compressed(self._newest))
                self._newest = []

    def read(self, first: int) -> Entries:
        """Return some entries from a number on, or from the first kept one if that is greater."""
        with self._lock:
            place = max(0, first - self._first_kept())
            number, skipped = divmod(place, _PAGE)
            if number >= len(self._pages):
                return self._newest[place - len(self._pages) * _PAGE :]
            page = self._pages[number]
        return _entries(page)[skipped:]

    def _first_kept(self) -> int:
        return self.count - len(self._newest) - len(self._pages) * _PAGE


def _compressed(entries: Entries) -> bytes:
    times, data = zip(*entries, strict=True)
    lengths = array("q", map(len, data))
    return zlib.compress(b"".join((array("q", times), lengths, *data)), 1)


def _entries(page: bytes) -> Entries:
    content = zlib.decompress(page)
    numbers = array("q", content[: 16 * _PAGE])
    found, place = [], 16 * _PAGE
    for published, length in zip(numbers[:_PAGE], numbers[_PAGE:], strict=True):
        found.append((published, content[place : place + length]))
        place += length
    return found
