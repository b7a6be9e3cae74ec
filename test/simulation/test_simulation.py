"""Commands change what acts and nothing else; where a caller stops changes nothing at all."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.segment import EVENT_ACTUATOR_IMPACT
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
OFF = Drive(False, 0.0, 0.0)

regimes = st.sampled_from([preset("free"), preset("drilling")])
moments = st.integers(0, SECOND // 4)
commands = st.one_of(
    st.builds(WeightOnBit, st.floats(0.0, 60.0)),
    st.builds(Drive, st.just(True), st.floats(50.0, 200.0), st.floats(8e3, 40e3)),
    st.just(OFF),
)


def collect(blocks):
    """Give all segments and all impacts of some blocks, the open segment last."""
    segments = [block.segments for block in blocks] + [blocks[-1].open_segment]
    return np.concatenate(segments), np.concatenate([block.impacts for block in blocks])


def same(one, other):
    return one.dtype == other.dtype and len(one) == len(other) and (one == other).all()


def at(block, time):
    """Give all channels at one time."""
    samples = block.sample(Times.from_nanoseconds(time))
    return {name: values[0] for name, values in dataclasses.asdict(samples).items()}


def phase(segment, time):
    seconds, rest = divmod(time, SECOND)
    since = (seconds - segment["start_seconds"]) + (rest / SECOND - segment["start_fraction"])
    return (segment["vibration_phase"] + segment["vibration_frequency"] * since)[0]


def test_a_second_call_for_the_same_time_brings_nothing():
    simulation = Simulation(Parameters())
    simulation.advance_to(SECOND)
    again = simulation.advance_to(SECOND)
    assert (again.start, again.end) == (SECOND, SECOND)
    assert len(again.segments) == len(again.impacts) == 0
    assert simulation.time == SECOND


def test_time_does_not_go_back():
    simulation = Simulation(Parameters())
    simulation.advance_to(SECOND)
    with pytest.raises(ValueError, match="999999999 ns is before the present 1000000000 ns"):
        simulation.advance_to(SECOND - 1)
    assert simulation.time == SECOND


def test_what_happened_does_not_change():
    block = Simulation(Parameters()).advance_to(SECOND // 10)
    for values in (block.segments, block.open_segment, block.impacts):
        with pytest.raises(ValueError, match="read-only"):
            values["start_seconds" if "start_seconds" in values.dtype.names else "seconds"] = 1


@settings(max_examples=examples(60))
@given(regimes, moments, commands)
@example(preset("free"), 0, Drive(True, 50.0, 27558.0))
def test_nodal_plane_and_phase_are_continuous_at_a_command(parameters, time, command):
    simulation = Simulation(parameters)
    before = simulation.advance_to(time)
    simulation.apply(command)
    after = simulation.advance_to(time)
    old, new = at(before, time), at(after, time)
    assert new["nodal_plane_position"] == pytest.approx(old["nodal_plane_position"], abs=1e-15)
    assert new["actuator_position"] == pytest.approx(old["actuator_position"], abs=1e-13)
    cycles = phase(after.open_segment, time) - phase(before.open_segment, time)
    assert cycles == pytest.approx(round(cycles), abs=1e-9)
    # Where the tip touches the free mass, a vibration that is faster at once strikes it at once.
    struck = after.open_segment["event"][0] & EVENT_ACTUATOR_IMPACT
    if not (struck or before.open_segment["contact"][0] & 1):
        assert new["nodal_plane_velocity"] == pytest.approx(old["nodal_plane_velocity"], abs=1e-13)


@settings(max_examples=examples(40))
@given(regimes, moments, st.floats(0.0, 200.0), st.booleans())
def test_the_amplitude_changes_where_the_vibration_has_no_displacement(
    parameters, time, voltage, enabled
):
    simulation = Simulation(parameters)
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


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_a_command_that_changes_nothing_leaves_every_bit(regime):
    parameters = preset(regime).replace(weight_on_bit=10.0)
    simulation, undisturbed = Simulation(parameters), Simulation(parameters)
    blocks = []
    for time in range(0, SECOND // 2, 37 * MILLISECOND):
        blocks.append(simulation.advance_to(time))
        simulation.apply(simulation.applied.drive)
        simulation.apply(simulation.applied.weight_on_bit)
    segments, impacts = collect(blocks)
    expected, expected_impacts = collect([undisturbed.advance_to(time)])
    assert same(segments, expected)
    assert same(impacts, expected_impacts)


def test_commands_come_back_as_applied_with_their_time():
    simulation = Simulation(Configuration(actuator=ActuatorParameters(nominal_voltage=50.0)))
    assert simulation.applied.weight_on_bit == WeightOnBit(8.0)
    assert simulation.applied.drive == Drive(True, 50.0, 16000.0)
    assert (simulation.applied.weight_on_bit_time, simulation.applied.drive_time) == (0, 0)
    simulation.advance_to(3 * MILLISECOND)
    simulation.apply(WeightOnBit(30.0))
    simulation.advance_to(5 * MILLISECOND)
    simulation.apply(Drive(True, 25.0, 20000.0))
    assert simulation.applied.weight_on_bit == WeightOnBit(30.0)
    assert simulation.applied.drive == Drive(True, 25.0, 20000.0)
    assert simulation.applied.weight_on_bit_time == 3 * MILLISECOND
    assert simulation.applied.drive_time == 5 * MILLISECOND


def test_the_same_command_again_changes_nothing():
    journal = Journal()
    simulation = Simulation(Parameters(), journal=journal)
    simulation.advance_to(MILLISECOND)
    simulation.apply(simulation.applied.weight_on_bit)
    simulation.apply(simulation.applied.drive)
    assert simulation.applied.weight_on_bit_time == simulation.applied.drive_time == 0
    assert journal.drain() == []
    simulation.apply(WeightOnBit(11.0))
    assert simulation.applied.weight_on_bit_time == MILLISECOND


def test_drive_off_keeps_voltage_and_frequency_that_are_zero():
    simulation = Simulation(Parameters())
    simulation.apply(Drive(True, 80.0, 20000.0))
    simulation.apply(OFF)
    assert simulation.applied.drive == Drive(False, 80.0, 20000.0)
    simulation.apply(Drive(False, 60.0, 0.0))
    assert simulation.applied.drive == Drive(False, 60.0, 20000.0)
    simulation.apply(Drive(False, 0.0, 30000.0))
    assert simulation.applied.drive == Drive(False, 60.0, 30000.0)


def test_a_drive_that_is_on_takes_zero_volts_at_its_word():
    simulation = Simulation(Parameters())
    simulation.apply(Drive(True, 0.0, 16000.0))
    assert simulation.applied.drive.voltage == 0.0
    assert simulation.advance_to(MILLISECOND).open_segment["vibration_amplitude"] == 0.0


def test_a_drive_that_would_break_the_stack_changes_nothing():
    configuration = Configuration(actuator=ActuatorParameters(nominal_voltage=10.0))
    simulation = Simulation(configuration)
    simulation.advance_to(MILLISECOND)
    before = simulation.applied
    with pytest.raises(ParameterError, match="vibration_amplitude at drive voltage 900 V"):
        simulation.apply(Drive(True, 900.0, 16000.0))
    assert simulation.applied == before
    undisturbed = Simulation(configuration)
    undisturbed.advance_to(MILLISECOND)
    assert same(simulation.advance_to(SECOND).segments, undisturbed.advance_to(SECOND).segments)


@settings(max_examples=25)
@given(regimes, moments, st.permutations([WeightOnBit(7.0), OFF, WeightOnBit(31.0)]))
def test_the_order_of_commands_for_different_things_at_one_instant_changes_no_bit(
    parameters, moment, given_commands
):
    def trajectory(commands_in_order):
        simulation = Simulation(parameters)
        blocks = [simulation.advance_to(moment)]
        for command in commands_in_order:
            simulation.apply(command)
        return collect([*blocks, simulation.advance_to(SECOND // 3)])

    weights_first = sorted(given_commands, key=lambda command: isinstance(command, Drive))
    segments, impacts = trajectory(given_commands)
    others, other_impacts = trajectory(weights_first)
    assert same(segments, others)
    assert same(impacts, other_impacts)
