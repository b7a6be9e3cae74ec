"""Messages say what the fields say: right types, exact stamps, a trajectory that rebuilds."""

import dataclasses
import math

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from rpud_msgs.msg import Fault as FaultMessage
from rpud_msgs.msg import (
    Status,
    Trajectory,
)
from silent_drill import SilentDrill
from support import trajectory_messages
from trajectories import arrays_of

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.messages.batch import Batch
from rpud_sim.model import segment
from rpud_sim.model.segment import CONSTANTS, SEGMENT
from rpud_sim.ros.drill.services import message_to_fault
from rpud_sim.ros.graph import filled
from rpud_sim.simulation import fields, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault

SECOND = 1_000_000_000
ORIGIN = 1_795_251_166_866_606_964


def nanoseconds(time):
    return time.sec * SECOND + time.nanosec


def values_of(message, *without):
    """Give the values of a message's fields, without its header and others."""
    names = message.get_fields_and_field_types().keys() - {"header", *without}
    return {name: getattr(message, name) for name in names}


def row(columns, number):
    return Batch("", np.zeros(2, np.int64), columns).row(number)


def said(kind, columns, number=1):
    """Give a message of some columns as it is received."""
    return deserialize_message(serialize_message(filled(kind(), row(columns, number))), kind)


@pytest.fixture(scope="module", params=["free", "drilling"])
def block(request):
    """A tenth of a second with every kind of contact, after a command to settle."""
    simulation = SilentDrill(preset(request.param))
    simulation.advance_to(SECOND)
    simulation.apply(WeightOnBit(20.0))
    simulation.apply(Drive(True, 60.0, 17000.0))
    return simulation.advance_to(SECOND + SECOND // 10)


def trajectories(block, sequence):
    return [
        filled(Trajectory(), values)
        for values in trajectory_messages(block.segments, sequence, ORIGIN)
    ]


def test_a_trajectory_has_every_field_of_every_segment_and_is_cut_where_constants_change(block):
    (message,) = trajectories(block, 5)
    assert (message.sequence, nanoseconds(message.origin)) == (5, ORIGIN)
    said = values_of(message, "sequence", "origin")
    assert said.keys() == set(SEGMENT.names)
    for name, values in said.items():
        expected = block.segments[name]
        assert (
            values == expected[0] if name in CONSTANTS else values.tolist() == expected.tolist()
        ), name
    covering = block.covering.copy()
    covering["free_mass"][3:] = 7e-3
    covering["gravity"][:10], covering["gravity"][10:] = 9.81, 1.62
    changed = dataclasses.replace(block, covering=covering)
    found = trajectories(changed, 5)
    assert [message.sequence for message in found] == [5, 8, 15]
    assert [message.free_mass for message in found] == [5e-3, 7e-3, 7e-3]
    assert [message.gravity for message in found] == [9.81, 9.81, 1.62]
    for name, values in arrays_of(found).items():
        assert values.tolist() == changed.segments[name].tolist(), name
    for message in found:
        first = message.start_seconds[0] * SECOND + message.start_fraction[0] * 1e9
        assert abs(nanoseconds(message.header.stamp) - ORIGIN - first) <= 0.5


def test_constants_of_contacts_and_events_are_those_of_the_model():
    for name in ("CONTACT_ACTUATOR", "CONTACT_DRILL_TOOL"):
        assert getattr(Trajectory, name) == getattr(segment, name)
    for name in ("ACTUATOR_IMPACT", "DRILL_TOOL_IMPACT", "RELEASE", "COMMAND", "LIMIT"):
        assert getattr(Trajectory, f"EVENT_{name}") == getattr(segment, f"EVENT_{name}")
    assert Trajectory.CONTACT_BOTH == Trajectory.CONTACT_ACTUATOR | Trajectory.CONTACT_DRILL_TOOL


def status_of(simulation):
    values = fields.status_fields(simulation, 0, "running", fields.CommandCounts())
    return filled(Status(), values)


def test_the_status_says_how_the_drill_is_and_what_it_lacks_is_not_a_number():
    rock = RockParameters(rock_model="specific_energy")
    actuator = ActuatorParameters(actuator_model="resonance")
    simulation = SilentDrill(Configuration(actuator=actuator, rock=rock))
    simulation.advance_to(SECOND)
    simulation.inject(Fault("lost_preload"))
    status = status_of(simulation)
    assert status.impacts == simulation.impact_count > 50
    assert status.vibration_amplitude == simulation.actuator.amplitude > 0.0
    assert status.resonance_frequency == 16000.0
    assert status.actuator_temperature == 20.0
    # Without load it draws 50 W; blows take from the amplitude, and so from the current.
    assert status.electrical_power == simulation.actuator.electrical_power
    assert 1.0 < status.electrical_power < 50.0
    assert status.depth == simulation.depth > 0.0
    assert status.penetration_rate == simulation.penetration_rate > 0.0
    assert status.active_faults == 1
    lacking = status_of(SilentDrill(preset("drilling")))
    for name in ("electrical_power", "depth", "penetration_rate"):
        assert math.isnan(getattr(lacking, name))


@pytest.mark.parametrize("kind", KINDS)
def test_a_magnitude_that_is_left_out_is_the_default(kind):
    channel = "" if KINDS[kind].physical else "wrench"
    for magnitude in (0.0, math.nan):
        asked = FaultMessage(kind=kind, channel=channel, magnitude=magnitude)
        assert message_to_fault(asked) == Fault(kind, channel)


def test_a_magnitude_is_taken_at_its_word():
    asked = message_to_fault(FaultMessage(kind="bias", channel="wrench", magnitude=-2.0))
    assert asked == Fault("bias", "wrench", -2.0)
    for kind, magnitude in (("rusty", 0.0), ("choking", 2.0), ("choking", math.inf)):
        with pytest.raises(ParameterError):
            message_to_fault(FaultMessage(kind=kind, magnitude=magnitude))
