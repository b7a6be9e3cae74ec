"""Node of the replayer: it publishes serialized messages as their recorded publishers did."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import inf
from typing import Any

from rclpy.duration import Duration
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rclpy.validate_full_topic_name import validate_full_topic_name
from rosgraph_msgs.msg import Clock

from rpud_sim.bag import BagError, BagFormatError, Message, TopicSummary
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import to_plain
from rpud_sim.bag.definitions import find_type_hash
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.time import split_seconds
from rpud_sim.ros.graph import UnknownTypeError, filled, message_class
from rpud_sim.ros.outlets import Outlets

CLOCK = "/clock"

# Messages of a replayed topic that may wait for acknowledgement; Fast DDS keeps no more.
REPLAY_DEPTH = 5_000
DEPTH_LIMIT = 2**31 - 1  # greatest depth that the middleware accepts
# Messages that a replayed latched topic keeps; discovery does not show how many it was.
LATCHED_DEPTH = 10
_LONGEST_WAIT = 5.0  # for subscribers of a fast replay [s]


class Replayer(Node):
    """Publishes messages of a bag.

    Publishers: the topics, with their types and their recorded QoS, and ``/clock`` if requested. A
    topic is skipped with a warning if its name is invalid in ROS, if its type is not installed or
    not the only one, or if it would share its name with a topic of another type.

    ``remappings`` are other names of topics, as ``OLD:=NEW``.
    """

    def __init__(
        self,
        topics: Iterable[TopicSummary],
        *,
        with_clock: bool,
        remappings: Iterable[str] = (),
    ) -> None:
        rules = [word for rule in remappings for word in ("--remap", rule)]
        super().__init__(
            "replayer",
            cli_args=["--ros-args", *rules] if rules else None,
            start_parameter_services=False,
        )
        self.failures = 0  # requests that raised an error
        self.outlets = Outlets(_LONGEST_WAIT)  # by the topic's name in the bag
        self._types: dict[str, str] = {}  # by the names that they are published with
        if with_clock:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock_publisher = self.create_publisher(Clock, CLOCK, qos)
        for summary in topics:
            name = summary.topic.name
            if with_clock and name == CLOCK:
                self.get_logger().warning(f"the bag's own {CLOCK} is left out for that of --clock")
                continue
            try:
                self._add(summary)
            except UnknownTypeError as error:
                self.get_logger().warning(printable(f"not replayed: {name}: {error}"))

    def _add(self, summary: TopicSummary) -> None:
        topic = summary.topic
        if len(summary.kinds) > 1:
            raise UnknownTypeError("it has several types or definitions")
        if topic.serialization_format != "cdr":
            raise UnknownTypeError(f"it is in {topic.serialization_format!r}")
        message = message_class(topic.type)
        try:
            name = self.resolve_topic_name(topic.name)
            validate_full_topic_name(name)
        except (NameValidationException, RuntimeError):  # RCLError
            raise UnknownTypeError("ROS has no such names") from None
        if (other := self._types.setdefault(name, topic.type)) != topic.type:
            raise UnknownTypeError(f"it is a {topic.type}, and {name} is a {other}")
        converted = conversion(summary, message)
        try:
            offer = replay_offer(topic.offered_qos)
            publisher = self.create_publisher(message, topic.name, offer)
        except (OverflowError, RuntimeError, TypeError, ValueError) as error:
            raise UnknownTypeError(f"its QoS cannot be offered: {error}") from error
        # A latched topic keeps only its last messages.
        latched = offer.durability == DurabilityPolicy.TRANSIENT_LOCAL
        outlet = self.outlets.add(
            topic.name, publisher, inf if latched else min(offer.depth, REPLAY_DEPTH)
        )
        if converted is not None:
            outlet.send = lambda data: publisher.publish(converted(data))

    def count_failure(self, reason: str) -> None:
        """Count a request that raised an error, and log why, once a second at most."""
        self.failures += 1
        self.get_logger().warning(f"request failed: {reason}", throttle_duration_sec=1.0)

    def publish(self, message: Message, *, hurried: bool) -> None:
        """Publish a message as it was serialized; see ``Outlets.send``."""
        self.outlets.send(message.topic, message.data, hurried=hurried)

    def publish_clock(self, bag_time: int) -> None:
        """Publish the bag's time [ns] on ``/clock``."""
        message = Clock()
        message.clock.sec, message.clock.nanosec = split_seconds(bag_time)
        self._clock_publisher.publish(message)


def replay_offer(recorded: Sequence[RecordedProfile]) -> QoSProfile:
    """Return the QoS of a replayed topic: the strongest of each policy that was offered.

    So every subscriber that connected to one of the publishers connects to the replay. Without a
    recorded offer the topic is reliable and volatile.
    """
    latched = any(profile.durability == "transient_local" for profile in recorded)
    depths = [
        min(max(profile.depth, 1), DEPTH_LIMIT)
        for profile in recorded
        if profile.history == "keep_last"
    ]
    default_depth = LATCHED_DEPTH if latched else REPLAY_DEPTH
    reliable = not recorded or any(profile.reliability != "best_effort" for profile in recorded)
    manual = any(profile.liveliness == "manual_by_topic" for profile in recorded)
    offer = QoSProfile(
        # Except for latched topics a depth is only room, which a fast replay needs.
        depth=max(depths, default=default_depth) if latched else max([*depths, default_depth]),
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
        liveliness=LivelinessPolicy.MANUAL_BY_TOPIC if manual else LivelinessPolicy.AUTOMATIC,
    )
    if recorded:
        offer.deadline = Duration(nanoseconds=min(profile.deadline for profile in recorded))
        offer.lifespan = Duration(nanoseconds=max(profile.lifespan for profile in recorded))
        offer.liveliness_lease_duration = Duration(
            nanoseconds=min(profile.liveliness_lease_duration for profile in recorded)
        )
    return offer


def conversion(summary: TopicSummary, installed: Any) -> Callable[[bytes], Any] | None:
    """Return what makes messages of an installed class of a topic's bytes; None if they are such.

    A subscriber drops a message that ends early. Fields that the recorded version lacks get their
    default. One with a field that the installed version lacks is an UnknownTypeError.
    """
    topic = summary.topic
    try:
        same = topic.type_hash in ("", find_type_hash(topic.type))
    except BagError:  # the type is no part of an installation
        return None
    if same or summary.definition is None:
        return None
    try:
        codec = Codec(topic.type, summary.definition)
    except BagFormatError as error:
        raise UnknownTypeError(str(error)) from error
    recorded = {name for name, _ in codec.members.members}
    if gone := recorded - installed.get_fields_and_field_types().keys():
        raise UnknownTypeError(f"the installed {topic.type} has no {', '.join(sorted(gone))}")

    def converted(data: bytes) -> Any:
        try:
            return filled(installed(), to_plain(codec.decode(data)))
        except (AssertionError, AttributeError, BagFormatError, TypeError, ValueError):
            return data  # a damaged one goes out as it is

    return converted
