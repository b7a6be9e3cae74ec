"""Gate of the commands: they are checked here once."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from builtin_interfaces.msg import Time
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import CommandResult
from rpud_msgs.msg import Drive as DriveMessage
from rpud_msgs.msg import Feed as FeedMessage
from rpud_msgs.msg import WeightOnBit as WeightOnBitMessage
from sensor_msgs.msg import JointState

from rpud_sim.bag.losses import SequenceGaps
from rpud_sim.drilling.mount import POSITION, RATE
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.inbox import Command, Inbox
from rpud_sim.ros.drill.publishers import COMMAND_QOS
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.fields import FEED_JOINT, JOINTS, ROTATION_JOINT

Checked = TypeVar("Checked", Drive, Feed)

_PASSIVE = (*JOINTS, ROTATION_JOINT)

_FEED_MODES = {FeedMessage.MODE_RATE: RATE, FeedMessage.MODE_POSITION: POSITION}


def to_feed(message: JointState) -> Feed | None:
    """Return the feed that a command to joints has; None if it has none.

    The hardware interface names every joint of its system, and gives values only of those with a
    command interface: a list of values may be shorter than the names. A command interface that no
    controller has claimed is NaN, which is no command. Joints of others are ignored.
    """
    names = list(message.name)
    if FEED_JOINT not in names:
        _check_passive(message, names)
        return None
    if names.count(FEED_JOINT) > 1:
        raise ParameterError(f"joint_commands: {FEED_JOINT} is named twice")
    number = names.index(FEED_JOINT)
    for kind, values in _values(message).items():
        if len(values) > len(names) or 0 < len(values) <= number:
            raise ParameterError(
                f"joint_commands: {kind} has length {len(values)} for {len(names)} joints, of "
                f"which {FEED_JOINT} is number {number + 1}: name it first"
            )
    _check_passive(message, names)
    position, rate, effort = (_value(values, number) for values in _values(message).values())
    if not math.isnan(effort):
        raise ParameterError(f"joint_commands: {FEED_JOINT} takes no effort, given {effort:g}")
    if not (math.isnan(position) or math.isnan(rate)):
        raise ParameterError(
            f"joint_commands: {FEED_JOINT} takes a position or a velocity, "
            f"given {position:g} m and {rate:g} m/s"
        )
    if not math.isnan(position):
        return Feed(POSITION, position)
    return None if math.isnan(rate) else Feed(RATE, rate)


def _values(message: JointState) -> dict[str, Sequence[float]]:
    return {"position": message.position, "velocity": message.velocity, "effort": message.effort}


def _value(values: Sequence[float], number: int) -> float:
    return values[number] if number < len(values) else math.nan


def _check_passive(message: JointState, names: list[str]) -> None:
    for number, name in enumerate(names):
        if name in _PASSIVE and not all(
            math.isnan(_value(values, number)) for values in _values(message).values()
        ):
            raise ParameterError(
                f"joint_commands: {name} cannot be commanded; of the drill's joints only "
                f"{FEED_JOINT} can"
            )


class Gate:
    """Subscriptions to the commands; an invalid command is rejected with a reason.

    ``settings`` gives the settings in force, ``now`` the stamp of a command that is given now [ns].
    """

    def __init__(
        self,
        node: Node,
        settings: Callable[[], Settings],
        inbox: Inbox,
        now: Callable[[], int],
    ) -> None:
        self._settings = settings
        self._inbox = inbox
        self._now = now
        self._open = False
        for name, kind, handler in (
            ("command/weight_on_bit", WeightOnBitMessage, self._to_weight_on_bit),
            ("command/drive", DriveMessage, self._to_drive),
            ("command/feed", FeedMessage, self._to_feed),
            ("joint_commands", JointState, self._joint_to_feed),
        ):
            _CommandTopic(node, name, kind, handler, inbox)

    def open(self, opened: bool) -> None:
        """Accept commands from now on, or reject all of them."""
        self._open = opened

    def _to_weight_on_bit(self, message: WeightOnBitMessage) -> WeightOnBit:
        self._check("weight on bit", message.header.stamp)
        self._settings().configuration.check_weight_on_bit()
        return WeightOnBit(message.force)

    def _to_drive(self, message: DriveMessage) -> Drive:
        self._check("drive", message.header.stamp)
        return self._checked(Drive(message.enabled, message.voltage, message.frequency))

    def _to_feed(self, message: FeedMessage) -> Feed:
        self._check("feed", message.header.stamp)
        mode = _FEED_MODES.get(message.mode)
        if mode is None:
            raise ParameterError(f"feed mode = {message.mode} is not 0 (rate) or 1 (position)")
        return self._checked(Feed(mode, message.value))

    def _joint_to_feed(self, message: JointState) -> Feed | None:
        # Before the rest: the hardware interface publishes while no controller commands.
        feed = to_feed(message)
        if feed is None:
            return None
        self._check("joint_commands", message.header.stamp)
        return self._checked(feed)

    def _checked(self, command: Checked) -> Checked:
        self._settings().configuration.check(command)
        return command

    def _check(self, name: str, stamp: Time) -> None:
        if not self._open:
            raise ParameterError(f"{name}: the drill is not active")
        timeout = self._settings().command_timeout
        given = join_seconds(stamp.sec, stamp.nanosec)
        # A stamp of zero means that there is none.
        if not (timeout and given):
            return
        age = (self._now() - given) / SECOND
        if not -timeout <= age <= timeout:
            what = f"{age:.3f} s old" if age > 0 else f"{-age:.3f} s ahead of the drill's time"
            raise ParameterError(f"{name} is stale: its stamp is {what}; allowed is {timeout:g} s")


class _CommandTopic:
    """Subscription to one topic of commands; counts those that the middleware overwrote."""

    def __init__(
        self,
        node: Node,
        name: str,
        kind: type,
        handler: Callable[[Any], Command | None],
        inbox: Inbox,
    ) -> None:
        self._name = name.removeprefix("command/")
        self._kind = kind
        self._handler = handler
        self._inbox = inbox
        self._overwritten = 0  # as the middleware counts: not those of a queue of its reader
        self._counted = 0
        # rclpy passes the times of a message to a callback with two arguments.
        callback: Any = self._on_message
        # Raw: the middleware would drop a malformed payload without a count.
        self._subscription = node.create_subscription(
            kind,
            name,
            callback,
            COMMAND_QOS,
            raw=True,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
        )
        self._gaps = SequenceGaps(lambda: self._subscription.handle.get_publisher_count())

    def _on_message(self, payload: bytes, information: Mapping[str, Any]) -> None:
        """Take all commands that wait: the executor takes one of each topic in a turn."""
        taken: tuple[bytes, Mapping[str, Any]] | None = (payload, information)
        handle = self._subscription.handle
        with handle:
            for _ in range(COMMAND_QOS.depth):
                if taken is None:
                    break
                self._read(*taken)
                taken = handle.take_message(self._kind, True)
        self._count_discarded()

    def _read(self, payload: bytes, information: Mapping[str, Any]) -> None:
        self._gaps.note(information["publication_sequence_number"])
        try:
            message = deserialize_message(payload, self._kind)
        except Exception:  # RMWError, or what the conversion to Python raises
            reason = f"{self._name}: a payload of {len(payload)} bytes is malformed"
            self._inbox.refuse(CommandResult(kind=self._name), reason, malformed=True)
            return
        result = CommandResult(kind=self._name, header=message.header)
        try:
            command = self._handler(message)
        except ParameterError as error:
            self._inbox.refuse(result, str(error))
        else:
            if command is not None:
                self._inbox.accept(command, result, arrival(information))

    def _on_lost(self, event: Any) -> None:
        self._overwritten = event.total_count
        self._count_discarded()

    def _count_discarded(self) -> None:
        """Count by gaps or by the middleware, whichever found more: each overlooks some."""
        found = max(self._gaps.missing, self._overwritten)
        if found > self._counted:
            self._inbox.discard(found - self._counted)
            self._counted = found


def arrival(information: Mapping[str, int]) -> int:
    """Return when the middleware received a message, on the monotonic clock [ns].

    The middleware notes the time of day, which may be set meanwhile. So a message counts as one
    that arrived within the last second; without a note as one that arrived now.
    """
    received = information["received_timestamp"]
    waited = time.time_ns() - received if received else 0
    return time.monotonic_ns() - min(max(waited, 0), SECOND)
