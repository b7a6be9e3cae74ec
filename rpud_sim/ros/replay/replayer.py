"""Replay of a bag: its node, its thread and services, until its end or a signal."""

from __future__ import annotations

import time
from collections import Counter, deque
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from typing import Any, NamedTuple

from rclpy.duration import Duration
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, LivelinessPolicy, QoSProfile, ReliabilityPolicy
from rosgraph_msgs.msg import Clock
from rpud_msgs.srv import Seek, SetRate
from std_srvs.srv import Trigger

import rpud_sim.bag
from rpud_sim.bag import BagError, BagFormatError, BagReader, Message, TopicSummary
from rpud_sim.bag.metadata import QosProfile as RecordedProfile
from rpud_sim.foundation.options import NAMESPACE
from rpud_sim.foundation.quantities import ExpectedError, ParameterError, did_you_mean, joined
from rpud_sim.foundation.terminal import LONGEST_LINE, LONGEST_NAME, error_text, printable
from rpud_sim.foundation.time import SECOND, join_seconds, split_seconds
from rpud_sim.messages.cdr import Codec, foreign_encoding
from rpud_sim.messages.columns import to_plain
from rpud_sim.messages.definitions import find_type_hash
from rpud_sim.ros.endpoints import LAST_WAIT, AcknowledgedPublishers
from rpud_sim.ros.graph import (
    CLOCK,
    ClockSources,
    UnknownTypeError,
    filled,
    message_class,
    resolve_topic,
)
from rpud_sim.ros.options import DISCOVERY_TIME, ReplayOptions
from rpud_sim.ros.process import StopRequest, running_ros
from rpud_sim.ros.replay.playback import Messages, Playback, read_ahead
from rpud_sim.ros.threads import RequestError, quick_switches, raised, serve, settled_memory

_PRIORITY = 10  # as for a drill: in real time or slower; faster, it could keep a core for itself
_SETTLING_TIME = 0.2  # s from a publisher's match to the subscriber's own
_POLL_PERIOD = 0.01  # s
_FIRST_WINDOW = 10 * SECOND  # before a position, in which latched messages are looked for [ns]
_LOOK_PERIOD = 1.0  # between looks at the publishers of /clock [s]
MakeBar = Callable[..., Any]
"""Maker of a progress bar: a ``tqdm`` with a ``title`` and a ``total`` in seconds."""
# Messages of a replayed topic that may wait for acknowledgement; Fast DDS keeps no more.
REPLAY_DEPTH = 5_000
DEPTH_LIMIT = 2**31 - 1  # greatest depth that the middleware accepts
# Messages that a replayed latched topic keeps; discovery does not show how many it was.
LATCHED_DEPTH = 10
_LONGEST_WAIT = 5.0  # for subscribers of a fast replay [s]


