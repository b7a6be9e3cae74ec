"""Tables of the drill's topics, and of the channels: topics whose signal may fail."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

MOUNT_FRAME = "rpud_mount"
NODAL_PLANE_FRAME = "rpud_nodal_plane"
TOOL_TIP_FRAME = "rpud_tool_tip"


@dataclasses.dataclass(frozen=True)
class DrillTopic:
    """Topic of the drill; its publisher is reliable."""

    type: str  # type of its messages, as in ``rpud_msgs/msg/Status``
    depth: int  # messages that its publisher stores for slow subscribers
    # whether a late subscriber gets these messages (transient local)
    latched: bool = False
    frame: str = MOUNT_FRAME  # frame of the header; empty if there is no header
    complete: bool = True  # whether each message counts, not only the last
    proved: bool = True  # whether a bag's journal determines every bit of its messages
    live: bool = False  # whether only a running drill has it, not a simulation offline
    # sets of parameters, each of which switches on what it carries; empty if it is always
    # published
    models: tuple[tuple[str, ...], ...] = ()

    def is_offered(self, values: Mapping[str, Any]) -> bool:
        """Return whether a drill publishes it."""
        on = [all(values[name] not in ("", "none") for name in choice) for choice in self.models]
        return not on or any(on)


# Reliable publishers match reliable and best-effort subscribers. The depth allows a slow subscriber
# to fall behind by about a second at the greatest telemetry rate.
TOPICS: Mapping[str, DrillTopic] = {
    "actuator_state": DrillTopic("rpud_msgs/msg/ActuatorState", 1000, frame=NODAL_PLANE_FRAME),
    "borehole": DrillTopic(
        "rpud_msgs/msg/Borehole",
        1000,
        frame=TOOL_TIP_FRAME,
        models=(("strata",), ("rotation_model", "rock_model")),
    ),
    "contact_force": DrillTopic("rpud_msgs/msg/ContactForce", 2000, frame=TOOL_TIP_FRAME),
    "drill_tool": DrillTopic("rpud_msgs/msg/DrillTool", 1000, frame=TOOL_TIP_FRAME),
    "faults": DrillTopic("rpud_msgs/msg/Faults", 1, latched=True, complete=False),
    "joint_states": DrillTopic("sensor_msgs/msg/JointState", 1000),
    # A recorder that starts late gets all entries up to this number.
    "journal": DrillTopic("rpud_msgs/msg/JournalEntry", 1000, latched=True, proved=False),
    "mount": DrillTopic("rpud_msgs/msg/Mount", 1000, models=(("feed_model",),)),
    "nodal_plane": DrillTopic("rpud_msgs/msg/NodalPlane", 1000, frame=NODAL_PLANE_FRAME),
    "power": DrillTopic("rpud_msgs/msg/Power", 1, latched=True, complete=False, proved=False),
    "reacting_force": DrillTopic("rpud_msgs/msg/ReactingForce", 1000),
    "rotation": DrillTopic(
        "rpud_msgs/msg/Rotation", 1000, frame=TOOL_TIP_FRAME, models=(("rotation_model",),)
    ),
    "status": DrillTopic("rpud_msgs/msg/Status", 1, latched=True, complete=False, proved=False),
    "timing": DrillTopic(
        *("rpud_msgs/msg/Timing", 1), latched=True, complete=False, proved=False, live=True
    ),
    "trajectory": DrillTopic("rpud_msgs/msg/Trajectory", 40),
    "waveform": DrillTopic("rpud_msgs/msg/Waveform", 40),
    "wrench": DrillTopic("geometry_msgs/msg/WrenchStamped", 1000),
}
# Topics of commands, and the types of their messages.
COMMAND_TOPICS: Mapping[str, str] = {
    "command/weight_on_bit": "rpud_msgs/msg/WeightOnBit",
    "command/drive": "rpud_msgs/msg/Drive",
    "command/feed": "rpud_msgs/msg/Feed",
    "command/mount": "rpud_msgs/msg/MountMotion",
}
# Commands to the feed as ros2_control gives them.
JOINT_COMMANDS = "joint_commands"
ALL_COMMAND_TOPICS = {**COMMAND_TOPICS, JOINT_COMMANDS: "sensor_msgs/msg/JointState"}
# Topics whose every bit a proof compares.
PROVED = tuple(name for name, topic in TOPICS.items() if topic.proved)


def offered_topics(values: Mapping[str, Any]) -> Mapping[str, DrillTopic]:
    """Return the topics that a drill publishes, by name."""
    return {name: topic for name, topic in TOPICS.items() if topic.is_offered(values)}


# Names that lead to a field of a message.
FieldPath = tuple[str, ...]

# Tests compare with these, the ground truth: no signal fault may change them.
GROUND_TRUTH = ("waveform", "trajectory", "borehole")


@dataclasses.dataclass(frozen=True)
class Channel:
    """Measured fields of a topic, by their paths in the message.

    Stamps, frames, sequence numbers and counts are not measurements: no fault changes them.
    """

    unit: str  # SI unit of the main quantity, on which noise and bias act
    scale: float  # a disturbance of the main quantity that mission software notices, assumed [unit]
    numbers: tuple[FieldPath, ...]  # every measured number; the first is the main quantity
    flags: tuple[FieldPath, ...] = ()  # every measured truth value


def _channel(unit: str, scale: float, numbers: str, flags: str = "") -> Channel:
    paths = ([tuple(path.split(".")) for path in paths.split()] for paths in (numbers, flags))
    return Channel(unit, scale, *map(tuple, paths))


CHANNELS: Mapping[str, Channel] = {
    "nodal_plane": _channel("m", 1e-4, "position velocity"),
    "drill_tool": _channel("m", 1e-5, "displacement velocity", "in_contact"),
    "reacting_force": _channel("N", 1.0, "force"),
    "wrench": _channel(
        "N",
        1.0,
        "wrench.force.z wrench.force.x wrench.force.y "
        "wrench.torque.x wrench.torque.y wrench.torque.z",
    ),
    "contact_force": _channel(
        "N",
        1e3,
        "peak_force contact_duration impact_velocity impulse energy energy_transferred",
        "squeezed",
    ),
    "rotation": _channel("N m", 1e-2, "torque drive_torque angle rate", "stalled"),
    "mount": _channel("N", 1.0, "force weight_on_bit position feed rate slip", "in_contact"),
}
