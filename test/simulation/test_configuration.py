"""All parameters of a drill and of a run, checked together, and the files that hold them."""

import itertools
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.model.parameters import NAMES
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.commands import Drive
from rpud_sim.simulation.configuration import (
    NODE_NAMES,
    PARAMETERS,
    Configuration,
    Settings,
    parse_assignment,
    read_parameter_file,
    to_configuration,
    to_settings,
)
from rpud_sim.simulation.scenario import scenario_of

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
        configuration.check(Drive(True, 500.0, 20000.0))
    assert str(caught.value) == (
        "vibration_amplitude at drive voltage 500 V = 0.00175 m is outside its range [0, 0.001] m"
    )
    configuration.check(Drive(False, 500.0, 0.0))
    # 1e-3 * voltage / voltage is rounded up here.
    voltage = 125.50940033382089
    configuration = to_configuration({"vibration_amplitude": 1e-3, "nominal_voltage": voltage})
    configuration.check(Drive(True, voltage, 16000.0))


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


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text("seed: 7\nfaults: [{kind: free_mass_jammed, onset: {uniform: [1, 2]}}]")
    return path


def test_settings_are_what_was_given_and_whole_numbers_are_integers(scenario):
    given_values = {
        "weight_on_bit": 20,
        "nominal_voltage": 60,
        "actuator_model": "resonance",
        "rock_model": "specific_energy",
        "drive_enabled": False,
        "autostart": False,
        "start_paused": True,
        "publish_clock": True,
        "real_time_factor": 2,
        "thread_priority": 7,
        "command_timeout": 0.2,
        "command_loss_ramp": 1,
        "telemetry_rate": 250.0,
        "sample_rate": 48000,
        "block_duration": 1,
        "scenario": str(scenario),
        "seed": 5.0,
    }
    settings = to_settings(given_values)
    assert settings == Settings(
        Configuration(
            Parameters(weight_on_bit=20.0),
            ActuatorParameters(actuator_model="resonance", nominal_voltage=60.0),
            RockParameters(rock_model="specific_energy"),
            drive_enabled=False,
        ),
        autostart=False,
        start_paused=True,
        publish_clock=True,
        real_time_factor=2.0,
        thread_priority=7,
        command_timeout=0.2,
        command_loss_ramp=1.0,
        telemetry_rate=250,
        sample_rate=48000,
        block_duration=1.0,
        scenario=str(scenario),
        seed=5,
    )
    for name in ("thread_priority", "telemetry_rate", "sample_rate", "seed"):
        assert type(settings.value(name)) is int
    for name in ("block_duration", "nominal_voltage", "real_time_factor", "command_loss_ramp"):
        assert type(settings.value(name)) is float
    for name, value in given_values.items():
        assert settings.value(name) == value, name
    assert to_settings({}) == Settings()
    # The ends of what belongs together.
    for values in ({"block_duration": 0.01, "telemetry_rate": 100}, {"real_time_factor": 0.01}):
        assert all(to_settings(values).value(name) == values[name] for name in values)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"publish_clock": "yes"}, "publish_clock = 'yes' is not true or false"),
        ({"telemetry_rate": 0}, "telemetry_rate = 0 Hz is outside its range [1, 1000] Hz"),
        ({"sample_rate": 44100.5}, "sample_rate = 44100.5 Hz is not a whole number"),
        ({"sample_rate": 2e6}, "sample_rate = 2e+06 Hz is outside its range [1, 1e+06] Hz"),
        ({"block_duration": 0.0}, "block_duration = 0 s is outside its range [0.001, 1] s"),
        ({"nominal_voltage": 0}, "nominal_voltage = 0 V is outside its range [0.001, 1000] V"),
        ({"weight_on_bit": -1}, "weight_on_bit = -1 N is outside its range [0, 1000] N"),
        ({"wieght_on_bit": 1.0}, "wieght_on_bit is not a parameter; did you mean weight_on_bit?"),
        ({"command_timeout": -1}, "command_timeout = -1 s is outside its range [0, 3600] s"),
        ({"command_loss_ramp": 61}, "command_loss_ramp = 61 s is outside its range [0, 60] s"),
        ({"seed": 0.5}, "seed = 0.5 is not a whole number"),
        ({"seed": -1}, "seed = -1 is outside its range [0, 4.29497e+09]"),
        ({"real_time_factor": 1e4}, "real_time_factor = 10000 is outside its range [0, 1000]"),
        ({"real_time_factor": 0.005}, "real_time_factor = 0.005 is neither 0, as fast as "),
        ({"thread_priority": 100}, "thread_priority = 100 is outside its range [0, 99]"),
        ({"scenario": 3}, "scenario = 3 is not a text"),
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
        (
            {"block_duration": 0.005, "telemetry_rate": 100},
            "block_duration = 0.005 s is shorter than one period of telemetry_rate = 100 Hz",
        ),
    ],
)
def test_what_cannot_be_used_is_named(values, complaint):
    with pytest.raises(ParameterError) as caught:
        to_settings(values)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)


