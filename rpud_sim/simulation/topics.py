"""Table of the drill's topics: type, depth, durability and frame, for node, bags and checks."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

MOUNT_FRAME = "rpud_mount"
NODAL_PLANE_FRAME = "rpud_nodal_plane"
TOOL_TIP_FRAME = "rpud_tool_tip"


@dataclasses.dataclass(frozen=True)
class Topic:
    """Topic of the drill; its publisher is reliable."""

    type: str  # of its messages, as in ``rpud_msgs/msg/Status``
    depth: int  # messages that its publisher keeps for slow subscribers
    # whether a late subscriber gets the messages that are kept (transient local)
    latched: bool = False
    frame: str = MOUNT_FRAME  # of the header; empty if there is no header
    complete: bool = True  # whether each message counts, not only the last
    proved: bool = True  # whether a bag's journal determines every bit of its messages
    # sets of parameters, each of which switches on what it carries; empty if it is always
    # published
    models: tuple[tuple[str, ...], ...] = ()

    def is_offered(self, values: Mapping[str, Any]) -> bool:
        """Return whether a drill publishes it."""
        on = [all(values[name] not in ("", "none") for name in choice) for choice in self.models]
        return not on or any(on)


# Reliable publishers match reliable and best-effort subscribers. The depth allows a slow subscriber
# to fall behind by about a second at the greatest telemetry rate.
TOPICS: Mapping[str, Topic] = {
    "actuator_state": Topic("rpud_msgs/msg/ActuatorState", 1000, frame=NODAL_PLANE_FRAME),
    "borehole": Topic(
        "rpud_msgs/msg/Borehole",
        1000,
        frame=TOOL_TIP_FRAME,
        models=(("strata",), ("rotation_model", "rock_model")),
    ),
    "contact_force": Topic("rpud_msgs/msg/ContactForce", 2000, frame=TOOL_TIP_FRAME),
    "drill_tool": Topic("rpud_msgs/msg/DrillTool", 1000, frame=TOOL_TIP_FRAME),
    "faults": Topic("rpud_msgs/msg/Faults", 1, latched=True, complete=False),
    "joint_states": Topic("sensor_msgs/msg/JointState", 1000),
    # A recorder that starts late gets all entries up to this number.
    "journal": Topic("rpud_msgs/msg/JournalEntry", 1000, latched=True, proved=False),
    "mount": Topic("rpud_msgs/msg/Mount", 1000, models=(("feed_model",),)),
    "nodal_plane": Topic("rpud_msgs/msg/NodalPlane", 1000, frame=NODAL_PLANE_FRAME),
    "reacting_force": Topic("rpud_msgs/msg/ReactingForce", 1000),
    "rotation": Topic(
        "rpud_msgs/msg/Rotation", 1000, frame=TOOL_TIP_FRAME, models=(("rotation_model",),)
    ),
    "status": Topic("rpud_msgs/msg/Status", 1, latched=True, complete=False, proved=False),
    "trajectory": Topic("rpud_msgs/msg/Trajectory", 40),
    "waveform": Topic("rpud_msgs/msg/Waveform", 40),
    "wrench": Topic("geometry_msgs/msg/WrenchStamped", 1000),
}
# Topics whose every bit a proof compares.
PROVED = tuple(name for name, topic in TOPICS.items() if topic.proved)


def offered_topics(values: Mapping[str, Any]) -> Mapping[str, Topic]:
    """Return the topics that a drill publishes, by name."""
    return {name: topic for name, topic in TOPICS.items() if topic.is_offered(values)}
