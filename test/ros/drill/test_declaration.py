"""Parameters as ROS sees them: described, fixed or changeable, and changed together or not."""

import math
import threading
from itertools import pairwise

import pytest
import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.parameter import Parameter

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.ros.drill.managed_node import DrillParameters, declare_settings
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
    Settings,
    read_parameter_file,
)

FIXED = sorted(set(PARAMETERS) - set(CHANGEABLE))
FIXED_NOTE = "; fixed while the drill is configured"


@pytest.fixture
def node(nodes):
    def create(**values):
        overrides = [Parameter(name, value=value) for name, value in values.items()]
        nodes.append(rclpy.create_node("drill_node", parameter_overrides=overrides))
        return nodes[-1]

    return create


@pytest.fixture
def running(node):
    """Give a node that checks changes as the drill does, and the settings that they came to."""
    drill = node()
    taken = []
    taken.append(DrillParameters(drill, taken.append, lambda: "is fixed now").settings)
    return drill, taken


def test_every_parameter_is_declared_with_its_value_and_description_and_what_is_allowed(node):
    drill = node()
    settings = declare_settings(drill)
    assert settings == Settings()
    for name, descriptor in zip(
        PARAMETERS, drill.describe_parameters(list(PARAMETERS)), strict=True
    ):
        assert drill.get_parameter(name).value == settings.value(name), name
        assert descriptor.name == name
        assert descriptor.description, name
        assert not descriptor.read_only, name
        assert not descriptor.dynamic_typing, name
        constraints = descriptor.additional_constraints.removesuffix(FIXED_NOTE)
        assert (constraints != descriptor.additional_constraints) == (name in FIXED), name
        allowed = PARAMETERS[name].allowed
        if not isinstance(allowed, Quantity):
            assert constraints == allowed.range
            continue
        integer, double = ParameterType.PARAMETER_INTEGER, ParameterType.PARAMETER_DOUBLE
        assert descriptor.type == (integer if allowed.whole else double), name
        unit = {"seed": "", "thread_priority": ""}.get(name, f" [{allowed.unit or '1'}]")
        assert descriptor.description == allowed.description + unit
        assert constraints == f"in {allowed.range}"
        [limits] = [*descriptor.integer_range, *descriptor.floating_point_range]
        assert bool(descriptor.integer_range) == allowed.whole
        assert (limits.from_value, limits.to_value) == (allowed.minimum, allowed.maximum)


OTHER = {"weight_on_bit": 12.0, "telemetry_rate": 200, "scenario": "s.yaml", "autostart": False}


@pytest.mark.parametrize("name", [*OTHER, "use_sim_time"])
def test_what_is_fixed_does_not_change_and_the_reason_names_it(running, name):
    drill, taken = running
    before = drill.get_parameter(name).value
    [result] = drill.set_parameters([Parameter(name, value=OTHER.get(name, True))])
    command = (
        "; command it on command/weight_on_bit, as `rpud press 12` does"
        if name == "weight_on_bit"
        else ""
    )
    assert (result.successful, result.reason) == (False, f"{name} is fixed now{command}")
    assert drill.get_parameter(name).value == before
    assert drill.set_parameters([Parameter(name, value=before)])[0].successful  # as in a dump
    assert set(taken) == {Settings()}


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("gravity", math.nan, "gravity out of range"),
        ("gravity", "heavy", "expected 'Type.DOUBLE'"),
        ("rpud_damping_ratio", 1.0, "rpud_damping_ratio = 1 is outside its range [0, 1)"),
        ("regime", "moon", "regime = 'moon' is not one of free, drilling"),
        ("real_time_factor", 0.001, "real_time_factor = 0.001 is neither 0, as fast as possible"),
    ],
)
def test_a_change_that_cannot_be_used_changes_nothing(running, name, value, reason):
    drill, taken = running
    before = drill.get_parameter(name).value
    [result] = drill.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert reason in result.reason
    assert drill.get_parameter(name).value == before
    assert len(taken) == 1


def test_parameters_of_every_ros_node_and_of_others_are_let_through(node):
    drill, taken = node(**{"use_sim_time": False, "qos_overrides./clock.depth": 10}), []
    assert DrillParameters(drill, taken.append, lambda: "is fixed now").settings == Settings()
    drill.declare_parameter("of_another", 1)
    [result] = drill.set_parameters([Parameter("of_another", value=2)])
    assert result.successful
    assert taken == []


def test_a_change_during_a_reset_is_not_lost(node, monkeypatch):
    drill = node()
    parameters = DrillParameters(drill, lambda settings: None, lambda: "")
    read = drill.get_parameter
    change = [Parameter("command_loss_ramp", value=3.0)]
    client = threading.Thread(target=lambda: drill.set_parameters(change))
    resetting = threading.current_thread()

    def read_slowly(name):
        found = read(name)
        reset = read("command_timeout").value == 2.0 and threading.current_thread() is resetting
        if name == "command_loss_ramp" and reset and not client.ident:
            # The client changes what the reset has read, and has not yet taken.
            client.start()
            client.join(1.0)  # until it is done, or waits for the reset
        return found

    monkeypatch.setattr(drill, "get_parameter", read_slowly)
    parameters.restore(parameters.settings.replace({"command_timeout": 2.0}))
    client.join()
    settings = parameters.settings
    assert (settings.command_timeout, settings.command_loss_ramp) == (2.0, 3.0)


SECTIONS = ["/**", "/*/drill_node", "/**/drill_node", "left/drill_node", "/left/drill_node"]
SECTIONS += ["/left/*", "/left/**", "/right/drill_node", "gripper_node", "/left", "/*"]


# Each before and after its neighbours, and one twice.
@pytest.mark.parametrize(("section", "other"), pairwise([*SECTIONS, *reversed(SECTIONS)]))
def test_a_parameter_file_means_what_it_means_to_a_node(nodes, tmp_path, section, other):
    """Of two sections that fit the later one counts, in a file that starts with another node's."""
    path = tmp_path / "several.yaml"
    text = "left: {drill_node: {ros__parameters: {weight_on_bit: 9.0}}}\n"
    text += f"{section}: {{ros__parameters: {{weight_on_bit: 11.0}}}}\n"
    if other != section:
        text += f"{other}: {{ros__parameters: {{weight_on_bit: 22.0}}}}\n"
    path.write_text(text)
    options = ["--ros-args", "--params-file", str(path)]
    node = rclpy.create_node("drill_node", namespace="/left", cli_args=options)
    nodes.append(node)
    read = read_parameter_file(path, "/left/drill_node")
    assert read == {"weight_on_bit": node.declare_parameter("weight_on_bit", 0.0).value}
