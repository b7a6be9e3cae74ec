import pytest
import yaml

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.testing.setup import drill_setup

JAM = {"kind": "free_mass_jammed", "onset": 0.5, "duration": 1.0}


@pytest.fixture
def folder(tmp_path):
    parameters = {"weight_on_bit": 20, "seed": 5, "start_paused": False, "scenario": "jam.yaml"}
    config = {"/**": {"ros__parameters": parameters}}
    (tmp_path / "drill.yaml").write_text(yaml.safe_dump(config))
    (tmp_path / "jam.yaml").write_text(yaml.safe_dump({"faults": [JAM]}))
    return tmp_path


def test_without_options_the_drill_is_the_default_one():
    setup = drill_setup({})
    assert (setup.parameters, setup.seed, setup.namespace) == ({}, -1, "/rpud")
    assert yaml.safe_load(setup.scenario) == {"faults": []}


def test_a_file_of_parameters_gives_what_the_options_do_not(folder):
    setup = drill_setup({"config": "drill.yaml", "regime": "free"}, [folder])
    assert setup.parameters == {"weight_on_bit": 20, "regime": "free"}
    assert setup.seed == 5
    assert yaml.safe_load(setup.scenario) == {"faults": [JAM]}
    assert drill_setup({"config": "drill.yaml", "seed": 7}, [folder]).seed == 7


@pytest.mark.parametrize("faults", ["jam.yaml", JAM, [JAM]])
def test_faults_are_a_file_or_entries(folder, faults):
    assert yaml.safe_load(drill_setup({"faults": faults}, [folder]).scenario) == {"faults": [JAM]}


@pytest.mark.parametrize("faults", ["free_mass_jammed", ["free_mass_jammed"]])
def test_a_kind_alone_begins_at_once(faults):
    [fault] = yaml.safe_load(drill_setup({"faults": faults}).scenario)["faults"]
    assert fault == {"kind": "free_mass_jammed", "onset": 0.0}


@pytest.mark.parametrize(
    ("options", "text"),
    [
        ({"weight_on_bit": -3.0}, "weight_on_bit = -3 N is outside its range"),
        ({"config": "a" * 5000}, "config = 'aaaaa"),
        ({"config": "nowhere.yaml"}, "config = 'nowhere.yaml' is not a file"),
        ({"config": 3}, "config = 3 is not a path"),
        ({"faults": "free_mass_jamed"}, "did you mean free_mass_jammed?"),
        ({"publish_clock": True}, "publish_clock cannot be set: a drill of a test runs in lock"),
        ({"scenario": "jam.yaml"}, "scenario cannot be set: give faults="),
        ({"namespace": "rpud"}, "namespace = 'rpud' is not of the form /name"),
    ],
)
def test_what_cannot_be_used_is_refused_in_one_line(options, text):
    with pytest.raises(ParameterError) as error:
        drill_setup(options)
    assert text in str(error.value)
    assert "\n" not in str(error.value)