class Replayer(Node):
    """Publishes topics of a bag with their types and QoS, and ``/clock`` if requested.

    What cannot be published is skipped with a warning. ``remappings`` are as ``OLD:=NEW``.
    """

    def __init__(
        self,
        topics: Iterable[TopicSummary],
        *,
        with_clock: bool,
        remappings: Iterable[str] = (),
        namespace: str = NAMESPACE,
    ) -> None:
        rules = [word for rule in remappings for word in ("--remap", rule)]
        super().__init__(
            "replayer",
            namespace=namespace,
            cli_args=["--ros-args", *rules] if rules else None,
            start_parameter_services=False,
        )
        self.failures = 0  # requests that raised an error
        self.refused = Counter[str]()  # messages that cannot be published, by topic
        self.topics = AcknowledgedPublishers(_LONGEST_WAIT)  # by the topic's name in the bag
        self._types: dict[str, str] = {}  # by the names that they are published with
        if with_clock:
            qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
            self._clock_publisher = self.create_publisher(Clock, CLOCK, qos)
        for summary in topics:
            name = summary.topic.name
            if with_clock and name == CLOCK:
                self.get_logger().warning(f"the bag's own {CLOCK} is replaced by --clock")
                continue
            try:
                self._add(summary)
            except UnknownTypeError as error:
                self.warn(f"not replayed: {printable(name, LONGEST_NAME)}: {error}")

    def _add(self, summary: TopicSummary) -> None:
        topic = summary.topic
        if not summary.one_type:
            raise UnknownTypeError("it has several types or definitions")
        if topic.serialization_format != "cdr":
            raise UnknownTypeError(f"it is in {topic.serialization_format!r}")
        message = message_class(topic.type)
        try:
            name = resolve_topic(self, topic.name)
        except ParameterError:
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
        added = self.topics.add(
            topic.name, publisher, inf if latched else min(offer.depth, REPLAY_DEPTH)
        )
        if converted is not None:
            added.send = lambda data: publisher.publish(converted(data))

    def warn(self, text: str) -> None:
        """Log a warning as one line, whatever names it has."""
        self.get_logger().warning(printable(text, LONGEST_LINE))

    def count_failure(self, reason: str) -> None:
        """Count a request that raised an error, and log why, once a second at most."""
        self.failures += 1
        self.get_logger().warning(f"request failed: {reason}", throttle_duration_sec=1.0)

    def publish(self, message: Message, *, hurried: bool) -> bool:
        """Publish a message as it was serialized; see ``AcknowledgedPublishers.send``.

        One that is not plain CDR, or does not fit the installed type, is left out and counted: a
        subscriber would fail to read it.
        """
        try:
            if reason := foreign_encoding(message.data):
                raise BagFormatError(reason)
            self.topics.send(message.topic, message.data, hurried=hurried)
        except BagFormatError as error:
            if message.topic not in self.refused:
                name = printable(message.topic, LONGEST_NAME)
                self.warn(f"messages of {name} are left out: {error}")
            self.refused[message.topic] += 1
            return False
        return True

    def publish_clock(self, bag_time: int) -> None:
        """Publish the bag's time [ns] on ``/clock``."""
        message = Clock()
        seconds, message.clock.nanosec = split_seconds(bag_time)
        message.clock.sec = min(seconds, 2**31 - 1)  # a bag may hold any time
        self._clock_publisher.publish(message)


def replay_offer(recorded: Sequence[RecordedProfile]) -> QoSProfile:
    """Return the QoS of a replayed topic: the strongest of each policy that was offered."""
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
        # Except for latched topics a depth is only space, which a fast replay needs.
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
    """Return the converter to an installed class; None if the bytes are such.

    A recorded field that the installed version lacks is an UnknownTypeError.
    """
    topic = summary.topic
    if summary.definition is None:
        return None
    try:
        expected = find_type_hash(topic.type)
        if topic.type_hash == expected:
            return None
        codec = Codec(topic.type, summary.definition)
    except BagFormatError as error:
        if not topic.type_hash:  # nothing reports that it is another version
            return None
        raise UnknownTypeError(str(error)) from error
    except BagError:  # the type is not part of an installation
        return None
    if codec.type_hash == expected:  # bags of other tools have definitions without a hash
        return None
    recorded = {name for name, _ in codec.members.members}
    if gone := recorded - installed.get_fields_and_field_types().keys():
        raise UnknownTypeError(f"the installed {topic.type} has no {', '.join(sorted(gone))}")

    def converted(data: bytes) -> Any:
        try:
            return filled(installed(), to_plain(codec.decode(data)))
        except (AssertionError, AttributeError, TypeError, ValueError) as error:
            reason = f"it does not fit the installed {topic.type}: {error_text(error)}"
            raise BagFormatError(reason) from error

    return converted


# Types of the services, and what they do.
_SERVICES: dict[str, tuple[Any, Callable[[Playback, Any], None]]] = {
    "pause": (Trigger, lambda playback, request: playback.pause()),
    "resume": (Trigger, lambda playback, request: playback.pause(False)),
    "set_rate": (SetRate, lambda playback, request: playback.set_rate(request.rate)),
    "seek": (
        Seek,
        lambda playback, request: playback.seek(
            join_seconds(request.time.sec, request.time.nanosec)
        ),
    ),
    "play_next": (Trigger, lambda playback, request: playback.play_next()),
}


