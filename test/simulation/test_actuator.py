"""The actuator follows the equations in docs/explanation/actuator.md, whenever it is asked."""

import cmath
import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rpud_sim.foundation.parameters import quantities
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER
from rpud_sim.model.parameters import QUANTITIES
from rpud_sim.simulation.actuator import (
    HEATING_INTERVAL,
    Actuator,
    ActuatorParameters,
)
from rpud_sim.simulation.commands import Drive

SECOND = 1_000_000_000
AMPLITUDE = 35e-6
OFF = Drive(False, 0.0, 0.0)

GAIN = ActuatorParameters()
RESONANCE = ActuatorParameters(actuator_model="resonance")
# Warms in seconds, not minutes.
HEATING = dataclasses.replace(RESONANCE, heating=True, heat_capacity=1.0)

TIME_CONSTANT = RESONANCE.quality_factor / (math.pi * RESONANCE.resonance_frequency)
BANDWIDTH = RESONANCE.resonance_frequency / RESONANCE.quality_factor

drives = st.builds(
    Drive,
    st.booleans(),
    st.sampled_from([0.0, 40.0, 100.0]) | st.floats(0.0, 1000.0),
    st.sampled_from([16000.0, 16010.0, 15990.0]) | st.floats(100.0, 2e5),
)


def on(voltage=100.0, frequency=16000.0):
    return Drive(True, voltage, frequency)


def settled(parameters, drive):
    """An actuator that has been driven until its amplitude is steady."""
    actuator = Actuator(parameters, AMPLITUDE, drive)
    steps(actuator)
    return actuator


def steps(actuator, until=NEVER):
    """Times and amplitudes of the steps to come."""
    found = []
    while actuator.next_step < until:
        time = actuator.next_step
        actuator.advance_to(time)
        found.append((time, actuator.amplitude))
    return found


def seen(actuator):
    return (
        actuator.amplitude,
        actuator.frequency,
        actuator.next_step,
        actuator.resonance_frequency,
        actuator.temperature,
        repr(actuator.electrical_power),
    )


# --- the gain model ---------------------------------------------------------------------------


@given(drives, drives)
def test_the_gain_model_is_proportional_to_the_voltage_at_once(first, second):
    actuator = Actuator(GAIN, AMPLITUDE, first)
    for time, drive in ((0, first), (SECOND, second)):
        actuator.drive(time, drive)
        expected = AMPLITUDE * drive.voltage / GAIN.nominal_voltage if drive.enabled else 0.0
        assert actuator.amplitude == expected
        assert actuator.frequency == drive.frequency
        assert actuator.next_step == NEVER
        assert actuator.temperature == GAIN.ambient_temperature
        assert math.isnan(actuator.electrical_power)


def test_the_gain_model_has_no_power_to_heat():
    with pytest.raises(ParameterError, match="heating = True needs actuator_model = resonance"):
        ActuatorParameters(heating=True)


# --- the resonance curve ----------------------------------------------------------------------


@given(st.floats(0.0, 1000.0))
def test_on_resonance_the_steady_amplitude_is_that_of_the_gain_model(voltage):
    drive = on(voltage)
    assert settled(RESONANCE, drive).amplitude == Actuator(GAIN, AMPLITUDE, drive).amplitude


@pytest.mark.parametrize("side", [-0.5, 0.5])
def test_half_the_power_is_left_half_a_bandwidth_away(side):
    beside = settled(RESONANCE, on(frequency=16000.0 + side * BANDWIDTH))
    nominal = 100.0**2 / (2.0 * RESONANCE.motional_resistance)
    assert beside.amplitude == pytest.approx(AMPLITUDE / math.sqrt(2.0), rel=1e-12)
    assert beside.electrical_power == pytest.approx(nominal / 2.0, rel=1e-12)


@settings(max_examples=30)
@given(st.floats(100.0, 2e5))
def test_detuning_lowers_the_amplitude_and_no_frequency_raises_it(frequency):
    amplitude = settled(RESONANCE, on(frequency=frequency)).amplitude
    away = (frequency - 16000.0) / BANDWIDTH
    assert amplitude == pytest.approx(AMPLITUDE / math.hypot(1.0, 2.0 * away), rel=1e-9)


# --- ring-up and ring-down --------------------------------------------------------------------


def test_it_rings_up_from_rest_with_the_time_constant_of_the_resonance():
    ramp = steps(Actuator(RESONANCE, AMPLITUDE, on()))
    times = np.array([time for time, _ in ramp[:-1]]) / SECOND
    amplitudes = np.array([amplitude for _, amplitude in ramp[:-1]])
    expected = AMPLITUDE * -np.expm1(-times / TIME_CONSTANT)
    np.testing.assert_allclose(amplitudes, expected, rtol=1e-9)
    assert ramp[-1][1] == AMPLITUDE


