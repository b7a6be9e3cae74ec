"""The drill node's parameters: checked, described, and read-only once it runs."""

import dataclasses
import math

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from rpud_sim.ros.parameters import Settings, check_settings, declare_settings
from rpud_sim.simulation import NAMES, QUANTITIES, ParameterError, Parameters, preset
from rpud_sim.simulation.configuration import NODE_NAMES

EVERY = (*NAMES, *NODE_NAMES)
NUMBERS = {*EVERY} - {"contact_model", "regime", "drive_enabled", "publish_clock"}


@pytest.fixture
def node():
    rclpy.init()
    made = []

    def create(**values):
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        made.append(rclpy.create_node("drill_node", parameter_overrides=overrides))
        return made[-1]

    yield create
    for each in made:
        each.destroy_node()
    rclpy.try_shutdown()


def test_without_values_it_drills_with_the_paper_s():
    assert check_settings({}) == Settings(Parameters())
    assert check_settings({"regime": "free"}).parameters == preset("free")


def test_settings_are_what_was_given_and_whole_rates_are_integers():
    settings = check_settings(
        {
            "weight_on_bit": 20,
            "telemetry_rate": 250.0,
            "sample_rate": 48000,
            "block_duration": 1,
            "nominal_voltage": 60,
            "drive_enabled": False,
            "publish_clock": True,
        }
    )
    assert settings == Settings(Parameters(weight_on_bit=20.0), False, 60.0, 250, 48000, 1.0, True)
    assert type(settings.telemetry_rate) is type(settings.sample_rate) is int
    assert type(settings.block_duration) is type(settings.nominal_voltage) is float


@pytest.mark.parametrize(
    ("values", "complaint"),
    [
        ({"drive_enabled": 1}, "drive_enabled = 1 is not true or false"),
        ({"publish_clock": "yes"}, "publish_clock = 'yes' is not true or false"),
        ({"telemetry_rate": 0}, "telemetry_rate = 0 Hz is outside its range [1, 1000] Hz"),
        ({"telemetry_rate": 1001}, "telemetry_rate = 1001 Hz is outside its range [1, 1000] Hz"),
        ({"telemetry_rate": 33.3}, "telemetry_rate = 33.3 Hz is not a whole number"),
        ({"telemetry_rate": math.nan}, "telemetry_rate = nan Hz is outside its range"),
        ({"sample_rate": 44100.5}, "sample_rate = 44100.5 Hz is not a whole number"),
        ({"sample_rate": 2e6}, "sample_rate = 2e+06 Hz is outside its range [1, 1e+06] Hz"),
        ({"block_duration": 0.0}, "block_duration = 0 s is outside its range [0.001, 1] s"),
        ({"block_duration": True}, "block_duration = True s is outside its range"),
        ({"nominal_voltage": 0}, "nominal_voltage = 0 V is outside its range (0, 1000] V"),
        ({"nominal_voltage": "100"}, "nominal_voltage = '100' V is outside its range"),
        ({"weight_on_bit": -1}, "weight_on_bit = -1 N is outside its range [0, 1000] N"),
        ({"wieght_on_bit": 1.0}, "wieght_on_bit is not a parameter; known are "),
        (
            {"block_duration": 0.005, "telemetry_rate": 100},
            "block_duration = 0.005 s is shorter than one period of telemetry_rate = 100 Hz",
        ),
    ],
)
def test_what_cannot_be_used_is_named(values, complaint):
    with pytest.raises(ParameterError) as caught:
        check_settings(values)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)


def test_a_block_may_be_one_period_long():
    settings = check_settings({"block_duration": 0.01, "telemetry_rate": 100})
    assert settings.block_duration == 0.01
    assert check_settings({"block_duration": 0.001, "telemetry_rate": 1000}).telemetry_rate == 1000


def test_settings_do_not_change():
    with pytest.raises(dataclasses.FrozenInstanceError):
        check_settings({}).telemetry_rate = 5


def test_every_parameter_is_declared_with_its_value(node):
    drill = node()
    settings = declare_settings(drill)
    assert settings == Settings(Parameters())
    for name in EVERY:
        value = getattr(settings.parameters if name in NAMES else settings, name)
        assert drill.get_parameter(name).value == value, name


def test_every_parameter_says_what_it_is(node):
    drill = node()
    declare_settings(drill)
    for name in EVERY:
        described = drill.describe_parameter(name)
        assert described.name == name
        assert described.description, name
        assert described.read_only, name
        assert not described.dynamic_typing, name


def test_every_number_has_its_unit_and_its_range(node):
    drill = node()
    declare_settings(drill)
    for name in NUMBERS:
        described = drill.describe_parameter(name)
        assert described.type == ParameterType.PARAMETER_DOUBLE, name
        [allowed] = described.floating_point_range
        assert allowed.from_value < allowed.to_value, name
        assert described.additional_constraints.startswith("in "), name
        if name in QUANTITIES:
            quantity = QUANTITIES[name]
            assert described.description.endswith(f"[{quantity.unit or '1'}]")
            assert described.additional_constraints == f"in {quantity.range}"
            assert (allowed.from_value, allowed.to_value) == (quantity.minimum, quantity.maximum)
    assert "one of free, drilling" in drill.describe_parameter("regime").additional_constraints
    assert (
        "one of printed, rayleigh"
        in drill.describe_parameter("contact_model").additional_constraints
    )


def test_the_regime_chooses_the_defaults_and_a_whole_number_is_a_number(node):
    drill = node(regime="free", gravity=2, vibration_frequency=20000)
    settings = declare_settings(drill)
    assert settings.parameters == preset("free").replace(gravity=2.0, vibration_frequency=2e4)
    assert drill.get_parameter("weight_on_bit").value == 0.0
    assert drill.get_parameter("gravity").value == 2.0
    assert drill.get_parameter("gravity").type_ == Parameter.Type.DOUBLE


@pytest.mark.parametrize("name", EVERY)
def test_no_parameter_changes_while_it_runs_and_the_reason_is_said(node, name):
    drill = node()
    declare_settings(drill)
    before = drill.get_parameter(name).value
    [result] = drill.set_parameters([Parameter(name, value=before)])
    assert not result.successful
    assert "read-only" in result.reason
    assert drill.get_parameter(name).value == before


@pytest.mark.parametrize(
    ("name", "value", "complaint"),
    [
        ("weight_on_bit", "heavy", "weight_on_bit = 'heavy' N is outside its range [0, 1000] N"),
        ("weight_on_bit", True, "weight_on_bit = True N is outside its range [0, 1000] N"),
        ("weight_on_bit", math.nan, "weight_on_bit = nan N is outside its range [0, 1000] N"),
        ("weight_on_bit", [1.0, 2.0], "weight_on_bit = [1.0, 2.0] N is outside its range"),
        ("regime", 3, "regime = 3 is not one of free, drilling"),
        ("regime", "moon", "regime = 'moon' is not one of free, drilling"),
        ("drive_enabled", "off", "drive_enabled = 'off' is not true or false"),
        ("telemetry_rate", 33.3, "telemetry_rate = 33.3 Hz is not a whole number"),
    ],
)
def test_an_override_that_cannot_be_used_is_named(node, name, value, complaint):
    drill = node(**{name: value})
    with pytest.raises(ParameterError) as caught:
        declare_settings(drill)
    assert str(caught.value).startswith(complaint)
    assert "\n" not in str(caught.value)
