"""All parameters of a drill and of a run, checked together, and the files that hold them."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import refusal

from rpud_sim.foundation.quantities import ParameterError, quantities
from rpud_sim.model.engine import EngineError
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
from rpud_sim.simulation.simulation import Simulation

CONFIG = Path(__file__).parents[2] / "config"


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_configuration_files_are_the_presets(regime):
    values = read_parameter_file(CONFIG / f"{regime}.yaml")
    assert to_configuration(values).parameters == preset(regime)
    # Said in the file, not taken from the preset.
    assert values["regime"] == regime
    assert values["weight_on_bit"] == preset(regime).weight_on_bit


def test_a_drive_that_would_break_the_stack_is_refused_and_any_nominal_one_is_not():
    configuration = to_configuration({"nominal_voltage": 10.0, "vibration_amplitude": 35e-6})
    # Even off resonance, because the resonance may drift there.
    assert refusal(configuration.check, Drive(True, 500.0, 20000.0)) == (
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
NAMES = st.sampled_from(list(PARAMETERS)) | st.text()


@given(values=st.dictionaries(NAMES, VALUES, max_size=4))
def test_any_values_are_a_configuration_or_refused_in_one_line(values):
    assert len(refusal(to_configuration, values)) < 2000


def test_settings_are_what_was_given_in_the_type_of_each_parameter():
    values = {
        "weight_on_bit": 20,
        "nominal_voltage": 60,
        "actuator_model": "resonance",
        "drive_enabled": False,
        "start_paused": True,
        "command_timeout": 0.2,
        "telemetry_rate": 250.0,
        "block_duration": 1,
        "seed": 5.0,
    }
    settings = to_settings(values)
    for name, declaration in PARAMETERS.items():
        assert settings.value(name) == values.get(name, declaration.default), name
        assert type(settings.value(name)) is type(declaration.default), name
    assert to_settings({}) == Settings()
    # The ends of what belongs together.
    for values in ({"block_duration": 0.01, "telemetry_rate": 100}, {"real_time_factor": 0.01}):
        assert all(to_settings(values).value(name) == values[name] for name in values)


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"wieght_on_bit": 1.0}, "wieght_on_bit is not a parameter; did you mean weight_on_bit?"),
        ({"two\nlines": 1}, "'two\\nlines' is not a parameter; the nearest of "),
        ({"real_time_factor": 0.005}, "real_time_factor = 0.005 is neither 0, as fast as "),
        ({"heating": True}, "heating = True needs actuator_model = resonance"),
        (
            {"block_duration": 0.005, "telemetry_rate": 100},
            "block_duration = 0.005 s is shorter than one period of telemetry_rate = 100 Hz",
        ),
    ],
)
def test_what_cannot_be_used_is_named(values, complaint):
    assert refusal(to_settings, values).startswith(complaint)


def test_a_change_keeps_everything_else():
    settings = to_settings({"regime": "free", "weight_on_bit": 7.0, "seed": 3})
    changed = settings.replace({"regime": "drilling", "gravity": 1.62})
    assert changed.values() == {**settings.values(), "regime": "drilling", "gravity": 1.62}
    # A drill ignores what belongs to the run.
    assert to_configuration(dict.fromkeys(NODE_NAMES, "anything")) == Configuration()


def test_a_parameter_file_has_sections_of_several_nodes(tmp_path):
    path = tmp_path / "file.yaml"
    path.write_text(
        "/**:\n  ros__parameters: {weight_on_bit: 5.0, gravity: 1.62}\n"
        "gripper_node:\n  ros__parameters: {weight_on_bit: 33.0, fingers: 3}\n"
        "drill_node:\n  ros__parameters: {weight_on_bit: 20.0}\n"
        "left:\n  drill_node:\n    ros__parameters: {weight_on_bit: 11.0}\n"
    )
    assert read_parameter_file(path) == {"weight_on_bit": 20.0, "gravity": 1.62}
    left = read_parameter_file(path, "/left/drill_node")
    assert left == {"weight_on_bit": 11.0, "gravity": 1.62}


def test_a_section_for_several_nodes_may_have_parameters_of_others(tmp_path):
    path, lines = tmp_path / "robot.yaml", []
    path.write_text(
        "/**:\n  ros__parameters: {use_sim_time: true, weight_on_bit: 5.0, max_speed: 3}\n"
        "/rpud/drill_node:\n  ros__parameters:\n    gravity: 1.62\n"
        "    qos_overrides: {/clock: {subscription: {depth: 1}}}\n"
    )
    found = read_parameter_file(path, passed=lines.append)
    assert found == {"weight_on_bit": 5.0, "gravity": 1.62}
    names = "max_speed, qos_overrides, use_sim_time"
    assert lines == [f"{path}: left out, not parameters of the drill: {names}"]
    path.write_text("drill_node:\n  ros__parameters: {max_speed: 3}\n")
    assert "'max_speed' is not a key here" in refusal(read_parameter_file, path)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", ":1: nothing is for /rpud/drill_node: the file has no ros__parameters"),
        ("[]", ":1: the file is not a mapping"),
        ("/**:\n  ros__parameters: 3\n", ":2: ros__parameters = 3 is not a mapping"),
        ("/**:\n  ros__parameters: {gravity: -1}", ":2: gravity = -1 m/s^2 is outside its range"),
        (
            "/right/drill_node:\n  ros__parameters: {gravity: 1.62}\n",
            "nothing is for /rpud/drill_node: the file has /right/drill_node",
        ),
        ('"two\\nlines": 3', ":1: 'two\\nlines' = 3 is not a mapping"),
    ],
)
def test_a_file_that_is_no_parameter_file_is_one_line_with_its_name(tmp_path, text, complaint):
    path = tmp_path / "file.yaml"
    path.write_text(text)
    found = refusal(read_parameter_file, path)
    assert found.startswith(str(path))
    assert complaint in found


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("weight_on_bit=20", 20),
        ("regime=free", "free"),
        ("drive_enabled=off", False),
        ("a=b=c", "b=c"),
        ("a=", None),
    ],
)
def test_an_assignment_is_read_as_yaml_and_every_number_as_a_number(text, expected):
    name, value = parse_assignment(text)
    assert name == text.partition("=")[0]
    assert value == expected
    assert type(value) is type(expected)


@pytest.mark.parametrize("text", ["weight_on_bit", "=3", ""])
def test_what_is_no_assignment_is_refused(text):
    assert refusal(parse_assignment, text) == f"{text!r} is not of the form name=value"


MILLISECOND = 1_000_000
KINDS = (("free", "gain"), ("drilling", "gain"), ("drilling", "resonance"))
NUMBERS = {**quantities(Parameters), **quantities(ActuatorParameters)}


def ends(allowed):
    least = math.nextafter(allowed.minimum, math.inf) if allowed.exclusive else allowed.minimum
    most = math.nextafter(allowed.maximum, -math.inf) if allowed.below else allowed.maximum
    return float(least), float(most)


def check(simulation, until):
    block = simulation.advance_to(until)
    for records in (block.segments, block.impacts):
        for name in records.dtype.names:
            assert np.isfinite(records[name]).all(), name
    assert math.isfinite(block.actuator.amplitude)


@pytest.mark.parametrize("name", NUMBERS)
def test_the_motion_is_finite_at_the_ends_of_the_range(name):
    kinds = KINDS[:1] if name == "free_mass" else KINDS  # at its end each takes seconds
    for value, (regime, model) in itertools.product(ends(NUMBERS[name]), kinds):
        values = {"regime": regime, "actuator_model": model, name: value}
        if model == "resonance":
            values |= {"generator": "tracking", "heating": True}
        if name.startswith("effective_tool"):
            values["contact_model"] = "given"
        try:
            simulation = Simulation(to_configuration(values))
            for until in (1, 2, 5):
                check(simulation, until * MILLISECOND)
        except ParameterError:  # values that do not go together
            continue
        except EngineError as error:
            if "events" not in str(error):
                raise
