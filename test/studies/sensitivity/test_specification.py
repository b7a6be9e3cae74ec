"""Specification of a sensitivity study: what is refused, each in one line with the entry."""

from pathlib import Path

import pytest

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.studies.sensitivity.specification import (
    SensitivityError,
    parse_specification,
    read_specification,
)

ROOT = Path(__file__).parents[3]
MASS = {"minimum": 4e-3, "maximum": 6e-3, "source": "measured"}


def test_the_studys_file_in_config_is_valid_and_names_a_source_of_every_interval():
    specification = read_specification(ROOT / "config" / "sensitivity.yaml")
    assert len(specification.inputs) == 14
    assert all(interval.source for interval in specification.inputs.values())
    assert specification.simulations == 256 * (14 + 1 + 2)


def test_what_is_not_given_has_a_default():
    specification = parse_specification({"inputs": {"free_mass": MASS}})
    assert (specification.samples, specification.seed) == (256, 0)
    assert specification.parameters({"free_mass": 5e-3}).regime == "drilling"


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (None, "is empty"),
        ([], "the file: holds no mapping"),
        ({}, "inputs: holds no mapping"),
        ({"inputs": {}}, "inputs: names no parameter"),
        ({"input": {}}, "input is unknown; did you mean inputs?"),
        ({"inputs": {"fre_mass": MASS}}, "inputs.fre_mass is unknown; did you mean free_mass?"),
        ({"inputs": {"regime": MASS}}, "inputs.regime is unknown"),
        ({"inputs": {"free_mass": 3}}, "inputs.free_mass: holds no mapping"),
        ({"inputs": {"free_mass": {"minimum": 1e-3}}}, "inputs.free_mass.maximum: is missing"),
        (
            {"inputs": {"free_mass": MASS | {"minimum": 7e-3}}},
            "inputs.free_mass: minimum 0.007 is not below maximum 0.006",
        ),
        (
            {"inputs": {"free_mass": MASS | {"minimum": 0.0}}},
            r"inputs.free_mass.minimum = 0 kg is outside its range \[1e-12, 10\] kg",
        ),
        ({"inputs": {"free_mass": MASS | {"source": 7}}}, "inputs.free_mass.source: 7 is not a"),
        ({"inputs": {"free_mass": MASS}, "samples": 100}, "samples = 100 is no power of two"),
        ({"inputs": {"free_mass": MASS}, "duration": "x"}, "duration = 'x' s is outside its range"),
        (
            {"inputs": {"free_mass": MASS}, "fixed": {"free_mass": 1e-3}},
            "inputs.free_mass: is fixed as well",
        ),
        (
            {"inputs": {"free_mass": MASS}, "fixed": {"gravity": -1.0}},
            r"gravity = -1 m/s\^2 is outside its range",
        ),
    ],
)
def test_a_mistake_is_named(content, reason):
    with pytest.raises((SensitivityError, ParameterError), match=f"^{reason}"):
        parse_specification(content)


def test_a_mistake_in_a_file_begins_with_its_name(tmp_path):
    path = tmp_path / "study.yaml"
    path.write_text("samples: 3\ninputs: {free_mass: {minimum: 1, maximum: 2, source: x}}\n")
    with pytest.raises(SensitivityError, match=r"study\.yaml: samples = 3 is no power of two"):
        read_specification(path)
    with pytest.raises(SensitivityError, match=r"^\S+none\.yaml: No such file"):
        read_specification(tmp_path / "none.yaml")
