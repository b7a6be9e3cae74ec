"""The actuator drives, tracks and warms as docs/explanation/actuator.md says; no energy is free.

The vibration itself is in test/model/test_resonator.py.
"""

import dataclasses
import math

import numpy as np
import pytest
from drill_configurations import tables
from hypothesis import given, settings
from hypothesis import strategies as st
from support import examples

from rpud_sim.foundation.parameters import quantities
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER
from rpud_sim.model.parameters import preset
from rpud_sim.model.resonator import Account
from rpud_sim.simulation.actuator import (
    HEATING_INTERVAL,
    TRACKING_INTERVAL,
    Actuator,
    ActuatorParameters,
)
from rpud_sim.simulation.commands import Drive, WeightOnBit
from rpud_sim.simulation.configuration import LEAST_MASS_RATIO, Configuration
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
AMPLITUDE = 35e-6
OFF = Drive(False, 0.0, 0.0)
NOTHING = Account(0j, 0.0, 0.0, 0.0, 0.0, 0.0)

GAIN = ActuatorParameters()
RESONANCE = ActuatorParameters(actuator_model="resonance")
# Warms in seconds, not minutes.
HEATING = dataclasses.replace(RESONANCE, heating=True, heat_capacity=1.0)
TRACKING = dataclasses.replace(RESONANCE, generator="tracking")
# So light a free mass and so light a tool hardly load the vibration.
LIGHT = preset("free").replace(free_mass=1e-5, drill_tool_mass=1e-5)

drives = st.builds(
    Drive,
    st.booleans(),
    st.sampled_from([0.0, 40.0, 100.0]) | st.floats(0.0, 1000.0),
    st.sampled_from([16000.0, 16010.0, 15990.0]) | st.floats(100.0, 2e5),
)


def on(voltage=100.0, frequency=16000.0):
    return Drive(True, voltage, frequency)


# --- the gain model ---------------------------------------------------------------------------


@given(drives, drives)
def test_the_gain_model_is_proportional_to_the_voltage_at_once(first, second):
    actuator = Actuator(GAIN, AMPLITUDE, first)
    for drive in (first, second):
        actuator.drive(drive)
        reading = actuator.read(1.0, NOTHING)
        expected = AMPLITUDE * drive.voltage / GAIN.nominal_voltage if drive.enabled else 0.0
        assert reading.amplitude == actuator.level == expected
        assert reading.frequency == drive.frequency
        assert actuator.next_step == NEVER
        assert reading.temperature == GAIN.ambient_temperature
        for value in (reading.electrical_power, reading.current, reading.impedance):
            assert math.isnan(value)


@pytest.mark.parametrize(("name", "value"), [("heating", True), ("generator", "tracking")])
def test_the_gain_model_has_no_power_to_heat_and_no_phase_to_track(name, value):
    with pytest.raises(ParameterError, match=f"{name} = {value} needs actuator_model = resonance"):
        ActuatorParameters(**{name: value})


# --- no energy is free ------------------------------------------------------------------------


@st.composite
def resonant_drills(draw):
    """Resonant actuators on drills of any kind."""
    parameters = preset(draw(st.sampled_from(["free", "drilling"]))).replace(
        free_mass=draw(st.floats(1e-3, 2e-2)),
        rpud_mass=draw(st.floats(0.2, 5.0)),
        vibration_amplitude=draw(st.floats(3e-6, 1e-4)),
        weight_on_bit=draw(st.sampled_from([0.0, 1.0, 10.0, 50.0])),
        gravity=draw(st.sampled_from([0.0, 1.6, 9.81])),
        actuator_restitution=draw(st.sampled_from([0.0, 0.4, 1.0])),
    )
    actuator = ActuatorParameters(
        actuator_model="resonance",
        quality_factor=draw(st.floats(20.0, 5000.0)),
        motional_resistance=draw(st.floats(1.0, 1000.0)),
        resonance_frequency=draw(st.sampled_from([16000.0, 15970.0, 16300.0])),
        generator=draw(st.sampled_from(["fixed", "tracking"])),
        heating=draw(st.booleans()),
        heat_capacity=0.1,
    )
    try:
        return Configuration(parameters, actuator)
    except ParameterError:
        # Too light: the model refuses it.
        lighter = parameters.replace(vibration_amplitude=3e-6, free_mass=1e-3)
        return Configuration(lighter, RESONANCE)


