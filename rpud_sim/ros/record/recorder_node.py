"""Node of the recorder: its subscriptions to serialized topics, and its services."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from enum import Enum
from math import inf
from operator import attrgetter
from typing import Any

from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name
from std_srvs.srv import Trigger

try:
    from rpud_msgs.srv import IsPaused
except ImportError:  # other messages are recorded without ours
    IsPaused = None

from rpud_sim.bag import BagError, BagWriter, Message, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.metadata import Losses
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.ros.endpoints import FollowedTopic, taken
from rpud_sim.ros.graph import UnknownTypeError, message_class
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.record.writing import Intake

# Messages that may wait in the middleware for the recorder: ten seconds of a 1 kHz topic.
RECORDING_DEPTH = 10_000

_ENCAPSULATION = 4  # bytes before the fields of every message (CDR)
_MATCHING = 3.0  # s in which a publisher that was found should be connected
_DISCOVERY = 3.5  # s in which every publisher is found; the middleware announces itself every 3 s
_LATEST = 2**63 - 1  # in a bag [ns since the epoch]
_AWAY = 86_400_000_000_000  # that our clock may be set while a message waits [ns]
_BATCH_SIZE = 1000  # messages of one topic at once, so that a fast one does not starve the rest
_LOG_PERIOD = 10.0  # between two lines about data that cannot be used [s]

_STANDSTILL = 2.0  # between two calls, after which publishers may have dropped the recorder [s]
_SILENCE = 3.0  # after it, in which a connected publisher should send something [s]
_BACKLOG = 1.0  # of these, in which messages from before still arrive and prove nothing [s]

_log_time = attrgetter("log_time")

# Services: std_srvs/Trigger, but for rpud_msgs/IsPaused.
_ACTIONS: dict[str, Callable[[Intake], None]] = {
    "pause": Intake.pause,
    "resume": lambda intake: intake.pause(False),
    "is_paused": lambda intake: None,
    "toggle_paused": lambda intake: intake.pause(not intake.paused),
    "split_bagfile": lambda intake: intake.do(BagWriter.split),
}
_TEXTS = {"split_bagfile": "goes on in a new file"}


class RecordedTopic(FollowedTopic):
    """Topic of one type, with counts of its received, lost and damaged messages."""

    def __init__(self, node: Node, name: str, type_name: str) -> None:
        self.type = type_name
        super().__init__(node, name, message_class(type_name), RECORDING_DEPTH)
        self.declared = False  # whether the bag has its declaration
        self.further_types: set[str] = set()  # of the topic, which are not recorded
        self.damaged = 0  # messages that were damaged
        self.renewals = 0  # subscriptions that were renewed as a publisher was silent
        self._numbered = True  # whether the middleware numbers messages
        self._uncounted = 0  # damaged messages whose numbers are a gap in the next ones
        self._latest: dict[tuple[int, int | None, int], None] = {}
        # By the monotonic clock [s]: when every publisher that was there is known, and when as many
        # as are known should be connected.
        self._settled_at = time.monotonic() + _DISCOVERY
        self._matched_by = inf

    def losses(self, refused: int) -> Losses:
        """Return the losses; ``refused`` are messages that did not fit into the queue."""
        return Losses(self.gaps.missing if self._numbered else None, refused, self.damaged)

    def follow(self) -> str:
        """Look at the publishers; return why to subscribe again because of them, or ""."""
        now = time.monotonic()
        if self._has_another_offer():
            return "its publishers offer something else"
        if not self.endpoints:
            # Those that come from now on are new: their first messages, before they know the
            # subscription, are lost.
            if now >= self._settled_at and not self.latched:
                self.gaps.from_first = True
        elif self.subscription.handle.get_publisher_count() >= len(self._offers):
            self._matched_by = inf
        elif now >= self._matched_by:
            self.renewals += 1
            return "a publisher that is there was not connected"
        elif self._matched_by == inf:
            self._matched_by = now + _MATCHING * 2 ** min(self.renewals, 5)
        return ""

    def renew(self) -> None:
        super().renew()
        self._matched_by = inf

    def declaration(self, *, received: bool) -> tuple[Topic, str | None]:
        """Return the topic and its definition for the bag; ``received`` if it has had a message."""
        endpoints = self._publishers() or self.endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if received and not offers:
            # Its publisher is gone already; it offered at least what was requested.
            offers = [self.request]
        hashes = [str(endpoint.topic_type_hash) for endpoint in endpoints]
        topic = Topic(
            name=self.name,
            type=self.type,
            type_hash=hashes[0] if hashes else self._find(find_type_hash) or "",
            offered_qos=tuple(map(recorded_profile, offers)),
        )
        return topic, self._find(find_definition)

    def accept(self, data: bytes, info: dict[str, Any], *, counts: bool) -> Message | None:
        """Return the message, None if damaged or repeated; ``counts`` makes a gap a loss."""
        log_time = info["received_timestamp"] or time.time_ns()
        publish_time, number = info["source_timestamp"], info["publication_sequence_number"]
        if is_damaged(data, log_time, publish_time):
            self.damaged += 1
            self._uncounted += 1
            return None
        if self.latched:
            key = publish_time, number, hash(data)  # publishers may have no clock
            if key in self._latest:
                return None
            self._latest[key] = None
            if len(self._latest) > RECORDING_DEPTH:
                del self._latest[next(iter(self._latest))]
        self.received_at = time.monotonic()
        self._numbered = self._numbered and number is not None
        before = self.gaps.missing
        self.gaps.record(number)
        if not counts:
            self.gaps.missing = before
        elif found := self.gaps.missing - before:
            self.gaps.missing -= min(found, self._uncounted)
            self._uncounted = 0
        return Message(self.name, log_time, publish_time, data)

    def _publishers(self) -> list[TopicEndpointInfo]:
        return [each for each in super()._publishers() if each.topic_type == self.type]

    def _find(self, find: Callable[[str], str]) -> str | None:
        try:
            return find(self.type)
        except BagError as error:
            self._node.get_logger().warning(f"{error}; the bag lacks it")
            return None


def is_damaged(data: bytes, log_time: int, publish_time: int) -> bool:
    """Return whether these cannot be a message and its times [ns since the epoch].

    Shared memory that a killed process has left behind gives such messages.
    """
    received_about_now = abs(log_time - time.time_ns()) <= _AWAY
    return len(data) < _ENCAPSULATION or not (received_about_now and 0 <= publish_time <= _LATEST)


def recorded_profile(profile: QoSProfile) -> RecordedProfile:
    """Return a QoS as a bag holds it: names of policies, durations in ns."""
    values = {field.name: getattr(profile, field.name) for field in fields(RecordedProfile)}
    for name, value in values.items():
        if isinstance(value, Enum):
            values[name] = value.name.lower()
        elif isinstance(value, Duration):
            values[name] = value.nanoseconds
    return RecordedProfile(**values)


class Recorder(Node):
    """Receives serialized messages of the topics that the options select, for an intake."""

    def __init__(self, intake: Intake, options: RecordOptions) -> None:
        # rclpy itself would log a warning, and would not name an invalid topic.
        validate_namespace(f"/{options.namespace.lstrip('/')}")
        for topic in options.topics:
            validate_topic_name(topic)
        super().__init__("recorder", namespace=options.namespace, start_parameter_services=False)
        self.intake = intake
        self._options = options
        self._named: frozenset[str] = frozenset(map(self.resolve_topic_name, options.topics))
        self._prefix = self.get_namespace().rstrip("/") + "/"
        self.topics: dict[str, RecordedTopic] = {}  # that are subscribed
        # topics, and further types of recorded ones, that are not recorded, with reasons
        self.skipped: dict[str, str] = {}
        self.taken = 0  # messages that were received
        self.suppressed = 0  # errors that data from the network raised
        self._batch: list[Message] = []
        self._end = inf  # of the recording [ns since the epoch]
        # By the monotonic clock [s]: the last reception, and the end of the latest standstill.
        self._received_at, self._stood_still = inf, inf
        # ``serve`` takes the requests, so nothing ever calls the callback.
        self._servers: dict[str, Any] = {
            name: self.create_service(kind, f"~/{name}", lambda _, response: response)
            for name in _ACTIONS
            if (kind := IsPaused if name == "is_paused" else Trigger) is not None
        }

    @property
    def missing(self) -> list[str]:
        """Requested topics that have not appeared."""
        known = self.topics.keys() | self.skipped.keys()
        return sorted(name for name in self._named if self.wants(name) and name not in known)

    @property
    def complete(self) -> bool:
        """Whether every requested topic is subscribed or skipped; only names can be complete."""
        options = self._options
        closed = options.topics and options.regex is None and not options.everything
        return bool(closed) and not self.missing

    @property
    def losses(self) -> dict[str, Losses]:
        refused = self.intake.refused
        return {name: topic.losses(refused[name]) for name, topic in self.topics.items()}

    @contextmanager
    def guard(self, what: str) -> Iterator[None]:
        """Suppress, count and log errors that data from the network raises; the log names it."""
        try:
            yield
        except Exception as error:  # the data may make a library raise anything
            self.suppressed += 1
            reason = " ".join(f"{type(error).__name__}: {error}".split())
            self.get_logger().warning(
                f"{what} cannot be used: {reason:.200}", throttle_duration_sec=_LOG_PERIOD
            )

    def wants(self, name: str) -> bool:
        """Return whether to record a topic of this absolute name."""
        options = self._options
        if any(each.search(name) for each in options.exclude):
            return False
        if name in self._named:
            return True
        # Tokens that begin with an underscore are hidden, as those of actions and services are.
        if "/_" in name:
            return False
        if options.everything:
            return True
        if options.regex is not None:
            return options.regex.search(name) is not None
        return not self._named and name.startswith(self._prefix)

    def wants_drill(self, name: str) -> bool:
        """Return whether a drill with a topic of this absolute name belongs to the recording."""
        return self.wants(name) or name.startswith(self._prefix)

    def discover(self) -> bool:
        """Subscribe to wanted topics that have appeared or changed; return whether some are new."""
        known = len(self.topics) + len(self.skipped)
        for name, types in self.get_topic_names_and_types():
            if self.wants(name) and name not in self.skipped:
                self._subscribe(name, types)
        for topic in self.topics.values():
            with self.guard(f"what is known of {topic.name}"):
                if reason := topic.follow():
                    self._renew(topic, reason)
        if time.monotonic() >= self._stood_still + _SILENCE:
            # A publisher that dropped us meanwhile sends nothing more, yet seems connected here.
            for topic in self.topics.values():
                if topic.endpoints and topic.received_at < self._stood_still + _BACKLOG:
                    topic.renewals += 1
                    self._renew(topic, "nothing arrived since the recorder stood still")
            self._stood_still = inf
        return len(self.topics) + len(self.skipped) > known

    def receive(self) -> float:
        """Hand messages to the intake; return the time up to which it has all [ns], or inf."""
        now = time.monotonic()
        if now - self._received_at >= _STANDSTILL:
            self._stood_still = now
            self.get_logger().warning(f"it stood still for {now - self._received_at:.1f} s")
        self._received_at = now
        began, done = time.time_ns(), inf
        for topic in self.topics.values():
            with self.guard(f"a message of {topic.name}"):
                done = min(done, self._receive(topic))
        # The bag has messages in the order of their reception. A message that came since the first
        # topic was emptied may be later than one that this topic has received by now.
        self._batch.sort(key=_log_time)
        self._hand_over(bisect_right(self._batch, began, key=_log_time))
        return done

    def receive_all(self) -> None:
        """Hand the intake all that has arrived until now."""
        until = time.time_ns()
        while self.receive() <= until:
            pass

    def end(self) -> None:
        """End the recording of all topics now: what comes later is not taken."""
        self._end = time.time_ns()

    def finish(self) -> None:
        """Hand over the last messages, and declare silent topics."""
        self._hand_over(len(self._batch))
        for topic in self.topics.values():
            self._declare(topic, received=False)

    def serve(self) -> None:
        """Do what services were asked for, and answer."""
        for name, server in self._servers.items():
            with self.guard("a request"):
                with server.handle:
                    request, header = server.handle.service_take_request(server.srv_type.Request)
                if request is None or header is None:
                    continue
                self.receive_all()
                _ACTIONS[name](self.intake)
                paused = self.intake.paused
                if name == "is_paused":
                    server.send_response(IsPaused.Response(paused=paused), header)
                    continue
                text = _TEXTS.get(name, "paused" if paused else "resumed")
                self.get_logger().info(text)
                server.send_response(Trigger.Response(success=True, message=text), header)

    def _hand_over(self, count: int) -> None:
        self.taken += count
        for message in self._batch[:count]:
            self.intake.put(message)
        del self._batch[:count]

    def _subscribe(self, name: str, types: Sequence[str]) -> None:
        """Subscribe to a topic with the first of its types that is possible; name the others."""
        reasons = []
        for type_name in types if name not in self.topics else ():
            try:
                self.topics[name] = RecordedTopic(self, name, type_name)
                self.get_logger().info(f"subscribed {name} [{type_name}]")
                break
            except (UnknownTypeError, RuntimeError) as error:  # RCLError
                reasons.append(str(error))
        topic = self.topics.get(name)
        if topic is None:
            self._skip(name, "; ".join(reasons) or "it has no type")
            return
        # The middleware has one type for a topic in one participant.
        for type_name in types:
            if type_name != topic.type and type_name not in topic.further_types:
                topic.further_types.add(type_name)
                self._skip(f"{name} [{type_name}]", f"the topic is recorded as {topic.type}")

    def _skip(self, name: str, reason: str) -> None:
        self.skipped[name] = reason
        self.get_logger().warning(f"not recorded: {name}: {reason}")

    def _renew(self, topic: RecordedTopic, reason: str) -> None:
        while self._receive(topic) < inf:
            pass
        topic.renew()
        self.get_logger().warning(f"subscribed {topic.name} again, as {reason}")

    def _receive(self, topic: RecordedTopic) -> float:
        """Take some messages; return the time of reception of the last, inf if none is left."""
        room, received = _BATCH_SIZE, inf
        for data, info in taken(topic.subscription, room):
            room -= 1
            received = info["received_timestamp"]
            if min(info["source_timestamp"], received) > self._end:
                continue
            message = topic.accept(data, info, counts=not self.intake.paused)
            if message is not None:
                self._declare(topic, received=True)
                self._batch.append(message)
        return inf if room else received

    def _declare(self, topic: RecordedTopic, *, received: bool) -> None:
        if not topic.declared:
            topic.declared = True
            self.intake.declare(*topic.declaration(received=received))
