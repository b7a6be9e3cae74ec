"""Node of the recorder: its subscriptions to serialized topics, and its services."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from math import inf
from operator import attrgetter
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription
from rclpy.validate_namespace import validate_namespace
from rosgraph_msgs.msg import Clock
from std_srvs.srv import Trigger

try:
    from rpud_msgs.srv import IsPaused
except ImportError:  # other messages are recorded without ours
    IsPaused = None

from rpud_sim.bag import BagWriter, Message
from rpud_sim.bag.metadata import Losses
from rpud_sim.foundation.time import join_seconds
from rpud_sim.ros.endpoints import taken
from rpud_sim.ros.graph import (
    CLOCK,
    STATUS,
    UnknownTypeError,
    message_class,
    node_name,
    resolve_topic,
)
from rpud_sim.ros.options import RecordOptions
from rpud_sim.ros.received import DISCOVERY, ReceivedTopic, Sink
from rpud_sim.ros.record.declaration import declaration
from rpud_sim.ros.record.log_clock import LogClock, ReceptionTime
from rpud_sim.ros.record.writing import WriteQueue

# Messages that may wait in the middleware for the recorder: ten seconds of a 1 kHz topic.
_DEPTH = 10_000
_BATCH_SIZE = 1000  # messages of one topic in one step, so that a fast one does not starve the rest
_LOG_PERIOD = 10.0  # between two lines about data that cannot be used [s]

_UNDECIDED = 0.2  # after the first message, in which a drill is found [s]
_PATIENCE = 30.0  # with a drill, while only nodes come and go [s]
_OF_EVERY_NODE = {"/rosout", "/parameter_events"}
_TICKS = QoSProfile(depth=1000, reliability=ReliabilityPolicy.BEST_EFFORT)
_STANDSTILL = 2.0  # between two calls, after which publishers may have dropped the recorder [s]
_SILENCE = 3.0  # after it, in which a connected publisher should send something [s]
_BACKLOG = 1.0  # of these, in which messages from before still arrive and prove nothing [s]

_log_time = attrgetter("log_time")

# Services: std_srvs/Trigger, but for rpud_msgs/IsPaused.
_ACTIONS: dict[str, Callable[[WriteQueue], None]] = {
    "pause": WriteQueue.pause,
    "resume": lambda intake: intake.pause(False),
    "is_paused": lambda intake: None,
    "toggle_paused": lambda intake: intake.pause(not intake.paused),
    "split_bagfile": lambda intake: intake.do(BagWriter.split),
}
_TEXTS = {"split_bagfile": "continues in a new file"}


class Recorder(Node):
    """Receives serialized messages of the topics that the options select, for an intake."""

    def __init__(self, intake: WriteQueue, options: RecordOptions) -> None:
        # rclpy itself would log a warning.
        validate_namespace(f"/{options.namespace.lstrip('/')}")
        super().__init__("recorder", namespace=options.namespace, start_parameter_services=False)
        self.intake = intake
        self._options = options
        self._named: frozenset[str] = frozenset(
            resolve_topic(self, topic) for topic in options.topics
        )
        self._prefix = self.get_namespace().rstrip("/") + "/"
        self.topics: dict[str, ReceivedTopic] = {}  # that are subscribed
        self.further_types: dict[str, set[str]] = {}  # of these, which are not recorded
        # When all that was there before is known, by the monotonic clock [s].
        self._settled_at = time.monotonic() + DISCOVERY
        self._graph: object = None  # topics with their types, at the last look
        self._declared: set[str] = set()  # topics that the bag has
        self._received: dict[str, int] = {}  # log time of the last message of each topic [ns]
        # topics, and further types of recorded ones, that are not recorded, with reasons
        self.skipped: dict[str, str] = {}
        self.taken = 0  # messages that were received
        self.suppressed = 0  # errors that data from the network raised
        self.clock = LogClock()
        self.reception = ReceptionTime()
        if options.use_sim_time:
            self.clock.use_simulation()
        self._ticks: Subscription | None = self.create_subscription(
            Clock, CLOCK, lambda _: None, _TICKS, raw=True
        )
        self._warned = False  # of a clock that came too late
        self._decide_at = inf  # when no clock is waited for any more, by the monotonic clock [s]
        self._batch: list[Message] = []
        self._end = inf  # of the recording [ns since the epoch]
        # By the monotonic clock [s]: the last call, and the end of the latest standstill.
        self._called_at = self._stood_still = inf
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
        queue = self.intake.refused
        return {
            name: Losses(each.lost if each.numbered else None, queue[name], each.damaged)
            for name, each in self.topics.items()
        }

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
        # Tokens that begin with an underscore are hidden, as in topics of actions and services; not
        # tokens of the namespace, which somebody has named.
        if "/_" in f"/{name.removeprefix(self._prefix)}":
            return False
        if options.everything:
            return True
        if options.regex is not None:
            return options.regex.search(name) is not None
        return not self._named and name.startswith(self._prefix)

    def wants_drill(self, name: str) -> bool:
        """Return whether a drill with a topic of this absolute name belongs to the recording."""
        return self.wants(name) or name.startswith(self._prefix)

    @property
    def graph_changed(self) -> bool:
        """Whether topics have come or gone since the last look."""
        before, self._graph = self._graph, self.get_topic_names_and_types()
        return before != self._graph

    def discover(self) -> bool:
        """Subscribe to wanted topics that have appeared or changed; return whether some are new."""
        self._note_standstill()
        known = len(self.topics) + len(self.skipped)
        for name, types in self.get_topic_names_and_types():
            if self.wants(name) and name not in self.skipped:
                self._subscribe(name, types)
        for topic in self.topics.values():
            with self.guard(f"what is known of {topic.name}"):
                if reason := topic.follow():
                    self._renew(topic, reason)
        self._choose_clock()
        if time.monotonic() >= self._stood_still + _SILENCE:
            # A publisher that dropped us meanwhile sends nothing more, yet seems connected here.
            for topic in self.topics.values():
                if topic.endpoints and topic.received_at < self._stood_still + _BACKLOG:
                    topic.renewals += 1
                    self._renew(topic, "nothing arrived since the recorder stalled")
            self._stood_still = inf
        return len(self.topics) + len(self.skipped) > known

    def receive(self) -> float:
        """Hand messages to the intake; return the time up to which it has all [ns], or inf."""
        self._note_standstill()
        began, done = self.reception.now(), inf
        for data, info in taken(self._ticks) if self._ticks is not None else ():
            with self.guard(f"a message of {CLOCK}"):
                tick = deserialize_message(data, Clock).clock
                came, _ = self.reception.of(info["received_timestamp"], 0, 0)
                self.clock.add(came, join_seconds(tick.sec, tick.nanosec))
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
        until = self.reception.now()
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

    def _choose_clock(self) -> None:
        """Take the clock of a drill that is the source of ``/clock``, else the machine's."""
        if self.clock.simulated or self._warned:
            return
        drills = {
            node_name(each)
            for topic, types in self.get_topic_names_and_types()
            if STATUS in types and self.wants_drill(topic)
            for each in self.get_publishers_info_by_topic(topic)
        }
        sources = {node_name(each) for each in self.get_publishers_info_by_topic(CLOCK)}
        found = sorted(filter(None, drills & sources))
        if self.clock.decided:
            if found:
                self._warned = True
                self.get_logger().warning(
                    f"log times stay in this machine's time, as {found[0]}, which publishes "
                    f"{CLOCK}, came after the first messages: --use-sim-time waits for it"
                )
        elif found:
            self.clock.use_simulation()
            self.get_logger().info(f"log times come from {CLOCK}, which {found[0]} publishes")
        elif self.taken:
            now = time.monotonic()
            self._decide_at = min(self._decide_at, now + _PATIENCE)
            if self._received.keys() - _OF_EVERY_NODE:
                self._decide_at = min(self._decide_at, now + _UNDECIDED)
            if now >= self._decide_at:
                self.clock.use_machine()
                if self._ticks is not None:
                    self.destroy_subscription(self._ticks)
                self._ticks = None

    def _note_standstill(self) -> None:
        now, before = time.monotonic(), self._called_at
        self._called_at = now
        if now - before >= _STANDSTILL:
            self._stood_still = now

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
                kind, new = message_class(type_name), time.monotonic() >= self._settled_at
                self.topics[name] = ReceivedTopic(
                    self, name, kind, self._sink(name), depth=_DEPTH, new=new
                )
                self.get_logger().info(f"subscribed {name} [{type_name}]")
                break
            except (UnknownTypeError, RuntimeError) as error:  # RCLError
                reasons.append(str(error))
        topic = self.topics.get(name)
        if topic is None:
            self._skip(name, "; ".join(reasons) or "it has no type")
            return
        # The middleware has one type for a topic in one participant.
        known = self.further_types.setdefault(name, {topic.type})
        for type_name in types:
            if type_name not in known:
                known.add(type_name)
                self._skip(f"{name} [{type_name}]", f"the topic is recorded as {topic.type}")

    def _skip(self, name: str, reason: str) -> None:
        self.skipped[name] = reason
        self.get_logger().warning(f"not recorded: {name}: {reason}")

    def _renew(self, topic: ReceivedTopic, reason: str) -> None:
        while self._receive(topic) < inf:
            pass
        topic.renew()
        self.get_logger().warning(f"subscribed {topic.name} again, as {reason}")

    def _receive(self, topic: ReceivedTopic) -> float:
        """Take some messages; return the time of reception of the last, inf if none is left."""
        room = _BATCH_SIZE
        topic.counts = not self.intake.paused
        for data, info in taken(topic.subscription, room):
            room -= 1
            if min(info["source_timestamp"], info["received_timestamp"]) <= self._end:
                topic.receive(data, info)
        return inf if room else self._received.get(topic.name, inf)

    def _sink(self, name: str) -> Sink:
        def add(data: bytes, publish_time: int, log_time: int) -> None:
            self._declare(self.topics[name], received=True)
            latest = self._received.get(name, 0)
            log_time, publish_time = self.reception.of(log_time, publish_time, latest)
            self._received[name] = log_time
            self._batch.append(Message(name, log_time, publish_time, data))

        return add

    def _declare(self, topic: ReceivedTopic, *, received: bool) -> None:
        if topic.name not in self._declared:
            self._declared.add(topic.name)
            self.intake.declare(*declaration(topic, received=received))
