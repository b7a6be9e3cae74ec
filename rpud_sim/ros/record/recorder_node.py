"""The recorder's node: it subscribes to topics and takes their messages without decoding them."""

from __future__ import annotations

import time
from bisect import bisect_right
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSCompatibility, QoSProfile, qos_check_compatible
from rclpy.subscription import Subscription
from rclpy.topic_endpoint_info import TopicEndpointInfo
from rclpy.validate_namespace import validate_namespace
from rclpy.validate_topic_name import validate_topic_name

from rpud_sim.bag import BagError, Message, Topic
from rpud_sim.bag.definitions import find_definition, find_type_hash
from rpud_sim.bag.losses import Losses
from rpud_sim.bag.sequence import SequenceGaps
from rpud_sim.ros.qos import is_satisfied, recorded_profile, request_for
from rpud_sim.ros.record.intake import Intake
from rpud_sim.ros.record.message_queue import Declaration
from rpud_sim.ros.record.network_guard import NetworkGuard
from rpud_sim.ros.record.recorded_topic import RecordedTopic
from rpud_sim.ros.record.standstill import Standstill
from rpud_sim.ros.record.topic_selection import TopicSelection
from rpud_sim.ros.types import UnknownTypeError, message_class

_BATCH = 1000  # messages of one topic taken at once, so that a fast one does not starve the rest

_log_time = attrgetter("log_time")


