"""Commands change what acts and nothing else; where a caller stops changes nothing at all."""

import dataclasses

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from support import examples
from trajectories import evaluate

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.segment import EVENT_ACTUATOR_IMPACT
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
ON = Drive(True, 100.0, 16000.0)
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


@settings(max_examples=examples(40))
@given(
    regimes,
    st.dictionaries(moments, commands, max_size=5),
    st.lists(moments, max_size=20),
    st.floats(0.0, 1.0),
)
def test_where_a_caller_stops_changes_no_bit(parameters, given_commands, stops, initial_phase):
    def trajectory(times):
        simulation = Simulation(parameters, initial_phase)
        blocks = []
        for time in sorted({*times, *given_commands, SECOND // 4}):
            blocks.append(simulation.advance_to(time))
            if time in given_commands:
                simulation.apply(given_commands[time])
        return collect(blocks), simulation.impact_count

    (segments, impacts), count = trajectory([])
    (others, other_impacts), other_count = trajectory(stops)
    assert same(segments, others)
    assert same(impacts, other_impacts)
    assert count == other_count


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


@settings(max_examples=examples(40))
@given(regimes, st.dictionaries(moments, commands, min_size=1, max_size=8))
def test_segments_follow_each_other_without_a_gap_or_a_jump(parameters, given_commands):
    simulation = Simulation(parameters)
    blocks = []
    for time in sorted({*given_commands, SECOND // 4}):
        blocks.append(simulation.advance_to(time))
        if time in given_commands:
            simulation.apply(given_commands[time])
    segments, _ = collect(blocks)
    assert (segments["duration"] >= 0.0).all()
    assert (segments["start_fraction"] < 1.0).all()
    starts = segments["start_seconds"] + segments["start_fraction"]
    assert_allclose(np.diff(starts), segments["duration"][:-1], rtol=0.0, atol=1e-15)

    index = np.arange(len(segments) - 1)
    old = evaluate(segments, index, segments["duration"][:-1])
    new = evaluate(segments, index + 1, np.zeros(len(index)))
    for name, tolerance in {
        "nodal_plane_position": 1e-13,
        "actuator_position": 1e-13,
        "free_mass_position": 2e-9,  # a bounce that is lower than a nanometre is none
        "drill_tool_displacement": 2e-9,
    }.items():
        # In the rock the drill tool is at rest as soon as it is left alone.
        let_go = (name == "drill_tool_displacement") & (new[name] == 0.0)
        assert_allclose(
            new[name][~let_go], old[name][~let_go], rtol=0.0, atol=tolerance, err_msg=name
        )
        assert abs(old[name][let_go]).max(initial=0.0) < 1e-6
    # Unless the actuator touches the free mass, nothing gives the nodal plane a jerk.
    alone = ((segments["contact"][:-1] | segments["contact"][1:] | segments["event"][1:]) & 1) == 0
    name = "nodal_plane_velocity"
    assert_allclose(new[name][alone], old[name][alone], rtol=0.0, atol=1e-12)


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
@pytest.mark.parametrize("command", [None, WeightOnBit(10.0), ON, "present"])
def test_a_command_that_changes_nothing_leaves_every_bit(regime, command):
    parameters = preset(regime).replace(weight_on_bit=10.0)
    simulation, undisturbed = Simulation(parameters), Simulation(parameters)
    blocks = []
    for time in range(0, SECOND, 37 * MILLISECOND):
        blocks.append(simulation.advance_to(time))
        if command == "present":
            simulation.apply(simulation.applied.drive)
            simulation.apply(simulation.applied.weight_on_bit)
        elif command is not None:
            simulation.apply(command)
    segments, impacts = collect(blocks)
    expected, expected_impacts = collect([undisturbed.advance_to(time)])
    assert same(segments, expected)
    assert same(impacts, expected_impacts)


def test_commands_come_back_as_applied_with_their_time():
    simulation = Simulation(Configuration(actuator=ActuatorParameters(nominal_voltage=50.0)))
    assert simulation.applied.weight_on_bit == WeightOnBit(10.0)
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
    simulation.apply(WeightOnBit(10.0))
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


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_drill_settles_without_its_drive_and_strikes_again_with_it(regime):
    simulation = Simulation(preset(regime))
    assert len(simulation.advance_to(SECOND).impacts) > 50
    simulation.apply(OFF)
    simulation.advance_to(3 * SECOND)
    quiet = simulation.advance_to(4 * SECOND)
    assert len(quiet.impacts) == 0
    rest = at(quiet, 4 * SECOND)
    for body in ("nodal_plane", "actuator", "free_mass", "drill_tool"):
        assert abs(rest[f"{body}_velocity"]) < 1e-9, body
    assert rest["actuator_position"] == pytest.approx(rest["nodal_plane_position"], abs=1e-18)
    # What pushes on the drill tool is held by it.
    weight = 5e-3 * 9.81
    assert rest["in_contact"]
    assert rest["contact_force"] == pytest.approx(rest["reacting_force"] + weight, rel=1e-6)
    assert rest["drill_tool_displacement"] == pytest.approx(
        rest["contact_force"] / quiet.open_segment["drill_tool_spring_rate"][0], rel=1e-6
    )
    simulation.apply(ON)
    assert len(simulation.advance_to(5 * SECOND).impacts) > 50


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_an_inactive_drill_falls_silent(regime):
    simulation = Simulation(preset(regime))
    simulation.advance_to(SECOND)
    simulation.apply(OFF)
    simulation.apply(WeightOnBit(0.0))
    simulation.advance_to(3 * SECOND)
    assert len(simulation.advance_to(10 * SECOND).impacts) == 0


def test_a_drill_that_starts_without_its_drive_rests():
    simulation = Simulation(Configuration(drive_enabled=False))
    simulation.advance_to(SECOND)
    assert len(simulation.advance_to(2 * SECOND).impacts) == 0
    assert not simulation.applied.drive.enabled


def test_the_impact_count_is_that_of_the_records():
    simulation = Simulation(Parameters())
    impacts = simulation.advance_to(SECOND).impacts
    assert impacts["sequence"].tolist() == list(range(len(impacts)))
    assert 0 <= simulation.impact_count - len(impacts) <= 1


def test_more_weight_on_bit_pushes_harder():
    simulation = Simulation(Parameters())
    means = []
    for force in (10.0, 30.0):
        simulation.apply(WeightOnBit(force))
        statistics = Statistics()
        statistics.add(simulation.advance_to(simulation.time + 4 * SECOND))
        means.append(statistics.figures()["reacting_force_mean"])
    assert means[1] > means[0] + 5.0


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