def test_it_rings_down_to_rest_with_the_time_constant_of_the_resonance():
    actuator = settled(RESONANCE, on())
    actuator.drive(SECOND, OFF)
    assert actuator.amplitude == AMPLITUDE
    assert actuator.frequency == 16000.0
    ramp = steps(actuator)
    for time, amplitude in ramp[:-1]:
        elapsed = (time - SECOND) / SECOND
        assert amplitude == pytest.approx(AMPLITUDE * math.exp(-elapsed / TIME_CONSTANT), rel=1e-9)
    assert ramp[-1][1] == 0.0
    assert actuator.electrical_power == 0.0


def test_a_detuned_drive_beats_while_it_rings_up():
    detuned = 16000.0 + 5.0 * BANDWIDTH
    ramp = steps(Actuator(RESONANCE, AMPLITUDE, on(frequency=detuned)))
    assert max(amplitude for _, amplitude in ramp) > 1.5 * ramp[-1][1]
    for time, amplitude in ramp[:-1]:
        turned = cmath.exp(-complex(1.0, 10.0) * time / SECOND / TIME_CONSTANT)
        assert amplitude == pytest.approx(ramp[-1][1] * abs(1.0 - turned), rel=1e-6, abs=1e-12)


@settings(max_examples=50)
@given(st.floats(-10.0, 10.0), st.floats(1.0, 1000.0), st.booleans())
def test_steps_are_small_and_end(bandwidths, voltage, down):
    drive = on(voltage, 16000.0 + bandwidths * BANDWIDTH)
    actuator = settled(RESONANCE, drive) if down else Actuator(RESONANCE, AMPLITUDE, drive)
    greatest = AMPLITUDE * voltage / 100.0 if not down else actuator.amplitude
    start = SECOND if down else 0
    actuator.drive(start, OFF if down else drive)
    ramp = [(start, actuator.amplitude), *steps(actuator)]
    times, amplitudes = np.array(ramp).T
    assert np.all(np.diff(times) * 16000.0 * 1.1 > SECOND)
    assert np.abs(np.diff(amplitudes)).max() < 0.03 * greatest


@settings(max_examples=20, deadline=None)
@given(st.floats(100.0, 2e5), st.floats(10.0, 1e5), st.floats(0.0, 1e3))
def test_steps_are_few_however_far_from_resonance_and_however_sharp(frequency, quality, voltage):
    parameters = dataclasses.replace(RESONANCE, quality_factor=quality)
    actuator = Actuator(parameters, AMPLITUDE, on(voltage, frequency))
    assert len(steps(actuator)) < 4000
    actuator.drive(1000 * SECOND, OFF)
    assert len(steps(actuator)) < 200


# --- nothing depends on when it is asked ------------------------------------------------------