class Recorder(Node):
    """Takes serialized messages of topics into a queue. It spins in no executor.

    Names in `selection` are resolved in `namespace`.
    Subscriptions: those topics, as they appear, with the QoS that their publishers offer, or that
    of `overrides` by absolute name. Publishers, services, parameters: none but those that every
    node has. Raises rclpy's NameValidationException.
    """

    def __init__(
        self,
        intake: Intake,
        selection: TopicSelection,
        namespace: str,
        overrides: Mapping[str, QoSProfile] | None = None,
    ) -> None:
        # The node itself would leave a warning behind, and a bad topic an error without its name.
        validate_namespace(f"/{namespace.lstrip('/')}")
        for topic in selection.topics:
            validate_topic_name(topic)
        super().__init__("recorder", namespace=namespace, start_parameter_services=False)
        self._intake = intake
        names = frozenset(self.resolve_topic_name(topic) for topic in selection.topics)
        self._selection = replace(selection, topics=names)
        self._overrides = dict(overrides or {})
        self._prefix = self.get_namespace().rstrip("/") + "/"
        self._recordings: dict[str, RecordedTopic] = {}
        self._batch: list[Message] = []
        self._standstill = Standstill()
        self.guard = NetworkGuard(self.get_logger())
        self.skipped: dict[str, str] = {}
        """What is not recorded, with the reasons: topics, and further types of recorded ones."""
        self.missing: list[str] = []
        """Topics that were named and never appeared, once it is finished."""
        self.taken = 0

    @property
    def topic_count(self) -> int:
        """Topics that are subscribed."""
        return len(self._recordings)

    @property
    def complete(self) -> bool:
        """Whether all topics that were named are subscribed or skipped."""
        known = self._recordings.keys() | self.skipped.keys()
        wanted = {name for name in self._selection.topics if self.wants(name)}
        return self._selection.closed and known.issuperset(wanted)

    @property
    def losses(self) -> dict[str, Losses]:
        """Lost messages of each topic."""
        return {
            name: Losses(
                recording.gaps.missing if recording.numbered else None,
                self._intake.refused[name],
                recording.damaged,
            )
            for name, recording in self._recordings.items()
        }

    @property
    def renewals(self) -> dict[str, int]:
        """How often topics were subscribed again, those where it was necessary."""
        return {
            name: recording.renewals
            for name, recording in self._recordings.items()
            if recording.renewals
        }

    @property
    def further_types(self) -> list[str]:
        """Recorded topics that have other types as well, which are not recorded."""
        return sorted(name for name, item in self._recordings.items() if item.further_types)

    def wants(self, name: str) -> bool:
        """Tell whether the topic with that absolute name is to be recorded."""
        return self._selection.wants(name, self._prefix)

    def wants_drill(self, name: str) -> bool:
        """Tell whether a drill with a topic of that absolute name belongs to the recording."""
        return self.wants(name) or name.startswith(self._prefix)

    def discover(self) -> bool:
        """Subscribe to wanted topics that have appeared; tell whether there were any.

        Topics whose publishers have changed are subscribed as these need it.
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
                self._follow(recording)
        self._renew_silent()
        return len(self._recordings) + len(self.skipped) > known

    def receive(self, until: int | None = None) -> bool:
        """Move what has arrived into the queue; tell whether there may be more.

        With `until` [ns since the epoch], a topic is done at the first message received later.
        """
        more = False
        began = time.time_ns()
        if pause := self._standstill.note():
            self.get_logger().warning(f"it stood still for {pause:.1f} s")
        for recording in self._recordings.values():
            with self.guard(f"a message of {recording.name}"):
                more |= self._receive(recording, until)
        # In the bag messages are in the order in which they were received. What came since the
        # first topic was emptied may be later than what that topic has received by now.
        self._batch.sort(key=_log_time)
        ripe = bisect_right(self._batch, began, key=_log_time)
        self._hand_over(self._batch[:ripe])
        del self._batch[:ripe]
        return more

    def finish(self) -> None:
        """Hand over the last messages, declare the topics that had none, and name what was not."""
        self._hand_over(self._batch)
        self._batch.clear()
        for recording in self._recordings.values():
            self._declare(recording, heard=False)
        for name in sorted(self._selection.topics):
            if self.wants(name) and name not in self._recordings and name not in self.skipped:
                self.missing.append(name)
                self.skipped[name] = "it never appeared"

    def _hand_over(self, messages: Sequence[Message]) -> None:
        self.taken += len(messages)
        for message in messages:
            self._intake.put(message)

    def _begin(self, name: str, types: Sequence[str]) -> None:
        """Record the first of a topic's types that can be."""
        reasons = []
        for type_name in types:
            try:
                self._record(name, type_name, message_class(type_name))
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

    def _offering(self, name: str, type_name: str) -> list[TopicEndpointInfo]:
        endpoints = self.get_publishers_info_by_topic(name)
        return [endpoint for endpoint in endpoints if endpoint.topic_type == type_name]

    def _record(self, name: str, type_name: str, message: Any) -> None:
        endpoints = self._offering(name, type_name)
        # Before the first publisher its subscribers show what it will have to offer.
        known = endpoints or self.get_subscriptions_info_by_topic(name)
        request = self._overrides.get(name)
        if request is None:
            request = request_for([endpoint.qos_profile for endpoint in known])
        self._recordings[name] = RecordedTopic(
            name=name,
            type=type_name,
            message=message,
            subscription=self._subscribe(name, message, request),
            request=request,
            gaps=SequenceGaps(lambda: self.count_publishers(name)),
            endpoints=endpoints,
        )
        self.get_logger().info(f"subscribed {name} [{type_name}]")

    def _subscribe(self, name: str, message: Any, request: QoSProfile) -> Subscription:
        # Messages are taken in batches by ``receive``, so nothing ever calls the callback: an executor
        # costs several times as much for each message as the message itself.
        return self.create_subscription(message, name, lambda _: None, request, raw=True)

    def _follow(self, recording: RecordedTopic) -> None:
        endpoints = self._offering(recording.name, recording.type)
        if not endpoints:
            return
        recording.endpoints = endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if recording.name in self._overrides:
            self._warn_of_override(recording, offers)
        elif not is_satisfied(recording.request, offers):
            recording.request = request_for(offers)
            self._renew(recording, "a publisher offers less than before")
            return
        if recording.misses(offers):
            recording.renewals += 1
            self._renew(recording, "a publisher that is there was not heard")

    def _renew_silent(self) -> None:
        """Subscribe again what is silent since a standstill.

        A publisher whose lease for us ran out sends nothing more, and here it is still connected.
        """
        since = self._standstill.heard_since()
        if since is None:
            return
        for recording in self._recordings.values():
            if recording.endpoints and recording.heard < since:
                recording.renewals += 1
                self._renew(recording, "nothing was heard since the recorder stood still")

    def _renew(self, recording: RecordedTopic, reason: str) -> None:
        while self._receive(recording, None):
            pass
        self.destroy_subscription(recording.subscription)
        recording.unmatched = None
        recording.subscription = self._subscribe(
            recording.name, recording.message, recording.request
        )
        self.get_logger().warning(f"subscribed {recording.name} again, as {reason}")

    def _warn_of_override(self, recording: RecordedTopic, offers: Sequence[QoSProfile]) -> None:
        for offer in offers:
            fits, reason = qos_check_compatible(offer, recording.request)
            if fits == QoSCompatibility.ERROR and not recording.unheard:
                recording.unheard = True
                self.get_logger().warning(
                    f"a publisher of {recording.name} is not heard with the QoS of the overrides: "
                    f"{reason.rstrip(';')}"
                )

    def _receive(self, recording: RecordedTopic, until: int | None) -> bool:
        subscription = recording.subscription
        handle = subscription.handle
        with handle:
            for _ in range(_BATCH):
                taken = handle.take_message(subscription.msg_type, True)
                if taken is None:
                    return False
                data, info = taken
                message = recording.accept(data, info, counts=not self._intake.paused)
                if message is None:
                    continue
                if not recording.declared:
                    self._declare(recording, heard=True)
                self._batch.append(message)
                if until is not None and message.log_time > until:
                    return False
        return True

    def _declare(self, recording: RecordedTopic, *, heard: bool) -> None:
        if recording.declared:
            return
        recording.declared = True
        endpoints = self._offering(recording.name, recording.type) or recording.endpoints
        offers = [endpoint.qos_profile for endpoint in endpoints]
        if heard and not offers:
            # Its publisher is gone already; it offered at least what was requested.
            offers = [recording.request]
        hashes = [str(endpoint.topic_type_hash) for endpoint in endpoints]
        topic = Topic(
            name=recording.name,
            type=recording.type,
            type_hash=hashes[0]
            if hashes
            else self._installed(find_type_hash, recording.type) or "",
            offered_qos=tuple(recorded_profile(offer) for offer in offers),
        )
        self._intake.declare(Declaration(topic, self._installed(find_definition, recording.type)))

    def _installed(self, find: Callable[[str], str], type_name: str) -> str | None:
        try:
            return find(type_name)
        except BagError as error:
            self.get_logger().warning(f"{error}; the bag lacks it")
            return None