def offer_services(node: Replayer, playback: Playback) -> None:
    """Offer services of ``ros2 bag play`` below the node's name, with their meanings."""
    for name, (kind, act) in _SERVICES.items():
        node.create_service(kind, f"~/{name}", partial(_answer, node, playback, name, act))


def _answer(
    node: Replayer,
    playback: Playback,
    name: str,
    act: Callable[[Playback, Any], None],
    request: Any,
    response: Any,
) -> Any:
    reason = ""
    try:
        playback.do(lambda each: act(each, request))
    except RequestError as error:
        reason = str(error)
        node.get_logger().warning(f"{name} is rejected: {reason}")
    except Exception as error:  # out of the executor it would leave a client without answer
        reason = raised(error)
        node.count_failure(f"{name}: {reason}")
    response.success = not reason
    if hasattr(response, "message"):
        response.message = reason
    return response


class Replayed(NamedTuple):
    """Result of a replay."""

    summary: str  # in one line
    complete: bool  # whether all messages of its topics could be published


def replay(options: ReplayOptions, ros_arguments: Sequence[str], make_bar: MakeBar) -> Replayed:
    """Replay to the end of the bag or until a signal stops it."""
    with StopRequest(options.with_parent) as stop, rpud_sim.bag.open(options.bag) as bag:
        topics = _chosen_topics(bag, options)
        with running_ros(ros_arguments):
            return _replay(bag, topics, options, stop, make_bar)


def _chosen_topics(bag: BagReader, options: ReplayOptions) -> list[TopicSummary]:
    duration = bag.duration / SECOND
    if options.start > duration:
        raise ParameterError(
            f"--start is {options.start:g} s; it must be from 0 to {duration:.3f} s, "
            f"the duration of {bag.path}"
        )
    named = {
        "--topics": options.topics or (),
        "--exclude": options.exclude,
        "--remap": [rule.partition(":=")[0] for rule in options.remap],
    }
    held = [summary.topic.name for summary in bag.topics]
    for option, names in named.items():
        for name in names:
            if name not in held:
                hint = did_you_mean(name, held)
                raise BagError(f"{option} names {name:.200}, which {bag.path} lacks{hint}")
    return [
        summary
        for summary in bag.topics
        if summary.message_count
        and (options.topics is None or summary.topic.name in options.topics)
        and summary.topic.name not in options.exclude
    ]


