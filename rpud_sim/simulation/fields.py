"""Fields of every published message, as plain values by name.

This is the one table from the simulation's records to the messages of ``msg_defs``: the node fills
ROS messages from it, and offline bags are encoded from it. Messages are dictionaries, sequences
``array.array``, stamps integer nanoseconds; an origin is the stamp of simulation time zero.

The same functions give many messages at once as columns: a stamp is then an array, and so is each
value that differs from message to message. A sequence is an array with a row for each message, or
``Ragged`` if its length differs.
"""

from __future__ import annotations

import dataclasses
import math
from array import array
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.drilling.feed import FEED_MODES
from rpud_sim.foundation.ragged import Ragged
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.segment import CONSTANTS, IMPACT, SEGMENT
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.journal import JournalEntry
from rpud_sim.simulation.ledger import FaultLedger, FaultRecord
from rpud_sim.simulation.sampling import Samples
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import TOPICS

Fields = dict[str, Any]

# Joints of urdf/rpud.urdf; each moves one body along the drill axis.
JOINTS = ("rpud_nodal_plane_joint", "rpud_free_mass_joint", "rpud_tool_tip_joint")

# Fields of a trajectory with a value for each segment; it holds the constants once.
SEGMENT_ARRAYS = tuple(name for name in SEGMENT.names or () if name not in CONSTANTS)

