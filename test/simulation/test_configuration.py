"""A configuration holds all parameters of a drill, checked together."""

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import NAMES
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.configuration import (
    NODE_NAMES,
    PARAMETERS,
    Configuration,
    read_parameter_file,
    to_configuration,
)

CONFIG = Path(__file__).parents[2] / "config"


def to_parameters(values):
    return to_configuration(values).parameters


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_configuration_files_are_the_presets(regime):
    values = read_parameter_file(CONFIG / f"{regime}.yaml")
    assert to_parameters(values) == preset(regime)
    # Said in the file, not taken from the preset.
    assert values["regime"] == regime
    assert values["weight_on_bit"] == preset(regime).weight_on_bit
    assert values.keys() <= {*NAMES, *NODE_NAMES}


def test_the_regime_chooses_the_preset():
    assert to_parameters({}) == preset("drilling") == Parameters()
    assert to_parameters({"regime": "free"}) == preset("free")
    assert to_parameters({"regime": "free", "weight_on_bit": 3}).weight_on_bit == 3.0


def test_the_node_s_own_parameters_are_passed_over():
    assert to_configuration(dict.fromkeys(NODE_NAMES, "anything")) == Configuration()


def test_a_drive_that_would_break_the_stack_is_refused_and_any_nominal_one_is_not():
    configuration = to_configuration({"nominal_voltage": 10.0, "vibration_amplitude": 35e-6})
    # Even off resonance, because the resonance may drift there.
    with pytest.raises(ParameterError) as caught:
        configuration.check_drive(Drive(True, 500.0, 20000.0))
    assert str(caught.value) == (
        "vibration_amplitude at drive voltage 500 V = 0.00175 m is outside its range [0, 0.001] m"
    )
    configuration.check_drive(Drive(False, 500.0, 0.0))
    # 1e-3 * voltage / voltage is rounded up here.
    voltage = 125.50940033382089
    configuration = to_configuration({"vibration_amplitude": 1e-3, "nominal_voltage": voltage})
    configuration.check_drive(Drive(True, voltage, 16000.0))


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"wieght_on_bit": 20.0}, "wieght_on_bit is not a parameter; did you mean weight_on_bit?"),
        ({"regime": "moon"}, "regime = 'moon' is not one of free, drilling"),
        ({"regime": 3}, "regime = 3 is not one of free, drilling"),
        ({"contact_model": "x"}, "contact_model = 'x' is not one of printed, rayleigh"),
        ({"free_mass": 0}, "free_mass = 0 kg is outside its range [1e-12, 10] kg"),
        ({"rpud_damping_ratio": 1.0}, "rpud_damping_ratio = 1 is outside its range [0, 1)"),
        ({"gravity": 10**5000}, "gravity = a number too long to show m/s^2 is outside its range"),
        ({"quality_factor": 1}, "quality_factor = 1 is outside its range [10, 100000]"),
        ({"hole_area": "wide"}, "hole_area = 'wide' m^2 is outside its range [1e-08, 1] m^2"),
        ({"rock_model": "moon"}, "rock_model = 'moon' is not one of none, specific_energy"),
        ({"heating": True}, "heating = True needs actuator_model = resonance"),
        ({"drive_enabled": 1}, "drive_enabled = 1 is not true or false"),
        ({"two\nlines": 1}, "'two\\nlines' is not a parameter; known are "),
    ],
)
def test_what_cannot_be_used_is_named(values, complaint):
    with pytest.raises(ParameterError) as caught:
        to_parameters(values)
    assert str(caught.value).startswith(complaint)


def test_an_unknown_name_is_refused_with_the_known_ones():
    with pytest.raises(ParameterError) as caught:
        to_parameters({"zzz": 1})
    for name in PARAMETERS:
        assert name in str(caught.value)


VALUES = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.just(10**5000),
    st.floats(),
    st.text(),
    st.lists(st.integers(), max_size=9),
    st.dates(),
)
KNOWN = tuple(PARAMETERS)


@given(values=st.dictionaries(st.one_of(st.sampled_from(KNOWN), st.text()), VALUES, max_size=4))
def test_any_values_are_a_configuration_or_refused_in_one_line(values):
    try:
        configuration = to_configuration(values)
    except ParameterError as error:
        refusal = str(error)
    else:
        assert isinstance(configuration, Configuration)
        return
    assert "\n" not in refusal
    assert len(refusal) < 2000
