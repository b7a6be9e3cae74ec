"""Commands to the drill: queued until a block ends, and their results."""

from __future__ import annotations

import dataclasses
import heapq
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.impl.rcutils_logger import RcutilsLogger
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import Feed as FeedMessage
from sensor_msgs.msg import JointState
from std_msgs.msg import Header

from rpud_sim.drilling.mount import FEED_MODES, POSITION, RATE
from rpud_sim.foundation.quantities import LONGEST_NAME, ParameterError, Text, truncated
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.messages.batch import Batch, Fields
from rpud_sim.ros.drill.publishers import RESULTS, DrillPublishers
from rpud_sim.ros.endpoints import SequenceGaps, taken
from rpud_sim.ros.graph import message_class
from rpud_sim.ros.threads import DelayHistogram
from rpud_sim.simulation.commands import Command, Drive, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.fields import FEED_JOINT, JOINTS, ROTATION_JOINT, time_fields
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, JOINT_COMMANDS, MOUNT_FRAME

COMMAND_QOS = QoSProfile(depth=1000)  # reliable

_PASSIVE = (*JOINTS, ROTATION_JOINT)

_FRAME = Text("frame of a command", "a name", LONGEST_NAME)

_LONGEST_WAY = 1.0  # from the sample of a motion to the time at which it acts [s]
_LOGGED_PER_SECOND = 10
_MOST_RESULTS = 1000  # that wait to be published: more are counted only

Received = tuple[bytes, Mapping[str, Any]]  # a message, and its times and number


def joints_to_feed(message: JointState, prefix: str = "") -> Feed | None:
    """Return the feed that a command to joints has; None if it has none.

    Names of the drill's joints begin with the prefix.

    The hardware interface names every joint of its system, and lists may be shorter than the names.
    A command interface that no controller has claimed is NaN.
    """
    names, joint = list(message.name), prefix + FEED_JOINT
    lists = (message.position, message.velocity, message.effort)

    def values(number: int) -> list[float]:
        return [each[number] if number < len(each) else math.nan for each in lists]

    for number, name in enumerate(names):
        passive = name.startswith(prefix) and name.removeprefix(prefix) in _PASSIVE
        if passive and not all(map(math.isnan, values(number))):
            raise ParameterError(
                f"joint_commands: {name} cannot be commanded; of the drill's joints only "
                f"{joint} can"
            )
    if joint not in names:
        return None
    number = names.index(joint)
    if names.count(joint) > 1 or any(
        len(each) > len(names) or 0 < len(each) <= number for each in lists
    ):
        counts = ", ".join(str(len(each)) for each in lists)
        raise ParameterError(
            f"joint_commands: {counts} positions, velocities and efforts for {len(names)} joints "
            f"give {joint} no single value: name it once, and first"
        )
    position, rate, effort = values(number)
    if not math.isnan(effort):
        raise ParameterError(f"joint_commands: {joint} takes no effort, given {effort:g}")
    if not (math.isnan(position) or math.isnan(rate)):
        raise ParameterError(
            f"joint_commands: {joint} takes a position or a velocity, "
            f"given {position:g} m and {rate:g} m/s"
        )
    if not math.isnan(position):
        return Feed(POSITION, position)
    return None if math.isnan(rate) else Feed(RATE, rate)


def _to_feed(message: FeedMessage) -> Feed:
    values = {RATE: (message.rate, "m/s"), POSITION: (message.position, "m")}
    if message.mode >= len(FEED_MODES):
        raise ParameterError(f"feed mode = {message.mode} is not 0 (rate) or 1 (position)")
    mode, other = FEED_MODES[message.mode], FEED_MODES[1 - message.mode]
    value, unit = values[other]
    # A shell that names only one of them leaves the mode out.
    if not (value == 0.0 or math.isnan(value)):
        raise ParameterError(
            f"feed mode = {message.mode} ({mode}) takes no {other}, given {value:g} {unit}: "
            f"a {other} needs mode = {1 - message.mode}"
        )
    return Feed(mode, values[mode][0])


# The command that a message has, by topic; the second argument is the prefix of joints.
_CONVERSIONS: Mapping[str, Callable[[Any, str], Command | None]] = {
    "command/weight_on_bit": lambda message, _: WeightOnBit(message.force),
    "command/drive": lambda message, _: Drive(message.enabled, message.voltage, message.frequency),
    "command/feed": lambda message, _: _to_feed(message),
    "command/mount": lambda message, _: MountMotion(message.position, message.velocity),
    JOINT_COMMANDS: joints_to_feed,
}


def result_of(kind: str, header: Header | None = None) -> Fields:
    """Return the fields of the ``rpud_msgs/CommandResult`` of a command, before there is one.

    Results are kept: a longer frame than is allowed is cut off.
    """
    header = header or Header()  # of a malformed command
    stamp = {"sec": header.stamp.sec, "nanosec": header.stamp.nanosec}
    named = {"stamp": stamp, "frame_id": truncated(header.frame_id, LONGEST_NAME)}
    return {"kind": kind, "header": named, "accepted": False, "reason": ""}


