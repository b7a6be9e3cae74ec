"""Node of the recorder: it subscribes to topics and receives their messages serialized."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

from rclpy.node import Node
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.bag import Message
from rpud_sim.bag.losses import Losses
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.network_guard import NetworkGuard
from rpud_sim.ros.record.recorded_topic import RecordedTopic
from rpud_sim.ros.record.standstill import Standstill
from rpud_sim.ros.record.topic_selection import TopicSelection
from rpud_sim.ros.record.topic_subscriber import TopicSubscriber
from rpud_sim.ros.types import UnknownTypeError

_BATCH_SIZE = (
    1000  # messages of one topic received at once, so that a fast one does not starve the rest
)

_log_time = attrgetter("log_time")


class Recorder(Node):
    """Receives serialized messages of topics for an intake. It spins in no executor.

    Subscriptions: the selected topics, as they appear, with the QoS that their publishers offer.

    Args:
        selection: of topics; its names are resolved in the namespace.

    Raises:
        NameValidationException: if the namespace or a topic has no valid name.
    """

    def __init__(self, intake: Intake, selection: TopicSelection, namespace: str) -> None:
        # rclpy itself would log a warning, and would not name an invalid topic.
        validate_namespace(f"/{namespace.lstrip('/')}")
        for topic in selection.topics:
            validate_topic_name(topic)
        super().__init__("recorder", namespace=namespace, start_parameter_services=False)
        self._intake = intake
        names = frozenset(self.resolve_topic_name(topic) for topic in selection.topics)
        self._selection = replace(selection, topics=names)
        self._subscriber = TopicSubscriber(self, self._drain)
        self._prefix = self.get_namespace().rstrip("/") + "/"
        self._recordings: dict[str, RecordedTopic] = {}
        self._batch: list[Message] = []
        self._end: int | None = None  # of the recording [ns since the epoch]
        self._standstill = Standstill()
        self.guard = NetworkGuard(self.get_logger())  # of what arrives over the network
        # topics, and further types of recorded ones, that are not recorded, with reasons
        self.skipped: dict[str, str] = {}
        self.missing: list[str] = []  # requested topics that never appeared, known after ``finish``
        self.taken = 0  # messages that were received

    @property
    def topic_count(self) -> int:
        """Number of subscribed topics."""
        return len(self._recordings)

    @property
    def complete(self) -> bool:
        """Whether every requested topic is subscribed or skipped."""
        known = self._recordings.keys() | self.skipped.keys()
        wanted = {name for name in self._selection.topics if self.wants(name)}
        return self._selection.closed and known.issuperset(wanted)

    @property
    def losses(self) -> dict[str, Losses]:
        refused = self._intake.refused
        return {name: item.losses(refused[name]) for name, item in self._recordings.items()}

    @property
    def renewals(self) -> dict[str, int]:
        return {name: item.renewals for name, item in self._recordings.items() if item.renewals}

    @property
    def further_types(self) -> list[str]:
        """Recorded topics that have other types as well, which are not recorded."""
        return sorted(name for name, item in self._recordings.items() if item.further_types)

    def wants(self, name: str) -> bool:
        return self._selection.wants(name, self._prefix)

    def wants_drill(self, name: str) -> bool:
        """Return whether a drill with a topic of this absolute name belongs to the recording."""
        return self.wants(name) or name.startswith(self._prefix)

    def discover(self) -> bool:
        """Subscribe to wanted topics that have appeared; return whether there were any.

        Topics whose publishers have changed are subscribed again where necessary.
        """
        known = len(self._recordings) + len(self.skipped)
        for name, types in self.get_topic_names_and_types():
            if not self.wants(name):
                continue
            if name not in self._recordings and name not in self.skipped:
                self._begin(name, types)
            if name in self._recordings:
                self._note_types(self._recordings[name], types)
        for recording in self._recordings.values():
            with self.guard(f"what is known of {recording.name}"):
                self._subscriber.follow(recording)
        self._renew_silent()
        return len(self._recordings) + len(self.skipped) > known

    def receive(self, until: int | None = None) -> bool:
        """Hand arrived messages to the intake; return whether there may be more.

        With ``until`` [ns since the epoch], a topic is done at the first message received later.
        """
        more = False
        began = time.time_ns()
        if pause := self._standstill.note():
            self.get_logger().warning(f"it stood still for {pause:.1f} s")
        for recording in self._recordings.values():
            with self.guard(f"a message of {recording.name}"):
                more |= self._receive(recording, until)
        # The bag has messages in the order of their reception. A message that came since the first
        # topic was emptied may be later than one that this topic has received by now.
        self._batch.sort(key=_log_time)
        ripe = bisect_right(self._batch, began, key=_log_time)
        self._hand_over(self._batch[:ripe])
        del self._batch[:ripe]
        return more

    def end(self) -> None:
        """End the recording now: what is published and received later is not taken.

        All topics end together: a status that counts an entry of the journal comes after it.
        """
        self._end = time.time_ns()

    def finish(self) -> None:
        """Hand over the last messages, declare silent topics, and list missing ones."""
        self._hand_over(self._batch)
        self._batch.clear()
        for recording in self._recordings.values():
            self._declare(recording, received=False)
        for name in sorted(self._selection.topics):
            if self.wants(name) and name not in self._recordings and name not in self.skipped:
                self.missing.append(name)
                self.skipped[name] = "it never appeared"

    def _hand_over(self, messages: Sequence[Message]) -> None:
        self.taken += len(messages)
        for message in messages:
            self._intake.put(message)

    def _begin(self, name: str, types: Sequence[str]) -> None:
        """Subscribe to a topic with the first of its types that is possible."""
        reasons = []
        for type_name in types:
            try:
                self._recordings[name] = self._subscriber.subscribe(name, type_name)
                return
            except (UnknownTypeError, RuntimeError) as error:  # RCLError
                reasons.append(str(error))
        self.skipped[name] = "; ".join(reasons) or "it has no type"
        self.get_logger().warning(f"not recorded: {name}: {self.skipped[name]}")

    def _note_types(self, recording: RecordedTopic, types: Sequence[str]) -> None:
        # The middleware has one type for a topic in one participant.
        for type_name in types:
            if type_name != recording.type and type_name not in recording.further_types:
                recording.further_types.add(type_name)
                name = f"{recording.name} [{type_name}]"
                self.skipped[name] = f"the topic is recorded as {recording.type}"
                self.get_logger().warning(f"not recorded: {name}: {self.skipped[name]}")

    def _renew_silent(self) -> None:
        """Renew subscriptions that are silent since a standstill.

        A publisher that dropped us in the meantime sends nothing more, yet seems connected here.
        """
        since = self._standstill.heard_since()
        if since is None:
            return
        for recording in self._recordings.values():
            if recording.endpoints and recording.received_at < since:
                recording.renewals += 1
                self._subscriber.renew(recording, "nothing arrived since the recorder stood still")

    def _drain(self, recording: RecordedTopic) -> None:
        while self._receive(recording, None):
            pass

    def _receive(self, recording: RecordedTopic, until: int | None) -> bool:
        subscription = recording.subscription
        handle = subscription.handle
        with handle:
            for _ in range(_BATCH_SIZE):
                taken = handle.take_message(subscription.msg_type, True)
                if taken is None:
                    return False
                data, info = taken
                if self._is_late(info):
                    if until is not None and info["received_timestamp"] > until:
                        return False
                    continue
                message = recording.accept(data, info, counts=not self._intake.paused)
                if message is None:
                    continue
                if not recording.declared:
                    self._declare(recording, received=True)
                self._batch.append(message)
                if until is not None and message.log_time > until:
                    return False
        return True

    def _is_late(self, info: dict[str, Any]) -> bool:
        if self._end is None:
            return False
        return min(info["source_timestamp"], info["received_timestamp"]) > self._end

    def _declare(self, recording: RecordedTopic, *, received: bool) -> None:
        if not recording.declared:
            recording.declared = True
            self._intake.declare(self._subscriber.declaration(recording, received=received))
