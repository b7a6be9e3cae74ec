"""Messages say what the simulation says: right types, exact stamps, a trajectory that rebuilds."""

import array
import dataclasses

import numpy as np
import pytest
from geometry_msgs.msg import WrenchStamped
from numpy.testing import assert_allclose
from rclpy.serialization import deserialize_message, serialize_message
from rpud_msgs.msg import Trajectory, Waveform
from sensor_msgs.msg import JointState
from trajectories import arrays_of, rebuild

from rpud_sim.ros import messages
from rpud_sim.simulation import CONSTANTS, SEGMENT, preset
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.sampling import Samples, Times
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
ORIGIN = 1_795_251_166_866_606_964
RATE = 50_000


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


@pytest.mark.parametrize(
    ("convert", "frame", "fields"),
    [
        (
            messages.samples_to_nodal_plane,
            "rpud_nodal_plane",
            {"position": "nodal_plane_position", "velocity": "nodal_plane_velocity"},
        ),
        (
            messages.samples_to_drill_tool,
            "rpud_tool_tip",
            {
                "displacement": "drill_tool_displacement",
                "velocity": "drill_tool_velocity",
                "in_contact": "in_contact",
            },
        ),
        (messages.samples_to_reacting_force, "rpud_mount", {"force": "reacting_force"}),
    ],
)
def test_a_sample_is_said_field_by_field(convert, frame, fields):
    samples = numbered_samples()
    message = convert(samples, 1, ORIGIN + 7)
    assert nanoseconds(message.header.stamp) == ORIGIN + 7
    assert message.header.frame_id == frame
    said = set(message.get_fields_and_field_types()) - {"header"}
    assert said == fields.keys()
    for field, channel in fields.items():
        assert getattr(message, field) == getattr(samples, channel)[1], field
        assert type(getattr(message, field)) in (float, bool)
    serialize_message(message)


def test_the_wrench_is_what_the_mount_feels():
    message = messages.samples_to_wrench(numbered_samples(), 1, ORIGIN)
    force = numbered_samples().reacting_force[1]
    assert isinstance(message, WrenchStamped)
    assert message.header.frame_id == "rpud_mount"
    assert nanoseconds(message.header.stamp) == ORIGIN
    assert (message.wrench.force.x, message.wrench.force.y) == (0.0, 0.0)
    assert message.wrench.force.z == -force
    torque = message.wrench.torque
    assert (torque.x, torque.y, torque.z) == (0.0, 0.0, 0.0)


def test_the_state_of_the_joints_is_that_of_the_bodies():
    samples = numbered_samples()
    message = messages.samples_to_joint_state(samples, 1, ORIGIN + 7)
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
    wrench = messages.samples_to_wrench(samples, 1, ORIGIN).wrench
    assert message.effort.tolist() == [-wrench.force.z, 0.0, 0.0]
    assert deserialize_message(serialize_message(message), JointState) == message


def test_an_impact_is_said_field_by_field(block):
    for impact in block.impacts:
        message = messages.impact_to_contact_force(impact, ORIGIN)
        for field in set(message.get_fields_and_field_types()) - {"header"}:
            assert getattr(message, field) == impact[field], field
        assert type(message.sequence) is int
        assert message.header.frame_id == "rpud_tool_tip"
        exact = int(impact["seconds"]) * SECOND + impact["fraction"] * 1e9
        assert abs(nanoseconds(message.header.stamp) - ORIGIN - exact) <= 0.5


def test_the_stamp_of_an_impact_just_before_a_whole_second_is_valid(block):
    impact = block.impacts[:1].copy()
    impact["seconds"], impact["fraction"] = 4, 1.0 - 1e-12
    stamp = messages.impact_to_contact_force(impact[0], 0).header.stamp
    assert (stamp.sec, stamp.nanosec) == (5, 0)


@pytest.mark.parametrize("time", [0, 1, SECOND - 1, SECOND, ORIGIN])
def test_times_are_exact(time):
    message = messages.nanoseconds_to_time(time)
    assert nanoseconds(message) == time
    assert 0 <= message.nanosec < SECOND


def test_a_waveform_is_the_samples():
    samples = numbered_samples()
    message = messages.samples_to_waveform(samples, ORIGIN, 12, RATE)
    assert nanoseconds(message.header.stamp) == ORIGIN
    assert message.sequence == 12
    assert message.sample_period == 1.0 / RATE
    channels = set(message.get_fields_and_field_types()) - {"header", "sequence", "sample_period"}
    assert len(channels) == 6
    for name in channels:
        assert getattr(message, name).tolist() == getattr(samples, name).tolist(), name
        assert isinstance(getattr(message, name), array.array)


def test_a_trajectory_has_every_field_of_every_segment(block):
    (message,) = messages.segments_to_trajectories(block, 5, ORIGIN)
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
    covering["gravity"][10:] = 1.62
    changed = dataclasses.replace(block, covering=covering)
    found = list(messages.segments_to_trajectories(changed, 5, ORIGIN))
    assert [message.sequence for message in found] == [5, 8, 15]
    assert [message.free_mass for message in found] == [5e-3, 7e-3, 7e-3]
    assert [message.gravity for message in found] == [9.81, 9.81, 1.62]
    for name, values in arrays_of(found).items():
        assert values.tolist() == changed.segments[name].tolist(), name
    for message in found:
        first = message.start_seconds[0] * SECOND + message.start_fraction[0] * 1e9
        assert abs(nanoseconds(message.header.stamp) - ORIGIN - first) <= 0.5


def test_no_segments_are_no_trajectory(block):
    nothing = dataclasses.replace(block, covering=block.covering[-1:])
    assert list(messages.segments_to_trajectories(nothing, 5, ORIGIN)) == []


def test_constants_of_contacts_and_events_are_those_of_the_model(block):
    from rpud_sim.model import segment

    for name in ("CONTACT_ACTUATOR", "CONTACT_DRILL_TOOL"):
        assert getattr(Trajectory, name) == getattr(segment, name)
    for name in ("ACTUATOR_IMPACT", "DRILL_TOOL_IMPACT", "RELEASE", "COMMAND", "LIMIT"):
        assert getattr(Trajectory, f"EVENT_{name}") == getattr(segment, f"EVENT_{name}")
    assert Trajectory.CONTACT_BOTH == Trajectory.CONTACT_ACTUATOR | Trajectory.CONTACT_DRILL_TOOL


def test_the_waveform_is_rebuilt_from_the_trajectory_message_alone(block):
    first = RATE + 50
    times = Times.from_grid(first, RATE // 12, RATE)
    waveform = messages.samples_to_waveform(block.sample(times), ORIGIN, first, RATE)
    (message,) = messages.segments_to_trajectories(block, 0, ORIGIN)
    # As a reader has them, who knows nothing of this package.
    waveform = deserialize_message(serialize_message(waveform), Waveform)
    message = deserialize_message(serialize_message(message), Trajectory)
    count = len(waveform.nodal_plane_position)
    number = waveform.sequence + np.arange(count)
    expected = rebuild(arrays_of([message]), number // RATE, number % RATE / RATE)
    for name, tolerance in {
        "nodal_plane_position": 1e-15,
        "actuator_position": 1e-14,
        "free_mass_position": 1e-14,
        "drill_tool_displacement": 1e-14,
        "contact_force": 1e-3,
        "reacting_force": 1e-9,
    }.items():
        assert_allclose(
            getattr(waveform, name), expected[name], rtol=1e-9, atol=tolerance, err_msg=name
        )
    if message.drill_tool_spring_rate > 1e6:  # in the rock
        assert max(waveform.contact_force) > 100.0