class Inbox:
    """Queue of commands, and their results; any thread may use it.

    ``notify`` is called when a command is accepted or rejected. ``result_of`` makes the results.
    """

    def __init__(self, logger: RcutilsLogger, notify: Callable[[], None] = lambda: None) -> None:
        self.opened = False  # whether commands are accepted, which each topic asks
        self.notify = notify
        self._logger = logger
        self._waiting: deque[tuple[int, Command, Fields]] = deque()
        self._results: deque[Fields] = deque(maxlen=_MOST_RESULTS)  # not published yet
        self._counting = threading.Lock()
        self._second = 0
        self._logged = 0
        self.begin()

    def begin(self) -> None:
        """Count from zero, and discard waiting commands: they were meant for the run before."""
        with self._counting:
            self._delays = DelayHistogram()
            # By kind and whether it was accepted.
            self._latest: dict[tuple[str, bool], Fields] = {}
            self._results.clear()
            for _, _, result in self._waiting:
                result["reason"] = "the drill began again before it could act"
                self._results.append(result)
            self.accepted = 0  # commands that acted, since the start
            self.rejected = 0  # commands that were rejected
            self.discarded = len(self._waiting)  # commands that were overwritten before they acted
            self.requests_refused = 0  # requests of services
            self.last_refusal = ""  # why the latest command or request was rejected
            self._waiting.clear()

    def accept(self, command: Command, result: Fields, arrived: int | None = None) -> None:
        """Queue a command that arrived at a monotonic time [ns], now if None."""
        with self._counting:
            self._waiting.append((arrived or time.monotonic_ns(), command, result))
        self.notify()

    def discard(self, count: int) -> None:
        """Count commands that the middleware overwrote before they were taken."""
        with self._counting:
            self.discarded += count
        self.notify()

    def refuse(self, result: Fields, reason: str) -> None:
        """Count an invalid command, and log why."""
        reason = truncated(reason)
        with self._counting:
            self.rejected += 1
            self._results.append({**result, "reason": reason})
            self._log("command", reason)
        self.notify()

    def refuse_request(self, reason: str) -> None:
        """Count a service's request that is rejected, and log why."""
        with self._counting:
            self.requests_refused += 1
            self._log("request", truncated(reason))

    def drain(self, apply: Callable[[Command], object]) -> bool:
        """Let the waiting commands act in order; return whether there were any.

        A command for which ``apply`` raises a ParameterError is rejected, any other is accepted.
        """
        now = time.monotonic_ns()
        with self._counting:
            waiting = list(self._waiting)
            self._waiting.clear()
        for arrived, command, result in waiting:
            try:
                apply(command)
            except ParameterError as error:
                self.refuse(result, str(error))
                continue
            with self._counting:
                self.accepted += 1
                self._delays.add(now - arrived)
                self._results.append({**result, "accepted": True})
        return bool(waiting)

    def take_delays(self) -> DelayHistogram:
        """Return the delays from arrival to ``drain``, since the last call."""
        delays, self._delays = self._delays, DelayHistogram()
        return delays

    def take_results(self) -> tuple[list[Fields], list[Fields]] | None:
        """Return the last results of each kind before, and the new ones; None if there are none."""
        with self._counting:
            if not self._results:  # an empty message would be the first that a late node gets
                return None
            repeated, new = list(self._latest.values()), list(self._results)
            self._latest.update({(each["kind"], each["accepted"]): each for each in new})
            self._results.clear()
            return repeated, new

    def publish_results(self, publishers: DrillPublishers, stamp: int, prefix: str) -> None:
        """Publish new results, with the number of the status that shows them."""
        if (results := self.take_results()) is None:
            return
        repeated, new = results
        message = {
            "header": {"stamp": time_fields(stamp), "frame_id": prefix + MOUNT_FRAME},
            "results": [*repeated, *new],
            "repeated": len(repeated),
            "status": publishers.published["status"],
        }
        publishers.publish([Batch.of(stamp, RESULTS, message)])

    def _log(self, what: str, reason: str) -> None:
        self.last_refusal = reason
        second = int(time.monotonic())
        self._logged = self._logged + 1 if second == self._second else 1
        self._second = second
        if self._logged <= _LOGGED_PER_SECOND:
            self._logger.warning(f"{what} rejected: {reason}")
        elif self._logged == _LOGGED_PER_SECOND + 1:
            self._logger.warning("further rejections in this second are counted but not logged")


