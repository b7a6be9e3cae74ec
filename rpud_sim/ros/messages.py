"""From records of the simulation to ROS messages. Field names are the same on both sides."""

from __future__ import annotations

from array import array

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
from std_msgs.msg import Header

from rpud_sim.simulation import SEGMENT
from rpud_sim.simulation.sampling import NANOSECONDS, Samples
from rpud_sim.simulation.simulation import Block

MOUNT_FRAME = "rpud_mount"
NODAL_PLANE_FRAME = "rpud_nodal_plane"
TOOL_TIP_FRAME = "rpud_tool_tip"

_TYPE_CODES = {np.dtype(np.int64): "q", np.dtype(np.float64): "d", np.dtype(np.uint8): "B"}


def nanoseconds_to_time(nanoseconds: int) -> Time:
    """Convert integer nanoseconds to a ``builtin_interfaces/Time``."""
    seconds, rest = divmod(nanoseconds, NANOSECONDS)
    return Time(sec=seconds, nanosec=rest)


def to_header(nanoseconds: int, frame: str = "") -> Header:
    """Make a header from a stamp in integer nanoseconds and a frame."""
    return Header(stamp=nanoseconds_to_time(nanoseconds), frame_id=frame)


def to_array(values: np.ndarray) -> array:
    """Convert a NumPy array to the array type that a message field takes whole."""
    return array(_TYPE_CODES[values.dtype], np.ascontiguousarray(values).tobytes())


def samples_to_nodal_plane(samples: Samples, index: int, stamp: int) -> NodalPlane:
    """Convert one sample; the stamp is in nanoseconds."""
    return NodalPlane(
        header=to_header(stamp, NODAL_PLANE_FRAME),
        position=float(samples.nodal_plane_position[index]),
        velocity=float(samples.nodal_plane_velocity[index]),
    )


def samples_to_drill_tool(samples: Samples, index: int, stamp: int) -> DrillTool:
    """Convert one sample; the stamp is in nanoseconds."""
    return DrillTool(
        header=to_header(stamp, TOOL_TIP_FRAME),
        displacement=float(samples.drill_tool_displacement[index]),
        velocity=float(samples.drill_tool_velocity[index]),
        in_contact=bool(samples.in_contact[index]),
    )


def samples_to_reacting_force(samples: Samples, index: int, stamp: int) -> ReactingForce:
    """Convert one sample; the stamp is in nanoseconds."""
    return ReactingForce(
        header=to_header(stamp, MOUNT_FRAME), force=float(samples.reacting_force[index])
    )


def samples_to_wrench(samples: Samples, index: int, stamp: int) -> WrenchStamped:
    """Convert one sample to what a wrist sensor between mount and drill reads; stamp in ns.

    The z axis of the mount's frame points along the drill toward the rock; the drill pushes the
    mount back, so that the force along z is the negative reacting force.
    """
    wrench = WrenchStamped(header=to_header(stamp, MOUNT_FRAME))
    wrench.wrench.force.z = -float(samples.reacting_force[index])
    return wrench


def impact_to_contact_force(impact: np.void, origin: int) -> ContactForce:
    """Convert one ``IMPACT`` record; the origin is the stamp of simulation time zero [ns]."""
    stamp = origin + int(impact["seconds"]) * NANOSECONDS
    return ContactForce(
        header=to_header(stamp + round(float(impact["fraction"]) * NANOSECONDS), TOOL_TIP_FRAME),
        sequence=int(impact["sequence"]),
        peak_force=float(impact["peak_force"]),
        contact_duration=float(impact["contact_duration"]),
        impact_velocity=float(impact["impact_velocity"]),
        impulse=float(impact["impulse"]),
        energy=float(impact["energy"]),
    )


def samples_to_waveform(samples: Samples, stamp: int, sequence: int, sample_rate: int) -> Waveform:
    """Convert all samples to one block; stamp of the first in nanoseconds, rate in Hz."""
    return Waveform(
        header=to_header(stamp),
        sequence=sequence,
        sample_period=1.0 / sample_rate,
        nodal_plane_position=to_array(samples.nodal_plane_position),
        actuator_position=to_array(samples.actuator_position),
        free_mass_position=to_array(samples.free_mass_position),
        drill_tool_displacement=to_array(samples.drill_tool_displacement),
        contact_force=to_array(samples.contact_force),
        reacting_force=to_array(samples.reacting_force),
    )


def segments_to_trajectory(block: Block, sequence: int, origin: int) -> Trajectory:
    """Convert a block's segments, at least one; the origin stamps simulation time zero [ns]."""
    drill = block.drill
    first = block.segments[0]
    start = int(first["start_seconds"]) * NANOSECONDS + round(
        float(first["start_fraction"]) * NANOSECONDS
    )
    message = Trajectory(
        header=to_header(origin + start),
        sequence=sequence,
        origin=nanoseconds_to_time(origin),
        load_spring_rate=drill.load_spring_rate,
        load_spring_damping=drill.rpud_damping,
        free_mass=drill.free_mass,
        drill_tool_mass=drill.tool_mass,
        drill_tool_spring_rate=drill.tool_spring_rate,
        drill_tool_damping=drill.tool_damping,
        gravity=drill.gravity,
    )
    for name in SEGMENT.names or ():
        setattr(message, name, to_array(block.segments[name]))
    return message