changes = st.one_of(
    st.sampled_from([OFF, on(), on(150.0), on(20.0), on(100.0, 16020.0), on(100.0, 18000.0)]),
    st.sampled_from([WeightOnBit(0.0), WeightOnBit(30.0)]),
    st.sampled_from([Fault("free_mass_jammed"), Fault("resonance_drift", "", -50.0)]),
)


@settings(max_examples=25, deadline=None)
@given(resonant_drills(), st.floats(0.0, 1.0), st.lists(st.none() | changes, max_size=12))
def test_work_never_exceeds_the_energy_drawn(configuration, phase, course):
    simulation = Simulation(configuration, phase)
    statistics = Statistics()
    for number, change in enumerate([None, *course, None]):
        if isinstance(change, Fault):
            if change.kind not in {record.fault.kind for record in simulation.faults.active}:
                simulation.inject(change)
        elif change is not None:
            simulation.apply(change)
        block = simulation.advance_to((number + 1) * 5 * MILLISECOND)
        statistics.add(block)
        now = block.actuator
        work = now.mechanical_work
        assert work <= now.electrical_energy * (1.0 + 1e-12)
        throughput = max(now.electrical_energy, abs(work), 1e-9)
        left = now.electrical_energy - now.heat - work - now.stored + now.owed
        assert abs(left) <= 1e-9 * throughput
        # The trajectory shows the same work.
        account = statistics.account
        assert account.actuator_work == pytest.approx(work, rel=1e-9, abs=1e-9 * throughput)
        assert account.electrical == pytest.approx(now.electrical_energy, rel=1e-9, abs=1e-12)


def test_a_vibration_too_light_for_the_free_mass_is_refused():
    parameters = dataclasses.replace(RESONANCE, motional_resistance=1000.0)
    modal_mass = parameters.modal_mass(AMPLITUDE)
    assert modal_mass == pytest.approx(4.03e-3, rel=1e-2)
    with pytest.raises(ParameterError, match=r"^free_mass = 0.005 kg is more than 1/2 of the"):
        Configuration(tables("drilling"), parameters)
    Configuration(tables("drilling").replace(free_mass=modal_mass / LEAST_MASS_RATIO), parameters)


def mean_of(simulation, start, end):
    """Mean amplitude and mean phase between two times [ms]."""
    simulation.advance_to(start * MILLISECOND)
    readings = []
    for time in range(start, end):
        simulation.advance_to(time * MILLISECOND)
        readings.append(simulation.actuator)
    return (
        np.mean([reading.amplitude for reading in readings]),
        np.mean([reading.phase for reading in readings]),
    )


def test_the_amplitude_sags_under_load_and_with_it_the_power():
    free = Simulation(Configuration(LIGHT, RESONANCE))
    loaded = Simulation(Configuration(tables("drilling"), RESONANCE))
    idle, _ = mean_of(free, 500, 1000)
    sagging, _ = mean_of(loaded, 500, 1000)
    assert idle == pytest.approx(AMPLITUDE, rel=0.02)
    assert 0.1 * idle < sagging < 0.6 * idle
    drawn = loaded.actuator.electrical_energy
    assert drawn < 0.6 * free.actuator.electrical_energy
    # A source behind a resistance gives a load V^2 / 8 R at most.
    assert loaded.actuator.mechanical_work < 12.5


# --- nothing depends on when it is read -------------------------------------------------------