def _replay(
    bag: BagReader,
    topics: list[TopicSummary],
    options: ReplayOptions,
    stop: StopRequest,
    make_bar: MakeBar,
) -> Replayed:
    node = Replayer(
        topics,
        with_clock=options.clock is not None,
        remappings=options.remap,
        namespace=options.namespace,
    )
    if not node.topics:
        if topics:
            raise ExpectedError(f"no topic of {bag.path} can be replayed here")
        return Replayed(f"{printable(bag.path)} has no messages to replay", complete=True)
    for text in bag.unread_offers:
        node.warn(text)
    node.get_logger().info(
        f"replaying {printable(bag.path)}: {len(node.topics)} topics, "
        f"{bag.duration / SECOND:.1f} s at {options.rate:g} times real time"
    )
    _await_subscribers(node, stop, patient=options.wait_for_subscribers)
    sources, look_at = ClockSources(node), 0.0
    first = bag.start_time + round(options.start * SECOND)
    last = bag.end_time
    if options.duration is not None:
        last = min(last, first + round(options.duration * SECOND))

    def read(position: int) -> Messages:
        # A whole replay has all messages, whatever times the bag's statistics report.
        duration = None if options.duration is None else last - position + 1
        return read_ahead(bag.messages(list(node.topics), position - bag.start_time, duration))

    def latched(position: int) -> list[Message]:
        return last_latched(bag, node.topics, position - bag.start_time)

    playback = Playback(
        read, (first, last), options, node, interrupted=lambda: stop.requested, latched=latched
    )
    offer_services(node, playback)
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    bar = make_bar(title=printable(bag.path.name), total=(last - first) / SECOND)
    with quick_switches(), settled_memory(), bar, ThreadPoolExecutor(1) as pool:
        # Last of all: to make the rest takes Python's lock for longer than a message may wait.
        began = time.monotonic()
        playing = pool.submit(playback.run, _PRIORITY if options.rate <= 1.0 else 0)
        try:
            while not playing.done() and not stop.requested:
                serve(executor, node.count_failure)
                _show(playback, first, bar)
                if options.clock is not None and time.monotonic() >= look_at:
                    look_at = time.monotonic() + _LOOK_PERIOD
                    sources.look()
        finally:
            playback.stop()
        playing.result()
        if not stop.requested:
            for name in node.topics.wait(LAST_WAIT):
                node.warn(f"a subscriber of {name} has not confirmed all messages")
            # Best-effort messages have no acknowledgement, and may still be on their way; whoever
            # asks now learns that the replay has ended.
            settled_at = time.monotonic() + _SETTLING_TIME
            while time.monotonic() < settled_at and not stop.requested:
                serve(executor, node.count_failure)
    executor.shutdown()
    refused = f", {node.refused.total()} messages left out" if node.refused else ""
    failures = f", {node.failures} requests failed" if node.failures else ""
    return Replayed(
        f"replayed {playback.published} messages in {time.monotonic() - began:.1f} s, "
        f"{playback.lateness}{refused}{failures}",
        complete=not node.refused,
    )


def last_latched(bag: BagReader, topics: Collection[str], end: int) -> list[Message]:
    """Return the last messages of latched topics before a time since the bag began [ns].

    There is one for each offer, for several publishers may latch what only together is whole.
    """
    wanted = {
        each.topic.name: deque[Message](maxlen=len(each.topic.offered_qos))
        for each in bag.topics
        if each.topic.name in topics
        and any(offer.durability == "transient_local" for offer in each.topic.offered_qos)
    }
    found: list[Message] = []
    length = _FIRST_WINDOW
    # Backwards, in windows of growing length: most are found near the end.
    while wanted and end > 0:
        start = max(0, end - length)
        for message in bag.messages(wanted.keys(), start, end - start):
            if message.log_time < bag.start_time + end:
                wanted[message.topic].append(message)
        for name, kept in list(wanted.items()):
            found += kept
            lacking = (kept.maxlen or 0) - len(kept)
            if lacking:
                wanted[name] = deque(maxlen=lacking)
            else:
                del wanted[name]
        end, length = start, 2 * length
    return sorted(found, key=lambda each: each.log_time)


def _show(playback: Playback, first: int, bar: Any) -> None:
    """Show the position of the playback."""
    bar.n = min((playback.position - first) / SECOND, bar.total)
    state = "paused" if playback.paused else f"x{playback.rate:g}"
    bar.set_postfix_str(f"{state}, {playback.published} messages", refresh=False)
    bar.last_print_n = min(bar.last_print_n, bar.n)  # after a step backwards
    bar.update(0)


_WHY = "--wait-for-subscribers begins when every topic has one; --topics selects topics"


def _await_subscribers(node: Replayer, stop: StopRequest, *, patient: bool) -> None:
    deadline = time.monotonic() + DISCOVERY_TIME
    logged = False
    while unsubscribed := node.topics.unsubscribed:
        if time.monotonic() >= deadline:
            if not patient:
                break
            if not logged:
                names = joined(unsubscribed)
                node.get_logger().info(printable(f"waiting for a subscriber of {names}: {_WHY}"))
                logged = True
        if stop.wait(_POLL_PERIOD):
            return
    stop.wait(_SETTLING_TIME)