def test_a_change_keeps_everything_else():
    settings = to_settings({"regime": "free", "weight_on_bit": 7.0, "seed": 3})
    changed = settings.replace({"regime": "drilling", "gravity": 1.62})
    for name in PARAMETERS:
        expected = {"regime": "drilling", "gravity": 1.62}.get(name, settings.value(name))
        assert changed.value(name) == expected, name


def test_a_scenario_is_drawn_with_the_seed_that_is_given_and_otherwise_with_its_own(scenario):
    own = to_settings({"scenario": str(scenario)})
    assert scenario_of(own).seed == 7
    assert scenario_of(own, 0) == scenario_of(own)
    assert scenario_of(own, 9).seed == 9
    seeded = to_settings({"scenario": str(scenario), "seed": 4})
    assert scenario_of(seeded).seed == 4
    assert scenario_of(seeded, 9) == scenario_of(own, 9) != scenario_of(own)
    assert scenario_of(Settings()) is None


def test_a_scenario_that_is_missing_is_named_when_it_is_read_and_not_before():
    settings = to_settings({"scenario": "/missing.yaml"})
    with pytest.raises(ParameterError, match=r"^/missing\.yaml: No such file or directory$"):
        scenario_of(settings)


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "file.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def test_a_node_s_own_values_come_before_those_for_all(file):
    path = file(
        "drill_node:\n  ros__parameters: {weight_on_bit: 20.0}\n"
        "/**:\n  ros__parameters: {weight_on_bit: 5.0, gravity: 1.62}\n"
    )
    assert read_parameter_file(path) == {"weight_on_bit": 20.0, "gravity": 1.62}


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "is not a ROS parameter file: it holds no mapping"),
        ("weight_on_bit: 20.0\n", ": weight_on_bit has no mapping named ros__parameters"),
        ("/**:\n  ros__parameters: 3\n", ": /** has no mapping named ros__parameters"),
        ("/**: [\n", "is not YAML: while parsing"),
        ('"two\\nlines": 3', ": 'two\\nlines' has no mapping named ros__parameters"),
    ],
    ids=itertools.count(),
)
def test_a_file_that_is_no_parameter_file_is_one_line_with_its_name(file, text, complaint):
    path = file(text)
    with pytest.raises(ParameterError) as caught:
        read_parameter_file(path)
    assert str(caught.value).startswith(str(path))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("weight_on_bit=20", "weight_on_bit", 20),
        ("vibration_amplitude=1e-5", "vibration_amplitude", 1e-5),
        ("regime=free", "regime", "free"),
        ("drive_enabled=false", "drive_enabled", False),
        ("a=b=c", "a", "b=c"),
        ("a=", "a", None),
        ("a={", "a", "{"),
    ],
)
def test_an_assignment_is_read_as_yaml_and_every_number_as_a_number(text, name, value):
    assert parse_assignment(text) == (name, value)
    assert type(parse_assignment(text)[1]) is type(value)


@pytest.mark.parametrize("text", ["weight_on_bit", "=3", ""])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(ParameterError) as caught:
        parse_assignment(text)
    assert str(caught.value) == f"{text!r} is not of the form name=value"
