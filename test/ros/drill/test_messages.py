"""Messages say what the fields say: right types, exact stamps, a trajectory that rebuilds."""

import array
import dataclasses
import math

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from geometry_msgs.msg import WrenchStamped
from rclpy.serialization import deserialize_message, serialize_message
from rpud_msgs.msg import (
    ContactForce,
    DrillTool,
    NodalPlane,
    ReactingForce,
    Status,
    Trajectory,
    Waveform,
)
from rpud_msgs.msg import Fault as FaultMessage
from rpud_msgs.msg import Faults as FaultsMessage
from sensor_msgs.msg import JointState
from support import trajectory_messages
from trajectories import arrays_of

from rpud_sim.bag.encoder import Encoder
from rpud_sim.drilling.rock import RockParameters
from rpud_sim.model.segment import CONSTANTS, SEGMENT
from rpud_sim.ros.drill import publishers
from rpud_sim.ros.drill.publishers import filled
from rpud_sim.ros.drill.services import message_to_fault
from rpud_sim.ros.graph import members_of
from rpud_sim.simulation import fields, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError, FaultLedger
from rpud_sim.simulation.sampling import Samples
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.telemetry import row_of

SANDSTONE = RockParameters(rock_model="specific_energy")
SECOND = 1_000_000_000
ORIGIN = 1_795_251_166_866_606_964
RATE = 50_000
STAMPS = ORIGIN + np.array([0, 7])


def nanoseconds(time):
    return time.sec * SECOND + time.nanosec