class CommandTopics:
    """Subscriptions to all topics of commands: what waits is taken in the order of its arrival.

    ``now`` is the stamp of a command that is given now, ``origin`` of simulation time zero [ns].
    """

    def __init__(
        self,
        node: Node,
        inbox: Inbox,
        settings: Callable[[], Settings],
        now: Callable[[], int],
        origin: Callable[[], int],
    ) -> None:
        self._topics = [
            CommandTopic(node, topic, inbox, settings, now, origin, self._take)
            for topic in ALL_COMMAND_TOPICS
        ]

    def _take(self, topic: CommandTopic, first: Received) -> None:
        """Take what waits on all topics: the executor takes one of each in a turn of its own."""
        waiting = {each: [first] if each is topic else [] for each in self._topics}
        count, before = 1, 0
        # Until a look finds nothing: what has arrived on a topic after the look at it may be
        # earlier than what is found on the next.
        while before < count < COMMAND_QOS.depth:
            for each, received in waiting.items():
                received += taken(each.subscription, COMMAND_QOS.depth)
            before, count = count, sum(map(len, waiting.values()))
        arrivals = ([(each, *one) for one in received] for each, received in waiting.items())
        for each, payload, information in heapq.merge(*arrivals, key=_received_at):
            each.read(payload, information)
        for each in self._topics:
            each.count_discarded()


class CommandTopic:
    """Subscription to a topic of commands; ``take`` is called with each that the executor took."""

    def __init__(
        self,
        node: Node,
        topic: str,
        inbox: Inbox,
        settings: Callable[[], Settings],
        now: Callable[[], int],
        origin: Callable[[], int],
        take: Callable[[CommandTopic, Received], object],
    ) -> None:
        self._name = topic.removeprefix("command/")
        self._type = message_class(ALL_COMMAND_TOPICS[topic])
        self._convert = _CONVERSIONS[topic]
        self._inbox = inbox
        self._settings = settings
        self._now = now
        self._origin = origin
        self._overwritten = 0  # as the middleware counts, without what a reader's queue drops
        self._counted = 0  # as discarded

        # rclpy passes the times of a message to a callback with two arguments.
        def on_message(payload: bytes, information: Mapping[str, Any]) -> None:
            take(self, (payload, information))

        callback: Any = on_message
        # Raw: the middleware would drop a malformed payload without a count.
        self.subscription = node.create_subscription(
            *(self._type, topic, callback, COMMAND_QOS),
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
        )
        self._gaps = SequenceGaps(lambda: self.subscription.handle.get_publisher_count())

    def read(self, payload: bytes, information: Mapping[str, Any]) -> None:
        """Queue a command, or reject it."""
        self._gaps.record(information["publication_sequence_number"])
        result = result_of(self._name)
        try:
            message = deserialize_message(payload, self._type)
        except Exception:  # RMWError, or what the conversion to Python raises
            reason = f"{self._name}: a payload of {len(payload)} bytes is malformed"
            self._inbox.refuse(result, reason)
            return
        try:
            result = result_of(self._name, message.header)
            _FRAME.check(f"{self._name}: frame_id", message.header.frame_id)
            # None first: the hardware interface publishes while no controller commands.
            if (command := self._convert(message, self._settings().frame_prefix)) is not None:
                command = self._checked(command, message.header.stamp)
                self._inbox.accept(command, result, arrival(information))
        except ParameterError as error:
            self._inbox.refuse(result, str(error))

    def _checked(self, command: Command, stamp: Time) -> Command:
        """Return a command that is in time, a motion with the time of its sample."""
        if not self._inbox.opened:
            raise ParameterError(f"{self._name}: the drill is not active")
        settings, given = self._settings(), join_seconds(stamp.sec, stamp.nanosec)
        age, longest = (self._now() - given) / SECOND, settings.command_timeout
        if isinstance(command, MountMotion):
            longest = longest or _LONGEST_WAY
        # A stamp of zero means that there is none.
        if longest and given and not -longest <= age <= longest:
            what = f"{age:.3f} s old" if age > 0 else f"{-age:.3f} s ahead of the drill's time"
            raise ParameterError(
                f"{self._name} is stale: its stamp is {what}; allowed is {longest:g} s"
            )
        if isinstance(command, MountMotion) and given:
            return dataclasses.replace(command, sampled=given - self._origin())
        return command

    def _on_lost(self, event: Any) -> None:
        self._overwritten = event.total_count
        self.count_discarded()

    def count_discarded(self) -> None:
        """Count by gaps or by the middleware, whichever found more: each overlooks some."""
        found = max(self._gaps.missing, self._overwritten)
        if found > self._counted:
            self._inbox.discard(found - self._counted)
            self._counted = found


def _received_at(received: tuple[CommandTopic, bytes, Mapping[str, Any]]) -> int:
    return int(received[-1]["received_timestamp"])


def arrival(information: Mapping[str, int]) -> int:
    """Return when the middleware received a message, on the monotonic clock [ns].

    The middleware gives the time of day, which may be set meanwhile. So a message counts as one
    that arrived within the last second; without it as one that arrived now.
    """
    received = information["received_timestamp"]
    waited = time.time_ns() - received if received else 0
    return time.monotonic_ns() - min(max(waited, 0), SECOND)
