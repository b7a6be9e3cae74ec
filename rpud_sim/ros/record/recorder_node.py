"""Node of the recorder: it receives messages of topics serialized, and has services."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from operator import attrgetter
from typing import Any

from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.bag import BagWriter, Message
from rpud_sim.bag.losses import Losses
from rpud_sim.ros.graph import UnknownTypeError, fill_known, rosbag_service
from rpud_sim.ros.record.record_options import RecordOptions
from rpud_sim.ros.record.recorded_topic import RecordedTopic
from rpud_sim.ros.record.writing import Intake

_BATCH_SIZE = 1000  # messages of one topic at once, so that a fast one does not starve the rest
_LOG_PERIOD = 10.0  # between two lines about data that cannot be used [s]

_STANDSTILL = 2.0  # between two calls, after which publishers may have dropped the recorder [s]
_SILENCE = 3.0  # after it, in which a connected publisher should send something [s]
_BACKLOG = 1.0  # of these, in which messages from before still arrive and prove nothing [s]

_log_time = attrgetter("log_time")

_ACTIONS: dict[str, Callable[[Intake], None]] = {
    "pause": Intake.pause,
    "resume": Intake.resume,
    "is_paused": lambda intake: None,
    "toggle_paused": lambda intake: intake.resume() if intake.paused else intake.pause(),
    "split_bagfile": lambda intake: intake.do(BagWriter.split),
}
_TEXTS = {"is_paused": "", "split_bagfile": "goes on in a new file"}


class Recorder(Node):
    """Receives serialized messages of topics for an intake. It spins in no executor.

    It subscribes to the topics that the options select as they appear, with the QoS that their
    publishers offer. A namespace or a topic without a valid name is a NameValidationException.
    """

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
        self._topics: dict[str, RecordedTopic] = {}
        self._batch: list[Message] = []
        self._end: int | None = None  # of the recording [ns since the epoch]
        # When it received last, and when its latest standstill ended, by the monotonic clock [s].
        self._received_at = float("inf")
        self._stood_still: float | None = None
        self._next_line = float("-inf")
        self.suppressed = 0  # errors that data from the network raised
        # topics, and further types of recorded ones, that are not recorded, with reasons
        self.skipped: dict[str, str] = {}
        self.missing: list[str] = []  # requested topics that never appeared, known after ``finish``
        self.taken = 0  # messages that were received

    @property
    def topic_count(self) -> int:
        """Number of subscribed topics."""
        return len(self._topics)

    @property
    def complete(self) -> bool:
        """Whether every requested topic is subscribed or skipped; only names can be complete."""
        options = self._options
        closed = options.topics and options.regex is None and not options.everything
        known = self._topics.keys() | self.skipped.keys()
        return bool(closed) and all(name in known for name in self._named if self.wants(name))

    @property
    def losses(self) -> dict[str, Losses]:
        refused = self.intake.refused
        return {name: topic.losses(refused[name]) for name, topic in self._topics.items()}

    @property
    def renewals(self) -> dict[str, int]:
        return {name: topic.renewals for name, topic in self._topics.items() if topic.renewals}

    @property
    def further_types(self) -> list[str]:
        """Recorded topics that have other types as well, which are not recorded."""
        return sorted(name for name, topic in self._topics.items() if topic.further_types)

    @contextmanager
    def guard(self, what: str) -> Iterator[None]:
        """Suppress, count and log errors that data from the network raises; the log names it."""
        try:
            yield
        except Exception as error:  # the data may make a library raise anything
            self.suppressed += 1
            if time.monotonic() >= self._next_line:
                self._next_line = time.monotonic() + _LOG_PERIOD
                reason = " ".join(f"{type(error).__name__}: {error}".split())
                self.get_logger().warning(f"{what} cannot be used: {reason:.200}")

    def wants(self, name: str) -> bool:
        """Return whether to record a topic of this absolute name."""
        options = self._options
        if options.exclude is not None and options.exclude.search(name):
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
        """Subscribe to wanted topics that have appeared; return whether there were any.

        Topics whose publishers have changed are subscribed again where necessary.
        """
        known = len(self._topics) + len(self.skipped)
        for name, types in self.get_topic_names_and_types():
            if not self.wants(name):
                continue
            if name not in self._topics and name not in self.skipped:
                self._begin(name, types)
            if name in self._topics:
                self._note_types(self._topics[name], types)
        for topic in self._topics.values():
            with self.guard(f"what is known of {topic.name}"):
                if reason := topic.follow():
                    self._renew(topic, reason)
        self._renew_silent()
        return len(self._topics) + len(self.skipped) > known

    def receive(self, until: int | None = None) -> bool:
        """Hand arrived messages to the intake; return whether there may be more.

        With ``until`` [ns since the epoch], a topic is done at the first message received later.
        """
        more = False
        began = time.time_ns()
        self._note_standstill()
        for topic in self._topics.values():
            with self.guard(f"a message of {topic.name}"):
                more |= self._receive(topic, until)
        # The bag has messages in the order of their reception. A message that came since the first
        # topic was emptied may be later than one that this topic has received by now.
        self._batch.sort(key=_log_time)
        ripe = bisect_right(self._batch, began, key=_log_time)
        self._hand_over(self._batch[:ripe])
        del self._batch[:ripe]
        return more

    def receive_all(self) -> None:
        """Hand the intake all that has arrived until now."""
        until = time.time_ns()
        while self.receive(until):
            pass

    def end(self) -> None:
        """End the recording now: what is published and received later is not taken.

        All topics end together: a status that counts an entry of the journal comes after it.
        """
        self._end = time.time_ns()

    def finish(self) -> None:
        """Hand over the last messages, declare silent topics, and list missing ones."""
        self._hand_over(self._batch)
        self._batch.clear()
        for topic in self._topics.values():
            self._declare(topic, received=False)
        for name in sorted(self._named):
            if self.wants(name) and name not in self._topics and name not in self.skipped:
                self.missing.append(name)
                self.skipped[name] = "it never appeared"

    def _hand_over(self, messages: Sequence[Message]) -> None:
        self.taken += len(messages)
        for message in messages:
            self.intake.put(message)

    def _begin(self, name: str, types: Sequence[str]) -> None:
        """Subscribe to a topic with the first of its types that is possible."""
        reasons = []
        for type_name in types:
            try:
                self._topics[name] = RecordedTopic(self, name, type_name)
                self.get_logger().info(f"subscribed {name} [{type_name}]")
                return
            except (UnknownTypeError, RuntimeError) as error:  # RCLError
                reasons.append(str(error))
        self._skip(name, "; ".join(reasons) or "it has no type")

    def _note_types(self, topic: RecordedTopic, types: Sequence[str]) -> None:
        # The middleware has one type for a topic in one participant.
        for type_name in types:
            if type_name != topic.type and type_name not in topic.further_types:
                topic.further_types.add(type_name)
                self._skip(f"{topic.name} [{type_name}]", f"the topic is recorded as {topic.type}")

    def _skip(self, name: str, reason: str) -> None:
        self.skipped[name] = reason
        self.get_logger().warning(f"not recorded: {name}: {reason}")

    def _note_standstill(self) -> None:
        """Note that it runs, and whether it was frozen before, or got no share of the machine."""
        now = time.monotonic()
        pause, self._received_at = now - self._received_at, now
        if pause >= _STANDSTILL:
            self._stood_still = now
            self.get_logger().warning(f"it stood still for {pause:.1f} s")

    def _renew_silent(self) -> None:
        """Renew subscriptions that are silent since a standstill.

        A publisher that dropped us in the meantime sends nothing more, yet seems connected here.
        """
        if self._stood_still is None or time.monotonic() < self._stood_still + _SILENCE:
            return
        since, self._stood_still = self._stood_still + _BACKLOG, None
        for topic in self._topics.values():
            if topic.endpoints and topic.received_at < since:
                topic.renewals += 1
                self._renew(topic, "nothing arrived since the recorder stood still")

    def _renew(self, topic: RecordedTopic, reason: str) -> None:
        while self._receive(topic, None):
            pass
        topic.renew()
        self.get_logger().warning(f"subscribed {topic.name} again, as {reason}")

    def _receive(self, topic: RecordedTopic, until: int | None) -> bool:
        handle = topic.subscription.handle
        with handle:
            for _ in range(_BATCH_SIZE):
                taken = handle.take_message(topic.message, True)
                if taken is None:
                    return False
                data, info = taken
                if self._is_late(info):
                    if until is not None and info["received_timestamp"] > until:
                        return False
                    continue
                message = topic.accept(data, info, counts=not self.intake.paused)
                if message is None:
                    continue
                self._declare(topic, received=True)
                self._batch.append(message)
                if until is not None and message.log_time > until:
                    return False
        return True

    def _is_late(self, info: dict[str, Any]) -> bool:
        if self._end is None:
            return False
        return min(info["source_timestamp"], info["received_timestamp"]) > self._end

    def _declare(self, topic: RecordedTopic, *, received: bool) -> None:
        if not topic.declared:
            topic.declared = True
            self.intake.declare(*topic.declaration(received=received))


class RecorderServices:
    """Services that pause, resume and split a recording.

    They are ``~/pause``, ``~/resume``, ``~/toggle_paused``, ``~/is_paused`` and
    ``~/split_bagfile``, of the types of rosbag2_interfaces, else std_srvs/Trigger and
    rpud_msgs/IsPaused. The node needs no executor: ``serve`` does waiting requests.
    """

    def __init__(self, node: Recorder) -> None:
        self._node = node
        # ``serve`` takes the requests, so nothing ever calls the callback.
        self._services = {
            name: node.create_service(kind, f"~/{name}", lambda _, response: response)
            for name in _ACTIONS
            if (kind := rosbag_service(name)) is not None
        }

    def serve(self) -> None:
        """Do what was asked for, and answer."""
        for name, server in self._services.items():
            with self._node.guard("a request"):
                self._serve(name, server)

    def _serve(self, name: str, server: Any) -> None:
        node, kind = self._node, server.srv_type
        with server.handle:
            request, header = server.handle.service_take_request(kind.Request)
        if request is None or header is None:
            return
        node.receive_all()
        _ACTIONS[name](node.intake)
        paused = node.intake.paused
        text = _TEXTS.get(name, "paused" if paused else "resumed")
        if text:
            node.get_logger().info(text)
        answers = {"success": True, "message": text, "paused": paused}
        server.send_response(fill_known(kind.Response(), answers), header)
