"""Settings: all parameters, checked together."""

import pytest

from rpud_sim.drilling.rock import RockParameters
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation import Parameters, preset
from rpud_sim.simulation.actuator import ActuatorParameters
from rpud_sim.simulation.configuration import (
    PARAMETERS,
    Configuration,
    Settings,
    to_settings,
)


@pytest.fixture
def scenario(tmp_path):
    path = tmp_path / "faults.yaml"
    path.write_text("seed: 7\nfaults: [{kind: free_mass_jammed, onset: {uniform: [1, 2]}}]")
    return path


def test_without_values_it_drills_with_the_paper_s():
    assert to_settings({}) == Settings()
    assert Settings().configuration == Configuration()
    assert to_settings({"regime": "free"}).configuration.parameters == preset("free")


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


def test_a_block_may_be_one_period_long():
    settings = to_settings({"block_duration": 0.01, "telemetry_rate": 100})
    assert settings.block_duration == 0.01
    assert to_settings({"block_duration": 0.001, "telemetry_rate": 1000}).telemetry_rate == 1000


def test_time_may_go_as_fast_as_possible_or_slowly():
    assert to_settings({"real_time_factor": 0}).real_time_factor == 0.0
    assert to_settings({"real_time_factor": 0.01}).real_time_factor == 0.01


def test_a_change_keeps_everything_else():
    settings = to_settings({"regime": "free", "weight_on_bit": 7.0, "seed": 3})
    changed = settings.replace({"regime": "drilling", "gravity": 1.62})
    for name in PARAMETERS:
        expected = {"regime": "drilling", "gravity": 1.62}.get(name, settings.value(name))
        assert changed.value(name) == expected, name


def test_a_scenario_is_drawn_with_the_seed_that_is_given_and_otherwise_with_its_own(scenario):
    own = to_settings({"scenario": str(scenario)})
    assert own.read_scenario().seed == 7
    assert own.read_scenario(0) == own.read_scenario()
    assert own.read_scenario(9).seed == 9
    seeded = to_settings({"scenario": str(scenario), "seed": 4})
    assert seeded.read_scenario().seed == 4
    assert seeded.read_scenario(9) == own.read_scenario(9) != own.read_scenario()
    assert Settings().read_scenario() is None


def test_a_scenario_that_is_missing_is_named_when_it_is_read_and_not_before():
    settings = to_settings({"scenario": "/missing.yaml"})
    with pytest.raises(ParameterError, match=r"^/missing\.yaml: No such file or directory$"):
        settings.read_scenario()
