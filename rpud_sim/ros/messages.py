"""From records of the simulation to ROS messages, by the table of ``rpud_sim.simulation.fields``.

Stamps and origins, the stamp of simulation time zero, are integer nanoseconds.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TypeVar

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    NodalPlane,
    ReactingForce,
    Trajectory,
    Waveform,
)
from sensor_msgs.msg import JointState

from rpud_sim.simulation import fields
from rpud_sim.simulation.sampling import Samples
from rpud_sim.simulation.simulation import Block

Message = TypeVar("Message")


def filled(message: Message, values: fields.Fields) -> Message:
    """Set the message's fields, and those of the messages in it, and return it."""
    for name, value in values.items():
        if isinstance(value, dict):
            filled(getattr(message, name), value)
        else:
            setattr(message, name, value)
    return message


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    return filled(Time(), fields.time_fields(nanoseconds))


def samples_to_nodal_plane(samples: Samples, index: int, stamp: int) -> NodalPlane:
    """Convert one sample."""
    return filled(NodalPlane(), fields.nodal_plane_fields(samples, index, stamp))


def samples_to_drill_tool(samples: Samples, index: int, stamp: int) -> DrillTool:
    """Convert one sample."""
    return filled(DrillTool(), fields.drill_tool_fields(samples, index, stamp))


def samples_to_reacting_force(samples: Samples, index: int, stamp: int) -> ReactingForce:
    """Convert one sample."""
    return filled(ReactingForce(), fields.reacting_force_fields(samples, index, stamp))


def samples_to_wrench(samples: Samples, index: int, stamp: int) -> WrenchStamped:
    """Convert one sample to what a wrist sensor between mount and drill reads."""
    return filled(WrenchStamped(), fields.wrench_fields(samples, index, stamp))


def samples_to_joint_state(samples: Samples, index: int, stamp: int) -> JointState:
    """Convert one sample to the state of the joints of the URDF."""
    return filled(JointState(), fields.joint_state_fields(samples, index, stamp))


def impact_to_contact_force(impact: np.void, origin: int) -> ContactForce:
    """Convert one ``IMPACT`` record."""
    return filled(ContactForce(), fields.contact_force_fields(impact, origin))


def samples_to_waveform(samples: Samples, stamp: int, sequence: int, sample_rate: int) -> Waveform:
    """Convert all samples to a block; stamp and number are the first one's, the rate is in Hz."""
    return filled(Waveform(), fields.waveform_fields(samples, stamp, sequence, sample_rate))


def segments_to_trajectories(block: Block, sequence: int, origin: int) -> Iterator[Trajectory]:
    """Convert a block's ``SEGMENT`` records, whose first has this number, by sets of constants."""
    for values in fields.trajectory_fields(block, sequence, origin):
        yield filled(Trajectory(), values)
