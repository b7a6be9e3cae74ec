"""The actuator drives, tracks and warms as docs/explanation/actuator.md says.

The vibration itself is in test/model/test_resonator.py, its energy in test_energy_account.py.
"""

import dataclasses
import math

import pytest
from drill_configurations import tables
from hypothesis import given
from hypothesis import strategies as st
from silent_drill import SilentDrill
from support import refusal

from rpud_sim.foundation.time import NEVER
from rpud_sim.model.parameters import preset
from rpud_sim.model.resonator import ResonatorEnergy
from rpud_sim.simulation.actuator import (
    TRACKING_INTERVAL,
    Actuator,
    ActuatorParameters,
)
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.configuration import LEAST_MASS_RATIO, Configuration
from rpud_sim.simulation.faults import Fault

SECOND = 1_000_000_000
MILLISECOND = 1_000_000
AMPLITUDE = 35e-6
NOTHING = ResonatorEnergy(0j, 0.0, 0.0, 0.0, 0.0, 0.0)
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


NOMINAL = Drive(True, 100.0, 16000.0)


def test_an_ambient_temperature_in_kelvin_is_refused():
    reason = "ambient_temperature = 293.15 degC is outside its range [-273.15, 150] degC"
    assert refusal(lambda: ActuatorParameters(ambient_temperature=293.15)) == reason
    assert ActuatorParameters(ambient_temperature=-173.0).ambient_temperature == -173.0


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


def test_a_vibration_too_light_for_the_free_mass_is_refused():
    parameters = dataclasses.replace(RESONANCE, motional_resistance=1000.0)
    modal_mass = parameters.modal_mass(AMPLITUDE)
    assert modal_mass == pytest.approx(4.03e-3, rel=1e-2)
    drill = tables("drilling")
    assert refusal(Configuration, drill, parameters).startswith("free_mass = 0.005 kg is more than")
    Configuration(drill.replace(free_mass=modal_mass / LEAST_MASS_RATIO), parameters)


def test_heat_lowers_the_resonance_and_with_it_amplitude_and_power():
    simulation = SilentDrill(Configuration(LIGHT, HEATING))
    simulation.advance_to(10 * SECOND)
    now = simulation.actuator
    rise = now.temperature - HEATING.ambient_temperature
    # Balance: the power that is left at this detuning holds this temperature.
    detuning = 2.0 * HEATING.quality_factor * (16000.0 - now.resonance_frequency) / 16000.0
    assert rise == pytest.approx(50.0 / (1.0 + detuning**2), rel=0.02)
    assert now.amplitude == pytest.approx(AMPLITUDE / math.hypot(1.0, detuning), rel=0.02)
    assert now.phase == pytest.approx(-math.atan(detuning), abs=0.02)


def test_a_tracking_generator_finds_a_resonance_and_loses_it_by_a_fault():
    simulation = SilentDrill(Configuration(LIGHT, TRACKING))
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
    actuator = Actuator(dataclasses.replace(TRACKING, tracking_range=50.0), AMPLITUDE, NOMINAL)
    for number in range(1, 1001):
        actuator.step(number * TRACKING_INTERVAL, NOTHING._replace(envelope=1.0 - 5.0j))
    assert actuator.frequency == 15_950.0
    actuator.drive(Drive(True, 80.0, 16000.0))
    assert actuator.frequency == 15_950.0
    actuator.drive(Drive(True, 80.0, 15_990.0))
    assert actuator.frequency == 15_990.0
