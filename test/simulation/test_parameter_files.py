"""Parameter files and assignments, read without ROS."""

import itertools

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.configuration import parse_assignment, read_parameter_file


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