@pytest.fixture(scope="module", params=["free", "drilling"])
def block(request):
    """A tenth of a second with every kind of contact, after a command to settle."""
    simulation = Simulation(preset(request.param))
    simulation.advance_to(SECOND)
    simulation.apply(WeightOnBit(20.0))
    simulation.apply(Drive(True, 60.0, 17000.0))
    return simulation.advance_to(SECOND + SECOND // 10)


def numbered_samples():
    """Give samples that are all different from each other."""
    names = [field.name for field in dataclasses.fields(Samples)]
    values = {name: np.array([0.5, number + 0.25]) for number, name in enumerate(names)}
    return Samples(**values | {"in_contact": np.array([False, True])})


def trajectories(block, sequence, origin):
    return [
        filled(Trajectory(), values)
        for values in trajectory_messages(block.segments, sequence, origin)
    ]


@pytest.mark.parametrize(
    ("kind", "topic", "frame", "channels"),
    [
        (
            NodalPlane,
            "nodal_plane",
            "rpud_nodal_plane",
            {"position": "nodal_plane_position", "velocity": "nodal_plane_velocity"},
        ),
        (
            DrillTool,
            "drill_tool",
            "rpud_tool_tip",
            {
                "displacement": "drill_tool_displacement",
                "velocity": "drill_tool_velocity",
                "in_contact": "in_contact",
            },
        ),
        (
            ReactingForce,
            "reacting_force",
            "rpud_mount",
            {"force": "reacting_force"},
        ),
    ],
)
def test_a_sample_is_said_field_by_field(kind, topic, frame, channels):
    samples = numbered_samples()
    message = filled(kind(), row_of(fields.sampled_fields(topic, samples, STAMPS), 1))
    assert nanoseconds(message.header.stamp) == ORIGIN + 7
    assert message.header.frame_id == frame
    said = set(message.get_fields_and_field_types()) - {"header"}
    assert said == channels.keys()
    for field, channel in channels.items():
        assert getattr(message, field) == getattr(samples, channel)[1], field
        assert type(getattr(message, field)) in (float, bool)
    serialize_message(message)


def test_the_wrench_is_what_the_mount_feels():
    values = fields.wrench_fields(numbered_samples(), STAMPS)
    message = filled(WrenchStamped(), row_of(values, 1))
    force = numbered_samples().reacting_force[1]
    assert isinstance(message, WrenchStamped)
    assert message.header.frame_id == "rpud_mount"
    assert nanoseconds(message.header.stamp) == ORIGIN + 7
    assert (message.wrench.force.x, message.wrench.force.y) == (0.0, 0.0)
    assert message.wrench.force.z == -force
    torque = message.wrench.torque
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


def test_the_state_of_the_joints_is_that_of_the_bodies():
    samples = numbered_samples()
    message = filled(JointState(), row_of(fields.joint_state_fields(samples, STAMPS), 1))
    assert nanoseconds(message.header.stamp) == ORIGIN + 7
    assert message.header.frame_id == "rpud_mount"
    assert dict(zip(message.name, message.position, strict=True)) == {
        "rpud_nodal_plane_joint": samples.nodal_plane_position[1],
        "rpud_free_mass_joint": samples.free_mass_position[1],
        "rpud_tool_tip_joint": samples.drill_tool_displacement[1],
    }
    assert message.velocity.tolist() == [
        samples.nodal_plane_velocity[1],
        samples.free_mass_velocity[1],
        samples.drill_tool_velocity[1],
    ]
    wrench = filled(WrenchStamped(), row_of(fields.wrench_fields(samples, STAMPS), 1)).wrench
    assert message.effort.tolist() == [-wrench.force.z, 0.0, 0.0]
    assert deserialize_message(serialize_message(message), JointState) == message


def test_an_impact_is_said_field_by_field(block):
    columns = fields.contact_force_fields(block.impacts, ORIGIN)
    for number, impact in enumerate(block.impacts):
        message = filled(ContactForce(), row_of(columns, number))
        for field in set(message.get_fields_and_field_types()) - {"header"}:
            assert getattr(message, field) == impact[field], field
        assert type(message.sequence) is int
        assert message.header.frame_id == "rpud_tool_tip"
        exact = int(impact["seconds"]) * SECOND + impact["fraction"] * 1e9
        assert abs(nanoseconds(message.header.stamp) - ORIGIN - exact) <= 0.5


def test_the_stamp_of_an_impact_just_before_a_whole_second_is_valid(block):
    impact = block.impacts[:1].copy()
    impact["seconds"], impact["fraction"] = 4, 1.0 - 1e-12
    stamp = filled(ContactForce(), row_of(fields.contact_force_fields(impact, 0), 0)).header.stamp
    assert (stamp.sec, stamp.nanosec) == (5, 0)


@pytest.mark.parametrize("time", [0, 1, SECOND - 1, SECOND, ORIGIN])
def test_times_are_exact(time):
    message = publishers.nanoseconds_to_time(time)
    assert nanoseconds(message) == time
    assert 0 <= message.nanosec < SECOND


def test_a_waveform_is_the_samples():
    samples = numbered_samples()
    values = fields.waveform_fields(samples, np.array([12, 14]), RATE, ORIGIN)
    message = filled(Waveform(), row_of(values, 0))
    assert nanoseconds(message.header.stamp) == ORIGIN + 12 * SECOND // RATE
    assert message.sequence == 12
    assert message.sample_period == 1.0 / RATE
    channels = set(message.get_fields_and_field_types()) - {"header", "sequence", "sample_period"}
    assert len(channels) == 6
    for name in channels:
        assert getattr(message, name).tolist() == getattr(samples, name).tolist(), name
        assert isinstance(getattr(message, name), array.array)


def test_a_trajectory_has_every_field_of_every_segment(block):
    (message,) = trajectories(block, 5, ORIGIN)
    assert message.sequence == 5
    assert nanoseconds(message.origin) == ORIGIN
    first = block.segments[0]
    start = int(first["start_seconds"]) * SECOND + round(first["start_fraction"] * SECOND)
    assert nanoseconds(message.header.stamp) == ORIGIN + start
    arrays = {
        name
        for name, kind in message.get_fields_and_field_types().items()
        if kind.startswith("sequence")
    }
    assert arrays == set(SEGMENT.names) - set(CONSTANTS)
    for name in arrays:
        assert getattr(message, name).tolist() == block.segments[name].tolist(), name
    for name in CONSTANTS:
        assert getattr(message, name) == block.segments[name][0], name


def test_a_trajectory_is_cut_where_constants_change(block):
    covering = block.covering.copy()
    covering["free_mass"][3:] = 7e-3
    covering["gravity"][:10], covering["gravity"][10:] = 9.81, 1.62
    changed = dataclasses.replace(block, covering=covering)
    found = trajectories(changed, 5, ORIGIN)
    assert [message.sequence for message in found] == [5, 8, 15]
    assert [message.free_mass for message in found] == [5e-3, 7e-3, 7e-3]
    assert [message.gravity for message in found] == [9.81, 9.81, 1.62]
    for name, values in arrays_of(found).items():
        assert values.tolist() == changed.segments[name].tolist(), name
    for message in found:
        first = message.start_seconds[0] * SECOND + message.start_fraction[0] * 1e9
        assert abs(nanoseconds(message.header.stamp) - ORIGIN - first) <= 0.5


def test_constants_of_contacts_and_events_are_those_of_the_model(block):
    from rpud_sim.model import segment

    for name in ("CONTACT_ACTUATOR", "CONTACT_DRILL_TOOL"):
        assert getattr(Trajectory, name) == getattr(segment, name)
    for name in ("ACTUATOR_IMPACT", "DRILL_TOOL_IMPACT", "RELEASE", "COMMAND", "LIMIT"):
        assert getattr(Trajectory, f"EVENT_{name}") == getattr(segment, f"EVENT_{name}")
    assert Trajectory.CONTACT_BOTH == Trajectory.CONTACT_ACTUATOR | Trajectory.CONTACT_DRILL_TOOL


@pytest.mark.parametrize("time", [0, 1, SECOND - 1, ORIGIN])
def test_the_stamp_of_a_message_s_fields_is_its_time(time):
    assert fields.stamp_of({"header": fields.header_fields("reacting_force", time)}) == time


def test_the_status_says_how_the_drill_is():
    simulation = Simulation(
        Configuration(actuator=ActuatorParameters(actuator_model="resonance"), rock=SANDSTONE)
    )
    simulation.advance_to(SECOND)
    simulation.inject(Fault("lost_preload"))
    status = filled(Status(), fields.status_fields(simulation, 0, "running", fields.Bookkeeping()))
    assert status.impacts == simulation.impact_count > 50
    assert status.vibration_amplitude == simulation.actuator.amplitude > 0.0
    assert status.resonance_frequency == 16000.0
    assert status.actuator_temperature == 293.15
    # Without load it draws 50 W; blows take from the amplitude, and so from the current.
    assert status.electrical_power == simulation.actuator.electrical_power
    assert 1.0 < status.electrical_power < 50.0
    assert status.depth == simulation.depth > 0.0
    assert status.penetration_rate == simulation.penetration_rate > 0.0
    assert status.active_faults == 1


def test_what_the_drill_does_not_have_is_not_a_number():
    status = filled(
        Status(),
        fields.status_fields(Simulation(preset("drilling")), 0, "running", fields.Bookkeeping()),
    )
    assert math.isnan(status.electrical_power)
    assert math.isnan(status.depth)
    assert math.isnan(status.penetration_rate)


def test_the_ledger_is_said_record_by_record():
    ledger = FaultLedger()
    ledger.inject(3, Fault("bias", "wrench", 2.5))
    ledger.inject(5, Fault("free_mass_jammed"))
    ledger.clear(SECOND + 4, 1)
    values = fields.faults_fields(ledger, 2 * SECOND, ORIGIN)
    message = deserialize_message(Encoder(members_of(FaultsMessage)).encode(values), FaultsMessage)
    assert nanoseconds(message.header.stamp) == ORIGIN + 2 * SECOND
    assert message.header.frame_id == "rpud_mount"
    assert message.forgotten == 0
    over, lasting = message.faults
    assert (over.number, over.kind, over.channel, over.magnitude) == (1, "bias", "wrench", 2.5)
    assert (lasting.number, lasting.kind, lasting.channel) == (2, "free_mass_jammed", "")
    assert (over.active, lasting.active) == (False, True)
    assert [nanoseconds(fault.onset) - ORIGIN for fault in message.faults] == [3, 5]
    assert nanoseconds(over.clear) == ORIGIN + SECOND + 4
    assert lasting.clear == Time()
    assert filled(FaultMessage(), fields.fault_fields(ledger.active[0], ORIGIN)) == lasting


@pytest.mark.parametrize("kind", KINDS)
def test_an_empty_fault_is_the_default_unless_zero_is_a_magnitude(kind):
    channel = "" if KINDS[kind].physical else "wrench"
    asked = message_to_fault(FaultMessage(kind=kind, channel=channel))
    if kind in ("restitution_loss", "wrong"):
        assert asked == Fault(kind, channel, 0.0) != Fault(kind, channel)
    else:
        assert asked == Fault(kind, channel)
    default = FaultMessage(kind=kind, channel=channel, magnitude=math.nan)
    assert message_to_fault(default) == Fault(kind, channel)


def test_a_magnitude_is_taken_at_its_word():
    asked = FaultMessage(kind="bias", channel="wrench", magnitude=-2.0)
    assert message_to_fault(asked) == Fault("bias", "wrench", -2.0)
    for kind, magnitude in (("rusty", 0.0), ("choking", 2.0), ("choking", math.inf)):
        with pytest.raises(FaultError):
            message_to_fault(FaultMessage(kind=kind, magnitude=magnitude))
