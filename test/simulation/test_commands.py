"""Commands are checked when they are made; a refusal names value, unit and allowed range."""

import math

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.commands import Drive, WeightOnBit

NO_NUMBERS = [math.nan, math.inf, -math.inf, True, "30", None, [30.0], 10**400]


def test_a_refusal_names_value_unit_and_range():
    with pytest.raises(ParameterError) as caught:
        WeightOnBit(-1.5)
    assert str(caught.value) == "weight_on_bit = -1.5 N is outside its range [0, 1000] N"
    with pytest.raises(ParameterError) as caught:
        Drive(True, 2000.0, 16000.0)
    assert str(caught.value) == "drive voltage = 2000 V is outside its range [0, 1000] V"
    with pytest.raises(ParameterError) as caught:
        Drive(True, 100.0, 0.0)
    assert str(caught.value) == "drive frequency = 0 Hz is outside its range [100, 200000] Hz"


@pytest.mark.parametrize("enabled", [True, False])
@pytest.mark.parametrize("value", [*NO_NUMBERS, -1.0, 1e9])
def test_a_voltage_or_frequency_outside_its_range_is_refused_even_when_off(enabled, value):
    with pytest.raises(ParameterError, match=r"^drive voltage = .* V is outside its range"):
        Drive(enabled, value, 16000.0)
    with pytest.raises(ParameterError, match=r"^drive frequency = .* Hz is outside its range"):
        Drive(enabled, 100.0, value)


@pytest.mark.parametrize("enabled", [1, 0, "true", None, math.nan])
def test_enabled_is_true_or_false(enabled):
    with pytest.raises(ParameterError, match=r"drive enabled = .* is not true or false"):
        Drive(enabled, 100.0, 16000.0)


@pytest.mark.parametrize("frequency", [0, 0.0, -0.0])
def test_a_drive_that_is_off_needs_no_voltage_and_no_frequency(frequency):
    drive = Drive(False, 0, frequency)
    assert (drive.voltage, drive.frequency) == (0.0, 0.0)
    assert type(drive.frequency) is float
