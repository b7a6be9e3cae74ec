"""Commands change what acts and nothing else; where a caller stops changes nothing at all."""

import dataclasses

import numpy as np
import pytest
from drill_configurations import FULL, SANDSTONE
from hypothesis import given, settings
from hypothesis import strategies as st
from silent_drill import SilentDrill
from support import examples

from rpud_sim.drilling.mount import STOPPED
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.commands import ActiveCommands, Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Configuration, to_configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.plan import Journal

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
OFF = Drive(False, 0.0, 0.0)
regimes = st.sampled_from([preset("free"), preset("drilling")])
moments = st.integers(0, SECOND // 4)


def collect(blocks):
    """Give all segments and all impacts of some blocks, the open segment last."""
    segments = [block.segments for block in blocks] + [blocks[-1].open_segment]
    return np.concatenate(segments), np.concatenate([block.impacts for block in blocks])


def same(one, other):
    return one.dtype == other.dtype and len(one) == len(other) and (one == other).all()


def test_a_second_call_for_the_same_time_brings_nothing_and_time_does_not_go_back():
    simulation = SilentDrill(Parameters())
    simulation.advance_to(SECOND)
    again = simulation.advance_to(SECOND)
    assert (again.start, again.end) == (SECOND, SECOND)
    assert len(again.segments) == len(again.impacts) == 0
    with pytest.raises(ValueError, match="999999999 ns is before the current 1000000000 ns"):
        simulation.advance_to(SECOND - 1)
    assert simulation.time == SECOND
    for values in (again.open_segment, again.impacts):
        with pytest.raises(ValueError, match="read-only"):
            values[values.dtype.names[0]] = 1


@settings(max_examples=examples(40))
@given(regimes, moments, st.floats(0.0, 200.0), st.booleans())
def test_the_amplitude_changes_where_the_vibration_has_no_displacement(
    parameters, time, voltage, enabled
):
    simulation = SilentDrill(parameters)
    blocks = [simulation.advance_to(time)]
    simulation.apply(Drive(enabled, voltage, 16000.0))
    blocks.append(simulation.advance_to(time + MILLISECOND))
    segments, _ = collect(blocks)
    amplitude = segments["vibration_amplitude"]
    [changes] = np.nonzero(np.diff(amplitude))
    wanted = parameters.vibration_amplitude * voltage / 100.0 if enabled else 0.0
    if wanted == parameters.vibration_amplitude:
        assert len(changes) == 0
    else:
        [change] = changes + 1
        assert segments["vibration_phase"][change] in (0.0, 0.5)
        waited = segments["start_seconds"] + segments["start_fraction"] - time / SECOND
        assert -1e-12 < waited[change] <= 0.5 / 16000.0 + 1e-12
    assert amplitude[-1] == pytest.approx(wanted, rel=1e-15)


@pytest.mark.parametrize("drill", [Configuration(preset("free")), FULL])
def test_commands_and_a_configuration_that_change_nothing_leave_every_bit(drill):
    simulation, undisturbed = SilentDrill(drill), SilentDrill(drill)
    blocks = []
    for time in range(0, SECOND // 2, 37 * MILLISECOND):
        blocks.append(simulation.advance_to(time))
        simulation.apply(simulation.applied.drive)
        simulation.apply(simulation.applied.weight_on_bit)
        simulation.configure(drill)
    for found, expected in zip(
        collect(blocks), collect([undisturbed.advance_to(time)]), strict=True
    ):
        assert same(found, expected)
    assert repr(simulation.depth) == repr(undisturbed.depth)


def test_commands_come_back_as_applied_and_the_same_again_changes_nothing():
    journal = Journal()
    actuator = ActuatorParameters(nominal_voltage=50.0)
    simulation = SilentDrill(Configuration(actuator=actuator), journal=journal)
    first = ActiveCommands(WeightOnBit(8.0), 0, Drive(True, 50.0, 16000.0), 0)
    simulation.advance_to(MILLISECOND)
    for command in (WeightOnBit(8.0), Drive(True, 50.0, 16000.0)):
        simulation.apply(command)
    assert simulation.applied == first
    assert journal.drain() == []
    simulation.apply(WeightOnBit(30.0))
    simulation.advance_to(5 * MILLISECOND)
    simulation.apply(Drive(True, 25.0, 20000.0))
    second = ActiveCommands(
        WeightOnBit(30.0), MILLISECOND, Drive(True, 25.0, 20000.0), 5 * MILLISECOND
    )
    assert simulation.applied == second
    fed = SilentDrill(to_configuration({"feed_model": "arm"}), journal=journal)
    for command in (STOPPED, Feed("rate", 1e-3), Feed("rate", 1e-3)):
        fed.apply(command)
    assert [entry.kind for entry in journal.drain()] == ["weight_on_bit", "drive", "feed"]


def test_a_drive_that_is_off_keeps_voltage_and_frequency_that_are_zero():
    simulation = SilentDrill(Parameters())
    for command, applied in (
        (Drive(True, 80.0, 20000.0), Drive(True, 80.0, 20000.0)),
        (OFF, Drive(False, 80.0, 20000.0)),
        (Drive(False, 60.0, 0.0), Drive(False, 60.0, 20000.0)),
        (Drive(False, 0.0, 30000.0), Drive(False, 60.0, 30000.0)),
        (Drive(True, 0.0, 16000.0), Drive(True, 0.0, 16000.0)),  # one that is on does not
    ):
        simulation.apply(command)
        assert simulation.applied.drive == applied
    assert simulation.advance_to(MILLISECOND).open_segment["vibration_amplitude"] == 0.0


def test_another_specific_energy_counts_from_its_instant_on():
    plain, harder = SilentDrill(FULL), SilentDrill(FULL)
    for simulation in (plain, harder):
        simulation.advance_to(SECOND)
    before = plain.depth
    for energy in (1e9, 150e6):  # the second counts from the sandstone's as well
        rock = dataclasses.replace(SANDSTONE, rock_specific_energy=energy)
        harder.configure(dataclasses.replace(FULL, rock=rock))
    plain.advance_to(3 * SECOND)
    harder.advance_to(3 * SECOND)
    assert harder.depth - before == pytest.approx((plain.depth - before) / 2.0, rel=1e-9)


def test_there_is_progress_in_the_rock_alone():
    simulation = SilentDrill(Configuration(preset("free"), rock=SANDSTONE))
    engaged = simulation.parameters.replace(regime="drilling")
    depths = []
    for seconds, parameters in ((1, engaged), (2, engaged.replace(regime="free")), (4, engaged)):
        assert len(simulation.advance_to(seconds * SECOND).impacts) > 50
        depths.append(simulation.depth)
        rate = simulation.penetration_rate
        simulation.configure(Configuration(parameters, rock=SANDSTONE))
    assert depths[0] == 0.0 < depths[1] == depths[2]
    assert rate == 0.0


def test_commands_and_faults_outlast_another_configuration():
    simulation = SilentDrill(Parameters())
    simulation.apply(WeightOnBit(20.0))
    simulation.inject(Fault("lost_preload"))  # it changes what acts, not what is commanded
    simulation.configure(Configuration(Parameters(gravity=1.62)))
    last = simulation.advance_to(SECOND).segments[-1]
    assert (last["weight_on_bit"], last["gravity"]) == (10.0, 1.62)
    assert simulation.applied.weight_on_bit == WeightOnBit(20.0)


ROTATING = {"rotation_model": "friction_drive", "strata": "sandstone"}


def simulate(**values):
    return SilentDrill(to_configuration(values))


def test_rotation_deepens_the_hole_and_leaves_every_bit_of_the_percussion():
    alone, percussion, drilling = simulate(), simulate(strata="sandstone"), simulate(**ROTATING)
    impacts = {each.advance_to(SECOND).impacts.tobytes() for each in (alone, percussion, drilling)}
    assert len(impacts) == 1
    assert drilling.depth > percussion.depth > 0.0
    assert alone.process.rotation is alone.process.borehole is None


rates = st.integers(1, 1_000_000)


@given(st.integers(0, 10**7), rates)
def test_a_boundary_is_the_last_one_at_its_own_time(number, rate):
    time = boundary(number, rate)
    assert 0 <= number * SECOND - time * rate < rate  # rounded down to a nanosecond
    assert boundaries_until(time, rate) == number
    assert boundaries_until(boundary(number + 1, rate) - 1, rate) == number