@settings(max_examples=60, deadline=None)
@given(
    st.sampled_from([GAIN, RESONANCE, HEATING]),
    st.dictionaries(st.integers(0, SECOND // 4), drives, max_size=4),
    st.lists(st.integers(0, SECOND // 4), max_size=20),
)
def test_asking_more_often_changes_nothing(parameters, commands, stops):
    def run(times):
        actuator = Actuator(parameters, 1e-6, on())
        states = {}
        for time in sorted({*times, *commands, SECOND // 4}):
            actuator.advance_to(time)
            if time in commands:
                actuator.drive(time, commands[time])
            states[time] = seen(actuator)
        return states

    few, many = run([]), run(stops)
    assert few == {time: many[time] for time in few}


@given(st.sampled_from([GAIN, RESONANCE, HEATING]), st.integers(0, SECOND // 10), drives)
def test_a_drive_that_changes_nothing_has_no_effect(parameters, time, drive):
    once = Actuator(parameters, 1e-6, drive)
    again = Actuator(parameters, 1e-6, drive)
    again.drive(time, drive)
    for actuator in (once, again):
        actuator.advance_to(SECOND // 5)
    assert seen(once) == seen(again)


@settings(max_examples=60, deadline=None)
@given(st.sampled_from([RESONANCE, HEATING]), st.lists(drives, min_size=1, max_size=5))
def test_the_amplitude_stays_in_its_range_on_the_way(parameters, sequence):
    largest = QUANTITIES["vibration_amplitude"].maximum
    actuator = Actuator(parameters, largest / 10.0, on())
    for i, drive in enumerate(sequence):
        actuator.drive(i * SECOND // 100, drive)
        for _, amplitude in steps(actuator, (i + 1) * SECOND // 100):
            assert 0.0 <= amplitude <= largest


# --- power and energy -------------------------------------------------------------------------


def test_power_is_what_the_resistance_takes():
    assert settled(RESONANCE, on(60.0)).electrical_power == pytest.approx(18.0, rel=1e-12)


def test_the_energy_drawn_is_heat_when_the_ringing_ended():
    # Ringing down gives back what was stored.
    parameters = dataclasses.replace(
        HEATING, resonance_temperature_coefficient=0.0, thermal_resistance=1e3
    )
    actuator = Actuator(parameters, AMPLITUDE, on())
    times = np.linspace(0, SECOND // 40, 2001, dtype=np.int64)
    powers = []
    for time in times:
        actuator.advance_to(int(time))
        powers.append(actuator.electrical_power)
    actuator.drive(SECOND // 40, OFF)
    assert actuator.electrical_power == 0.0
    actuator.advance_to(SECOND // 4)
    rise = actuator.temperature - parameters.ambient_temperature
    drawn = np.trapezoid(powers, times / SECOND)
    assert rise * parameters.heat_capacity == pytest.approx(drawn, rel=2e-3)


# --- temperature and drift --------------------------------------------------------------------


def test_the_temperature_tends_to_that_of_the_power_in_the_thermal_time_constant():
    parameters = dataclasses.replace(
        HEATING, resonance_temperature_coefficient=0.0, heat_capacity=2.0
    )
    actuator = Actuator(parameters, AMPLITUDE, on(80.0))
    actuator.advance_to(10 * SECOND)
    rise = 80.0**2 / 200.0 * parameters.thermal_resistance
    assert actuator.temperature == pytest.approx(parameters.ambient_temperature + rise, rel=1e-3)
    actuator.drive(20 * SECOND, OFF)
    hot = actuator.temperature - parameters.ambient_temperature
    actuator.advance_to(22 * SECOND)
    cooled = actuator.temperature - parameters.ambient_temperature
    assert cooled == pytest.approx(hot / math.e, rel=0.02)


def test_a_cold_actuator_that_is_off_is_left_alone():
    actuator = Actuator(HEATING, AMPLITUDE, OFF)
    assert actuator.next_step == NEVER
    actuator.advance_to(SECOND)
    assert actuator.temperature == HEATING.ambient_temperature
    assert actuator.electrical_power == actuator.amplitude == 0.0


def test_heat_lowers_the_resonance_and_with_it_amplitude_and_power():
    actuator = Actuator(HEATING, AMPLITUDE, on())
    cold = {amplitude for _, amplitude in steps(actuator, SECOND // 20)}
    actuator.advance_to(20 * SECOND)
    rise = actuator.temperature - HEATING.ambient_temperature
    assert actuator.resonance_frequency == pytest.approx(16000.0 * (1.0 - 2e-4 * rise), rel=1e-12)
    assert actuator.amplitude < 0.6 * max(cold)
    # Balance: the power that is left at this detuning holds this temperature.
    detuning = 2.0 * HEATING.quality_factor * (16000.0 / actuator.resonance_frequency - 1.0)
    assert rise == pytest.approx(50.0 / (1.0 + detuning**2) * HEATING.thermal_resistance, rel=1e-3)
    assert actuator.amplitude == pytest.approx(AMPLITUDE / math.hypot(1.0, detuning), rel=2e-3)
    # Following the resonance restores the amplitude.
    actuator.drive(20 * SECOND, on(100.0, actuator.resonance_frequency))
    actuator.advance_to(20 * SECOND + 5 * HEATING_INTERVAL)
    assert actuator.amplitude > 0.9 * AMPLITUDE


def test_the_amplitude_changes_only_at_steps():
    actuator = Actuator(HEATING, AMPLITUDE, on())
    for _ in range(2000):
        step, amplitude = actuator.next_step, actuator.amplitude
        actuator.advance_to(step - 1)
        assert actuator.amplitude == amplitude
        actuator.advance_to(step)


def test_an_injected_drift_detunes_and_its_end_restores():
    actuator = settled(RESONANCE, on())
    actuator.drift(SECOND, -BANDWIDTH / 2.0)
    assert actuator.resonance_frequency == 16000.0 - BANDWIDTH / 2.0
    ramp = steps(actuator)
    assert len(ramp) > 10
    assert ramp[-1][1] == pytest.approx(AMPLITUDE / math.sqrt(2.0), rel=2e-3)
    actuator.drift(2 * SECOND, 0.0)
    assert steps(actuator)[-1][1] == AMPLITUDE


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize("name", quantities(ActuatorParameters))
@pytest.mark.parametrize("value", [math.nan, math.inf, -1.0, "1", None, True])
def test_a_parameter_outside_its_range_is_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = .* is outside its range"):
        ActuatorParameters(**{name: value})


@pytest.mark.parametrize(("name", "value"), [("actuator_model", "none"), ("heating", 1)])
def test_a_choice_that_is_not_known_is_refused(name, value):
    with pytest.raises(ParameterError, match=f"^{name} = {value!r} is not"):
        ActuatorParameters(**{name: value})


@settings(max_examples=100, deadline=None)
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
    parameters = ActuatorParameters(actuator_model="resonance", heating=True, **values)
    actuator = Actuator(parameters, 1e-10, drive)
    actuator.advance_to(SECOND // 10)
    assert all(math.isfinite(float(value)) for value in seen(actuator))
