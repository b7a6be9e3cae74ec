"""Parameter files and assignments, read without ROS."""

from pathlib import Path

import pytest

from rpud_sim.simulation import NAMES, ParameterError, Parameters, preset
from rpud_sim.simulation.configuration import (
    NODE_NAMES,
    parse_assignment,
    read_parameter_file,
    to_parameters,
)

CONFIG = Path(__file__).parents[2] / "config"


@pytest.fixture
def file(tmp_path):
    def write(text):
        path = tmp_path / "file.yaml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_configuration_files_are_the_presets(regime):
    values = read_parameter_file(CONFIG / f"{regime}.yaml")
    assert to_parameters(values) == preset(regime)
    # Said in the file, not taken from the preset.
    assert values["regime"] == regime
    assert values["weight_on_bit"] == preset(regime).weight_on_bit
    assert values.keys() <= {*NAMES, *NODE_NAMES}


def test_there_is_a_file_for_every_regime():
    assert {path.stem for path in CONFIG.glob("*.yaml")} >= {"free", "drilling"}


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
        ("- 1\n- 2\n", "is not a ROS parameter file: it holds no mapping"),
        ("weight_on_bit: 20.0\n", "weight_on_bit has no mapping named ros__parameters"),
        ("/**: {weight_on_bit: 20.0}\n", "/** has no mapping named ros__parameters"),
        ("/**:\n  ros__parameters: 3\n", "/** has no mapping named ros__parameters"),
        ("/**: [\n", "is not YAML: while parsing"),
        (b"\xff\xfe\x00\x01\xff", "is not YAML: "),
        ("/**:\n\tros__parameters: {}\n", "is not YAML: "),
        ("!!python/object/apply:os.system ['true']", "is not YAML: could not determine"),
    ],
)
def test_a_file_that_is_no_parameter_file_is_one_line_with_its_name(file, text, complaint):
    path = file(text)
    with pytest.raises(ParameterError) as caught:
        read_parameter_file(path)
    assert str(caught.value).startswith(str(path))
    assert complaint in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(ParameterError, match=r"missing\.yaml: No such file or directory$"):
        read_parameter_file(tmp_path / "missing.yaml")
    with pytest.raises(ParameterError, match=r"Is a directory$"):
        read_parameter_file(tmp_path)


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("weight_on_bit=20", "weight_on_bit", 20),
        ("weight_on_bit=2.5", "weight_on_bit", 2.5),
        ("vibration_amplitude=1e-5", "vibration_amplitude", 1e-5),
        ("elastic_modulus=1.96e11", "elastic_modulus", 1.96e11),
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


@pytest.mark.parametrize("value", ["nan", ".nan", "-.inf", "inf", "1e999", "-1e9", "true", ""])
def test_an_assignment_of_no_usable_number_is_refused_by_name(value):
    with pytest.raises(ParameterError, match=r"weight_on_bit = .* N is outside its range"):
        to_parameters(dict([parse_assignment(f"weight_on_bit={value}")]))


def test_a_quoted_number_is_text_as_it_is_for_ros(file):
    assert read_parameter_file(file("/**: {ros__parameters: {a: '1e-3', b: 1e-3}}")) == {
        "a": "1e-3",
        "b": 1e-3,
    }


@pytest.mark.parametrize("text", ["weight_on_bit", "=3", ""])
def test_what_is_no_assignment_is_refused(text):
    with pytest.raises(ParameterError) as caught:
        parse_assignment(text)
    assert str(caught.value) == f"{text!r} is not of the form name=value"


def test_the_regime_chooses_the_preset():
    assert to_parameters({}) == preset("drilling") == Parameters()
    assert to_parameters({"regime": "free"}) == preset("free")
    assert to_parameters({"regime": "free", "weight_on_bit": 3}).weight_on_bit == 3.0


def test_the_node_s_own_parameters_are_passed_over():
    assert to_parameters(dict.fromkeys(NODE_NAMES)) == Parameters()


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"wieght_on_bit": 20.0}, "wieght_on_bit is not a parameter; known are rpud_mass, "),
        ({"regime": "moon"}, "regime = 'moon' is not one of free, drilling"),
        ({"regime": 3}, "regime = 3 is not one of free, drilling"),
        ({"contact_model": "x"}, "contact_model = 'x' is not one of printed, rayleigh"),
        ({"free_mass": 0}, "free_mass = 0 kg is outside its range (0, 10] kg"),
        ({"rpud_damping_ratio": 1.0}, "rpud_damping_ratio = 1 is outside its range [0, 1)"),
    ],
)
def test_what_cannot_be_used_is_named(values, complaint):
    with pytest.raises(ParameterError) as caught:
        to_parameters(values)
    assert str(caught.value).startswith(complaint)


def test_an_unknown_name_is_told_which_names_there_are():
    with pytest.raises(ParameterError) as caught:
        to_parameters({"unknown": 1})
    for name in (*NAMES, *NODE_NAMES):
        assert name in str(caught.value)