# Place of the constants among the numbers of a segment, which are all of one size.
_FIELDS: Any = SEGMENT.fields
_CONSTANTS = [_FIELDS[name][1] // np.dtype(np.float64).itemsize for name in CONSTANTS]

_TYPE_CODES = {np.dtype(np.int64): "q", np.dtype(np.float64): "d", np.dtype(np.uint8): "B"}


def time_fields(nanoseconds: Any) -> Fields:
    """Fields of ``builtin_interfaces/Time``, or columns."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return {"sec": seconds, "nanosec": rest}


def header_fields(topic: str, stamp: Any) -> Fields:
    """Fields of ``std_msgs/Header`` on a topic, or columns, in the frame of ``TOPICS``."""
    return {"stamp": time_fields(stamp), "frame_id": TOPICS[topic].frame}


def stamp_of(fields: Fields) -> Any:
    """Stamp in the header of a message [ns], or of columns."""
    stamp = fields["header"]["stamp"]
    return stamp["sec"] * SECOND + stamp["nanosec"]


def to_array(values: np.ndarray) -> array:
    """Return a copy of a NumPy array as the array type that message fields accept."""
    return array(_TYPE_CODES[values.dtype], np.ascontiguousarray(values).tobytes())


def _value(column: np.ndarray, index: int | None) -> Any:
    """Return one value of a column as a Python number, or the whole column."""
    return column if index is None else column.item(index)


def nodal_plane_fields(samples: Samples, index: int | None, stamp: Any) -> Fields:
    """Fields of ``rpud_msgs/NodalPlane`` for one sample, or columns for all."""
    return {
        "header": header_fields("nodal_plane", stamp),
        "position": _value(samples.nodal_plane_position, index),
        "velocity": _value(samples.nodal_plane_velocity, index),
    }


def actuator_state_fields(reading: ActuatorReading, mechanical_power: float, stamp: Any) -> Fields:
    """Fields of ``rpud_msgs/ActuatorState`` for one reading, or columns for the same at all stamps.

    Args:
        mechanical_power: since the reading before [W].
    """
    return {
        "header": header_fields("actuator_state", stamp),
        "voltage": reading.voltage,
        "current": reading.current,
        "phase": reading.phase,
        "impedance": reading.impedance,
        "frequency": reading.frequency,
        "resonance_frequency": reading.resonance_frequency,
        "amplitude": reading.amplitude,
        "electrical_power": reading.electrical_power,
        "mechanical_power": mechanical_power,
        "electrical_energy": reading.electrical_energy,
        "mechanical_work": reading.mechanical_work,
        "temperature": reading.temperature,
    }


def drill_tool_fields(samples: Samples, index: int | None, stamp: Any) -> Fields:
    """Fields of ``rpud_msgs/DrillTool`` for one sample, or columns for all."""
    return {
        "header": header_fields("drill_tool", stamp),
        "displacement": _value(samples.drill_tool_displacement, index),
        "velocity": _value(samples.drill_tool_velocity, index),
        "in_contact": _value(samples.in_contact, index),
    }


def reacting_force_fields(samples: Samples, index: int | None, stamp: Any) -> Fields:
    """Fields of ``rpud_msgs/ReactingForce`` for one sample, or columns for all."""
    return {
        "header": header_fields("reacting_force", stamp),
        "force": _value(samples.reacting_force, index),
    }


def wrench_fields(
    samples: Samples, index: int | None, stamp: Any, torques: np.ndarray | None = None
) -> Fields:
    """Fields of ``geometry_msgs/WrenchStamped`` as a wrist sensor at the mount gives one sample.

    Without an index they are columns for all samples.

    The z axis of the mount's frame points along the drill toward the rock; the drill pushes the
    mount back, so that the force along z is the negative reacting force.

    Args:
        torques: of the drill on the mount about z, one for each sample [N m]; None for zero.
    """
    force = -_value(samples.reacting_force, index)
    torque = 0.0 if torques is None else _value(torques, index)
    return {
        "header": header_fields("wrench", stamp),
        "wrench": {
            "force": {"x": 0.0, "y": 0.0, "z": force},
            "torque": {"x": 0.0, "y": 0.0, "z": torque},
        },
    }


class Joint(NamedTuple):
    """Joint of ``sensor_msgs/JointState``."""

    name: str  # in the URDF
    position: np.ndarray  # one for each sample [m] or [rad]
    velocity: np.ndarray  # [m/s] or [rad/s]
    effort: np.ndarray | None  # of the mount's side on the moved body [N] or [N m]; None for zero


def joint_state_fields(
    samples: Samples, index: int | None, stamp: Any, others: Sequence[Joint] = ()
) -> Fields:
    """Fields of ``sensor_msgs/JointState`` for one sample of the ``JOINTS`` of ``urdf/rpud.urdf``.

    Without an index they are columns for all samples. The effort is the force between mount and
    body, positive toward the rock: the reacting force on the nodal plane, and zero on free mass and
    drill tool, whose forces do not reach the mount in the model. The sum of these efforts is the
    negative force of the wrench.

    Args:
        others: joints that follow, with a value for each sample.
    """
    plane, mass, tool = JOINTS
    joints = (
        Joint(
            plane,
            samples.nodal_plane_position,
            samples.nodal_plane_velocity,
            samples.reacting_force,
        ),
        Joint(mass, samples.free_mass_position, samples.free_mass_velocity, None),
        Joint(tool, samples.drill_tool_displacement, samples.drill_tool_velocity, None),
        *others,
    )
    return {
        "header": header_fields("joint_states", stamp),
        "name": [joint.name for joint in joints],
        "position": _joints([joint.position for joint in joints], index),
        "velocity": _joints([joint.velocity for joint in joints], index),
        "effort": _joints([joint.effort for joint in joints], index),
    }


def _joints(columns: Sequence[np.ndarray | None], index: int | None) -> Any:
    """Return a value for each joint, or a row of them for each sample; None for zeros."""
    if index is not None:
        return array("d", [0.0 if each is None else each.item(index) for each in columns])
    count = next(len(each) for each in columns if each is not None)
    rows = np.zeros((count, len(columns)))
    for number, each in enumerate(columns):
        if each is not None:
            rows[:, number] = each
    return rows


def contact_force_fields(impact: Any, origin: int) -> Fields:
    """Fields of ``rpud_msgs/ContactForce`` for one ``IMPACT``, or columns for an array of them."""
    names = IMPACT.names or ()
    if isinstance(impact, np.ndarray):
        values: dict[str, Any] = {name: impact[name] for name in names}
        fraction: Any = np.rint(values.pop("fraction") * SECOND).astype(np.int64)
    else:
        # All at once: one by one they would take longer than the rest of the message.
        values = dict(zip(names, impact.item(), strict=True))
        fraction = round(values.pop("fraction") * SECOND)
    start = values.pop("seconds") * SECOND + fraction
    return {"header": header_fields("contact_force", origin + start), **values}


def waveform_fields(
    samples: Samples,
    stamp: Any,
    sequence: Any,
    sample_rate: int,
    convert: Callable[[np.ndarray], Any] = to_array,
) -> Fields:
    """Fields of ``rpud_msgs/Waveform``, or columns.

    Args:
        convert: makes a sequence of a channel; for columns, a row for each message.
    """
    return {
        "header": header_fields("waveform", stamp),
        "sequence": sequence,
        "sample_period": 1.0 / sample_rate,
        "nodal_plane_position": convert(samples.nodal_plane_position),
        "actuator_position": convert(samples.actuator_position),
        "free_mass_position": convert(samples.free_mass_position),
        "drill_tool_displacement": convert(samples.drill_tool_displacement),
        "contact_force": convert(samples.contact_force),
        "reacting_force": convert(samples.reacting_force),
    }


def trajectory_fields(segments: np.ndarray, sequence: int, origin: int) -> Iterator[Fields]:
    """Fields of ``rpud_msgs/Trajectory`` for finished segments: one message per set of constants.

    Args:
        sequence: number of the first segment since the start.
    """
    if not len(segments):
        return
    cuts = trajectory_cuts(segments)
    for first, end in pairwise([0, *cuts.tolist(), len(segments)]):
        part = segments[first:end]
        start = int(part["start_seconds"][0]) * SECOND
        start += round(float(part["start_fraction"][0]) * SECOND)
        yield {
            "header": header_fields("trajectory", origin + start),
            "sequence": sequence + first,
            "origin": time_fields(origin),
            **{name: float(part[name][0]) for name in CONSTANTS},
            **{name: to_array(part[name]) for name in SEGMENT_ARRAYS},
        }


def trajectory_cuts(segments: np.ndarray) -> np.ndarray:
    """Return the numbers of the segments whose constants differ from those of the one before."""
    constants = segments.view(np.float64).reshape(len(segments), -1)[:, _CONSTANTS]
    return np.flatnonzero((constants[1:] != constants[:-1]).any(axis=1)) + 1


def trajectory_columns(
    segments: np.ndarray, cuts: np.ndarray, sequence: int, origin: int
) -> Fields:
    """Columns of ``rpud_msgs/Trajectory``.

    Args:
        cuts: number of the first segment of each message, and of all.
    """
    first = segments[cuts[:-1]]
    starts = first["start_seconds"] * SECOND
    starts += np.rint(first["start_fraction"] * SECOND).astype(np.int64)
    return {
        "header": header_fields("trajectory", origin + starts),
        "sequence": sequence + cuts[:-1],
        "origin": time_fields(origin),
        **{name: first[name] for name in CONSTANTS},
        **{name: Ragged(segments[name], cuts) for name in SEGMENT_ARRAYS},
    }


@dataclasses.dataclass(frozen=True)
class Bookkeeping:
    """Counts and timing of a run, as fields of ``rpud_msgs/Status``.

    The defaults are those of a run without ROS: nothing is late, and there are no commands.
    """

    commands_accepted: int = 0
    commands_rejected: int = 0
    commands_discarded: int = 0
    commands_lost: bool = False
    commanders: int = 0
    deadlines_missed: int = 0
    messages_dropped: int = 0
    real_time_factor: float = 1.0
    lateness_max: float = 0.0
    lag: float = 0.0


def status_fields(
    simulation: Simulation, origin: int, state: str, bookkeeping: Bookkeeping
) -> Fields:
    """Fields of ``rpud_msgs/Status`` at the present time of a simulation.

    Args:
        bookkeeping: every other field, by its name.
    """
    applied = simulation.applied
    actuator = simulation.actuator
    return {
        "header": header_fields("status", origin + simulation.time),
        "state": state,
        "regime": simulation.parameters.regime,
        "weight_on_bit": simulation.weight_on_bit,
        "weight_on_bit_applied": time_fields(origin + applied.weight_on_bit_time),
        "drive_enabled": applied.drive.enabled,
        "drive_voltage": applied.drive.voltage,
        "drive_frequency": applied.drive.frequency,
        "drive_applied": time_fields(origin + applied.drive_time),
        "feed_mode": FEED_MODES.index(applied.feed.mode),
        "feed_value": applied.feed.value if simulation.configuration.has_feed else math.nan,
        "feed_applied": time_fields(origin + applied.feed_time),
        "impacts": simulation.impact_count,
        "vibration_amplitude": actuator.amplitude,
        "resonance_frequency": actuator.resonance_frequency,
        "actuator_temperature": actuator.temperature,
        "electrical_power": actuator.electrical_power,
        "depth": simulation.depth,
        "penetration_rate": simulation.penetration_rate,
        "active_faults": len(simulation.faults.active),
        **dataclasses.asdict(bookkeeping),
    }


def fault_fields(record: FaultRecord, origin: int) -> Fields:
    """Fields of ``rpud_msgs/Fault``; the origin is the stamp of simulation time zero."""
    over = record.clear is not None
    return {
        "number": record.number,
        "kind": record.fault.kind,
        "channel": record.fault.channel,
        "magnitude": record.fault.magnitude,
        "active": not over,
        "onset": time_fields(origin + record.onset),
        "clear": time_fields(origin + record.clear if record.clear is not None else 0),
    }


def journal_fields(entry: JournalEntry, origin: int) -> Fields:
    """Fields of ``rpud_msgs/JournalEntry``; the origin is the stamp of simulation time zero."""
    return {
        "header": header_fields("journal", origin + entry.time),
        "sequence": entry.sequence,
        "kind": entry.kind,
        "content": entry.text,
    }


def faults_fields(ledger: FaultLedger, time: int, origin: int) -> Fields:
    """Fields of ``rpud_msgs/Faults`` at a simulation time."""
    return {
        "header": header_fields("faults", origin + time),
        "faults": [fault_fields(record, origin) for record in ledger.records],
        "forgotten": ledger.forgotten,
    }