@settings(max_examples=5, deadline=None)
@given(
    st.sampled_from([HEATING, dataclasses.replace(HEATING, generator="tracking")]),
    st.lists(st.integers(0, SECOND // 20), max_size=10),
)
def test_asking_more_often_changes_nothing(parameters, stops):
    def run(times):
        simulation = Simulation(Configuration(preset("drilling"), parameters))
        for time in [*sorted(times), SECOND // 20]:
            simulation.advance_to(time)
        return simulation.actuator

    assert run([]) == run(stops)


# --- temperature and drift --------------------------------------------------------------------


def test_the_temperature_tends_to_that_of_the_heat_in_the_thermal_time_constant():
    actuator = Actuator(HEATING, AMPLITUDE, on())
    for number in range(1, 1001):
        time = number * HEATING_INTERVAL
        assert actuator.next_step == time
        actuator.step(time, NOTHING._replace(heat=32.0 * time / SECOND))
    rise = actuator.read(0.0, NOTHING).temperature - HEATING.ambient_temperature
    assert rise == pytest.approx(32.0 * HEATING.thermal_resistance, rel=1e-3)
    assert actuator.resonance_frequency == pytest.approx(16000.0 * (1.0 - 2e-4 * rise), rel=1e-12)


def test_heat_lowers_the_resonance_and_with_it_amplitude_and_power():
    simulation = Simulation(Configuration(LIGHT, HEATING))
    simulation.advance_to(10 * SECOND)
    now = simulation.actuator
    rise = now.temperature - HEATING.ambient_temperature
    # Balance: the power that is left at this detuning holds this temperature.
    detuning = 2.0 * HEATING.quality_factor * (16000.0 - now.resonance_frequency) / 16000.0
    assert rise == pytest.approx(50.0 / (1.0 + detuning**2), rel=0.02)
    assert now.amplitude == pytest.approx(AMPLITUDE / math.hypot(1.0, detuning), rel=0.02)
    assert now.phase == pytest.approx(-math.atan(detuning), abs=0.02)


# --- the generator ----------------------------------------------------------------------------


def test_a_tracking_generator_follows_a_warm_resonance():
    parameters = dataclasses.replace(HEATING, generator="tracking")
    simulation = Simulation(Configuration(LIGHT, parameters))
    simulation.advance_to(5 * SECOND)
    now = simulation.actuator
    assert now.resonance_frequency < 15_900.0
    assert now.frequency == pytest.approx(now.resonance_frequency, abs=3.0)
    assert now.phase == pytest.approx(0.0, abs=0.1)
    assert now.amplitude > 0.98 * AMPLITUDE


def test_a_tracking_generator_finds_a_resonance_and_loses_it_by_a_fault():
    simulation = Simulation(Configuration(LIGHT, TRACKING))
    simulation.inject(Fault("resonance_drift", "", -100.0))
    simulation.advance_to(SECOND)
    assert simulation.actuator.frequency == pytest.approx(15_900.0, abs=3.0)
    number = simulation.inject(Fault("generator_lock_loss"))
    simulation.advance_to(SECOND + 100 * MILLISECOND)
    assert simulation.actuator.frequency == 16_000.0
    assert simulation.actuator.amplitude < 0.3 * AMPLITUDE
    simulation.clear(number)
    simulation.advance_to(2 * SECOND)
    assert simulation.actuator.frequency == pytest.approx(15_900.0, abs=3.0)


def test_a_tracking_generator_stays_in_its_range_and_restarts_at_a_command():
    actuator = Actuator(dataclasses.replace(TRACKING, tracking_range=50.0), AMPLITUDE, on())
    for number in range(1, 1001):
        actuator.step(number * TRACKING_INTERVAL, NOTHING._replace(envelope=1.0 - 5.0j))
    assert actuator.frequency == 15_950.0
    actuator.drive(on(80.0))
    assert actuator.frequency == 15_950.0
    actuator.drive(on(80.0, 15_990.0))
    assert actuator.frequency == 15_990.0


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("name", quantities(ActuatorParameters))
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, "1", None, True])
def test_a_parameter_outside_its_range_is_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = .* is outside its range"):
        ActuatorParameters(**{name: value})


@pytest.mark.parametrize(
    ("name", "value"), [("actuator_model", "none"), ("heating", 1), ("generator", "loose")]
)
def test_a_choice_that_is_not_known_is_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = {value!r} is not"):
        ActuatorParameters(**{name: value})


@settings(max_examples=examples(100), deadline=None)
@given(
    st.fixed_dictionaries(
        {
            name: st.sampled_from([max(quantity.minimum, 1e-3), quantity.maximum])
            if quantity.minimum >= 0.0
            else st.sampled_from([quantity.minimum, quantity.maximum])
            for name, quantity in quantities(ActuatorParameters).items()
        }
    ),
    drives,
)
def test_every_parameter_may_be_at_its_limit(values, drive):
    values = {
        name: max(value, quantities(ActuatorParameters)[name].minimum)
        for name, value in values.items()
    }
    parameters = ActuatorParameters(
        actuator_model="resonance", heating=True, generator="tracking", **values
    )
    actuator = Actuator(parameters, 1e-10, drive)
    for number in range(1, 20):
        actuator.step(
            number * TRACKING_INTERVAL, NOTHING._replace(heat=1e3 * number, envelope=1.0 + 1.0j)
        )
    reading = actuator.read(1e-10, NOTHING._replace(envelope=1.0 + 0.0j))
    assert all(math.isfinite(value) for value in dataclasses.astuple(reading))
