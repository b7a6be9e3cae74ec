"""Commands to joints, as ``joint_state_topic_hardware_interface`` of ros2_control sends them."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sensor_msgs.msg import JointState

from rpud_sim.drilling.mount import POSITION, RATE
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.commands import Feed
from rpud_sim.simulation.fields import FEED_JOINT, JOINTS, ROTATION_JOINT

_PASSIVE = (*JOINTS, ROTATION_JOINT)


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
