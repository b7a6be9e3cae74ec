"""Fields of every published message, as plain values by name.

This is the one table from the simulation's records to the messages of ``msg_defs``: the node fills
ROS messages from it, and bags are encoded from it. Messages are dictionaries, sequences
``array.array``, stamps integer nanoseconds; an origin is the stamp of simulation time zero.

What a drill samples comes as columns of many messages: an array instead of each value that differs
from message to message. A sequence is an array with a row for each message, or ``Sequences`` if its
length differs. One message is a row of such columns (``Batch.row``).
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import groupby
from operator import attrgetter
from typing import Any

import numpy as np

from rpud_sim.drilling.mount import FEED_MODES, Feed, MountMotion
from rpud_sim.drilling.process import ProcessState
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Sequences
from rpud_sim.messages.batch import Fields
from rpud_sim.model.segment import CONSTANTS, IMPACT, SEGMENT
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.faults import FaultLedger, FaultRecord
from rpud_sim.simulation.plan import JournalEntry
from rpud_sim.simulation.sampling import SEGMENT_ARRAYS, Samples
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import TOPICS

# Joints of urdf/rpud.urdf, each of which moves one body along the drill axis: channels of its
# position, velocity and effort; None for zero.
_SAMPLED_JOINTS: Mapping[str, tuple[str | None, ...]] = {
    "rpud_nodal_plane_joint": ("nodal_plane_position", "nodal_plane_velocity", "reacting_force"),
    "rpud_free_mass_joint": ("free_mass_position", "free_mass_velocity", None),
    "rpud_tool_tip_joint": ("drill_tool_displacement", "drill_tool_velocity", None),
}
JOINTS = tuple(_SAMPLED_JOINTS)

# Place of the constants among the numbers of a segment, which are all of one size.
_SEGMENT_FIELDS: Any = SEGMENT.fields
_CONSTANTS = [_SEGMENT_FIELDS[name][1] // np.dtype(np.float64).itemsize for name in CONSTANTS]


def time_fields(nanoseconds: Any) -> Fields:
    """Fields of ``builtin_interfaces/Time``, or columns."""
    seconds, rest = divmod(nanoseconds, SECOND)
    return {"sec": seconds, "nanosec": rest}


def header_fields(topic: str, stamp: Any) -> Fields:
    """Fields of ``std_msgs/Header`` on a topic, or columns, in the frame of ``TOPICS``."""
    return {"stamp": time_fields(stamp), "frame_id": TOPICS[topic].frame}


def prefixed(fields: Fields, prefix: str) -> Fields:
    """Fields of a message of ``TOPICS`` whose frame and joints begin with a prefix, or columns."""
    if not prefix:
        return fields
    header = fields["header"]
    named: Fields = {"header": {**header, "frame_id": prefix + header["frame_id"]}}
    if "name" in fields:
        named["name"] = [prefix + joint for joint in fields["name"]]
    return {**fields, **named}


def stamp_of(fields: Fields) -> Any:
    """Stamp in the header of a message [ns], or of columns."""
    stamp = fields["header"]["stamp"]
    return stamp["sec"] * SECOND + stamp["nanosec"]


# Topics that hold samples and the number of impacts: the channel of each sampled field.
SAMPLED: Mapping[str, Mapping[str, str]] = {
    "nodal_plane": {"position": "nodal_plane_position", "velocity": "nodal_plane_velocity"},
    "drill_tool": {
        "displacement": "drill_tool_displacement",
        "velocity": "drill_tool_velocity",
        "in_contact": "in_contact",
    },
    "reacting_force": {"force": "reacting_force"},
}


def sampled_fields(topic: str, samples: Samples, impacts: np.ndarray, stamps: np.ndarray) -> Fields:
    """Columns of a topic of ``SAMPLED``; ``impacts`` ended up to each stamp since time zero."""
    channels = SAMPLED[topic].items()
    values = {name: getattr(samples, channel) for name, channel in channels}
    return {"header": header_fields(topic, stamps), **values, "impacts": impacts}


# Joints of urdf/rpud_feed.urdf.
FEED_JOINT = "rpud_feed"
ROTATION_JOINT = "rpud_rotation"
_PROCESS_JOINTS = (
    (ROTATION_JOINT, "rotation", ("angle", "rate", "drive_torque")),
    (FEED_JOINT, "mount", ("feed", "rate", "force")),
)
# Fields of topics of the slow processes: attributes of the part of the state of the same name.
_PROCESS_FIELDS: Mapping[str, tuple[str, ...]] = {
    "rotation": ("angle", "rate", "torque", "drive_torque", "stalled"),
    "mount": (
        *("position", "feed", "rate", "force", "weight_on_bit", "in_contact", "slip"),
        *("stiffness", "damping"),
    ),
    "borehole": (
        *("depth", "penetration_rate", "layer", "specific_energy", "packed_cuttings"),
        *("bit_wear", "side_offset"),
    ),
}
PROCESS_TOPICS = tuple(_PROCESS_FIELDS)
_READING = (
    *("voltage", "current", "phase", "impedance", "frequency", "resonance_frequency", "amplitude"),
    *("electrical_power", "electrical_energy", "mechanical_work", "temperature"),
)
_VALUES = {
    topic: attrgetter(*names)
    for topic, names in (*_PROCESS_FIELDS.items(), ("actuator_state", _READING))
}

States = Sequence[ProcessState]


def has_part(states: States, topic: str) -> bool:
    return bool(states) and getattr(states[0], topic) is not None


def _parts(states: States, topic: str, name: str) -> np.ndarray:
    return np.array([getattr(getattr(state, topic), name) for state in states])


def process_fields(
    topic: str, states: States, stamps: np.ndarray
) -> Iterator[tuple[slice, Fields]]:
    """Yield columns of a topic of ``PROCESS_TOPICS``, and which of the states they are of.

    All messages of columns have the same texts, so each layer has separate columns.
    """
    rows = [_VALUES[topic](getattr(state, topic)) for state in states]
    first = 0
    for _, group in groupby(rows, key=lambda row: [each for each in row if isinstance(each, str)]):
        columns = list(zip(*group, strict=True))
        among = slice(first, first + len(columns[0]))
        fields = {
            name: values[0] if isinstance(values[0], str) else np.array(values)
            for name, values in zip(_PROCESS_FIELDS[topic], columns, strict=True)
        }
        yield among, {"header": header_fields(topic, stamps[among]), **fields}
        first = among.stop


def actuator_state_fields(
    readings: Sequence[ActuatorReading], mechanical_powers: np.ndarray, stamps: np.ndarray
) -> Fields:
    """Columns of ``rpud_msgs/ActuatorState``; the powers are those since the reading before [W]."""
    values, first = _VALUES["actuator_state"], readings[0]
    if all(reading is first for reading in readings):
        columns: Iterable[Any] = values(first)
    else:
        columns = np.array([values(reading) for reading in readings]).T
    return {
        "header": header_fields("actuator_state", stamps),
        **dict(zip(_READING, columns, strict=True)),
        "mechanical_power": mechanical_powers,
    }


def wrench_fields(samples: Samples, stamps: np.ndarray, states: States = ()) -> Fields:
    """Columns of ``geometry_msgs/WrenchStamped`` as a wrist sensor at the mount gives them.

    The z axis of the mount's frame points along the drill toward the rock. The drill pushes the
    mount back by the reacting force, and the mount takes the torque of the drive the other way
    round.
    """
    torques: Any = 0.0
    if has_part(states, "rotation"):
        torques = 0.0 - _parts(states, "rotation", "drive_torque")  # no negative zero
    return {
        "header": header_fields("wrench", stamps),
        "wrench": {
            "force": {"x": 0.0, "y": 0.0, "z": -samples.reacting_force},
            "torque": {"x": 0.0, "y": 0.0, "z": torques},
        },
    }


def joint_state_fields(samples: Samples, stamps: np.ndarray, states: States = ()) -> Fields:
    """Columns of ``sensor_msgs/JointState`` for ``JOINTS``, then for rotation and feed.

    The effort is the force between mount and body, positive toward the rock: the reacting force on
    the nodal plane, and zero on free mass and drill tool, whose forces do not reach the mount in
    the model. The feed's joint is its drive, as an encoder shows it: the arm may yield beyond.
    Its effort is the force of the arm on the mount [N]. The effort of the rotation is the torque of
    the drive on the rotor [N m].
    """
    joints: dict[str, list[Any]] = {
        joint: [getattr(samples, channel) if channel else 0.0 for channel in channels]
        for joint, channels in _SAMPLED_JOINTS.items()
    }
    for joint, topic, names in _PROCESS_JOINTS:
        if has_part(states, topic):
            joints[joint] = [_parts(states, topic, name) for name in names]
    rows = np.empty((3, len(stamps), len(joints)))
    for number, columns in enumerate(joints.values()):
        for row, column in zip(rows, columns, strict=True):
            row[:, number] = column
    columns_of = dict(zip(("position", "velocity", "effort"), rows, strict=True))
    return {"header": header_fields("joint_states", stamps), "name": list(joints), **columns_of}


def contact_force_fields(impacts: np.ndarray, origin: int) -> Fields:
    """Columns of ``rpud_msgs/ContactForce`` for ``IMPACT`` records."""
    values: dict[str, Any] = {name: impacts[name] for name in IMPACT.names or ()}
    fraction = np.rint(values.pop("fraction") * SECOND).astype(np.int64)
    start = values.pop("seconds") * SECOND + fraction
    return {"header": header_fields("contact_force", origin + start), **values}


def waveform_fields(samples: Samples, cuts: np.ndarray, sample_rate: int, origin: int) -> Fields:
    """Columns of ``rpud_msgs/Waveform``, of at least one message.

    ``cuts`` are the number of the first sample of each since simulation time zero, and of all.
    """
    counts = np.diff(cuts)
    names = (
        *("nodal_plane_position", "actuator_position", "free_mass_position"),
        *("drill_tool_displacement", "contact_force", "reacting_force"),
    )
    channels: dict[str, Any] = {name: getattr(samples, name) for name in names}
    if (counts == counts[0]).all():
        channels = {name: each.reshape(len(counts), -1) for name, each in channels.items()}
    else:
        channels = {name: Sequences(each, cuts - cuts[0]) for name, each in channels.items()}
    # Python's numbers: 64 bits would overflow within days.
    starts = [cut * SECOND // sample_rate for cut in cuts[:-1].tolist()]
    return {
        "header": header_fields("waveform", origin + np.array(starts)),
        "sequence": cuts[:-1],
        "sample_period": 1.0 / sample_rate,
        **channels,
    }


def trajectory_cuts(segments: np.ndarray) -> np.ndarray:
    """Return the numbers of the segments whose constants differ from the segment before."""
    constants = segments.view(np.float64).reshape(len(segments), -1)[:, _CONSTANTS]
    return np.flatnonzero((constants[1:] != constants[:-1]).any(axis=1)) + 1


def trajectory_fields(segments: np.ndarray, cuts: np.ndarray, sequence: int, origin: int) -> Fields:
    """Columns of ``rpud_msgs/Trajectory`` for finished segments.

    ``cuts`` are the number of the first segment of each message, all with the same constants, and
    the number of all; ``sequence`` is the number of the first segment since the start.
    """
    first = segments[cuts[:-1]]
    starts = first["start_seconds"] * SECOND
    starts += np.rint(first["start_fraction"] * SECOND).astype(np.int64)
    return {
        "header": header_fields("trajectory", origin + starts),
        "sequence": sequence + cuts[:-1],
        "origin": time_fields(origin),
        **{name: first[name] for name in CONSTANTS},
        **{name: Sequences(segments[name], cuts) for name in SEGMENT_ARRAYS},
    }


@dataclasses.dataclass(frozen=True)
class CommandCounts:
    """Counts of commands as fields of ``rpud_msgs/Status``; without ROS there are none."""

    commands_accepted: int = 0
    commands_rejected: int = 0
    commands_discarded: int = 0
    commanders: int = 0


def status_fields(simulation: Simulation, origin: int, state: str, counts: CommandCounts) -> Fields:
    """Fields of ``rpud_msgs/Status`` that simulation and counts give."""
    applied, actuator = simulation.applied, simulation.actuator
    motion, since = applied.motion, applied.motion_time
    feed = motion if isinstance(motion, Feed) else None
    mount = motion if isinstance(motion, MountMotion) else None
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
        **{
            f"feed_{mode}": feed.value if feed and feed.mode == mode else math.nan
            for mode in FEED_MODES
        },
        "feed_applied": time_fields(origin + (since if feed else 0)),
        "mount_position": mount.position if mount else math.nan,
        "mount_velocity": mount.velocity if mount else math.nan,
        "mount_applied": time_fields(origin + (since if mount else 0)),
        "impacts": simulation.impact_count,
        "vibration_amplitude": actuator.amplitude,
        "resonance_frequency": actuator.resonance_frequency,
        "actuator_temperature": actuator.temperature,
        "electrical_power": actuator.electrical_power,
        "depth": simulation.depth,
        "penetration_rate": simulation.penetration_rate,
        "active_faults": len(simulation.faults.active),
        **dataclasses.asdict(counts),
    }


def fault_fields(record: FaultRecord, origin: int) -> Fields:
    return {
        "number": record.number,  # in the order of the definition, as columns show it
        **vars(record.fault),
        "active": record.clear is None,
        "onset": time_fields(origin + record.onset),
        "clear": time_fields(0 if record.clear is None else origin + record.clear),
    }


def faults_fields(ledger: FaultLedger, time: int, origin: int) -> Fields:
    return {
        "header": header_fields("faults", origin + time),
        "faults": [fault_fields(record, origin) for record in ledger.records],
        "forgotten": ledger.forgotten,
    }


def journal_fields(entry: JournalEntry, origin: int) -> Fields:
    return {
        "header": header_fields("journal", origin + entry.time),
        "sequence": entry.sequence,
        "kind": entry.kind,
        "content": entry.text,
    }
