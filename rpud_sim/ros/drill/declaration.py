"""Declares the drill node's ROS parameters: with ranges and descriptions, read-only or not."""

from __future__ import annotations

from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpud_sim.foundation.parameters import Declaration
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.simulation.configuration import CHANGEABLE, PARAMETERS, Settings, to_settings


def declare_settings(node: Node) -> Settings:
    """Declare all parameters on the node and return the settings that they hold.

    A whole number is taken where a number is meant, as in ``weight_on_bit: 20``. All but
    ``CHANGEABLE`` are read-only once the node runs.

    Raises:
        ParameterError: if a value cannot be used.
    """
    values: dict[str, Any] = {"regime": _declare(node, "regime", "drilling")}
    defaults = to_settings(values).values()
    for name in PARAMETERS:
        if name not in values:
            values[name] = _declare(node, name, defaults[name])
    settings = to_settings(values)
    checked = settings.values()
    for declaration in PARAMETERS.values():
        _describe(node, declaration, checked[declaration.name])
    return settings


def check_changes(settings: Settings, changes: list[Parameter]) -> SetParametersResult:
    """Check values that are about to be set, all together, on a node that has settings."""
    try:
        settings.replace(changed_values(changes))
    except ParameterError as error:
        return SetParametersResult(successful=False, reason=str(error))
    return SetParametersResult(successful=True)


def changed_values(changes: list[Parameter]) -> dict[str, Any]:
    """Return those of the parameters that may change while the drill runs, by name."""
    return {change.name: change.value for change in changes if change.name in CHANGEABLE}


def _declare(node: Node, name: str, default: Any) -> Any:
    """Declare a parameter of any type, so that a wrong one gets our error; return its value."""
    if isinstance(default, int) and not isinstance(default, bool):
        default = float(default)
    return node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value


def _describe(node: Node, declaration: Declaration, value: Any) -> None:
    """Give a declared parameter its checked value and its final descriptor."""
    allowed = declaration.allowed
    descriptor = ParameterDescriptor(
        name=declaration.name,
        description=allowed.description,
        additional_constraints=allowed.range,
        read_only=not declaration.changeable,
    )
    if isinstance(allowed, Quantity):
        value = float(value)
        descriptor.description += f" [{allowed.unit or '1'}]"
        descriptor.additional_constraints = f"in {allowed.range}"
        limits = FloatingPointRange(from_value=allowed.minimum, to_value=allowed.maximum)
        descriptor.floating_point_range = [limits]
    parameter = Parameter(declaration.name, value=value)
    descriptor.type = parameter.type_.value
    node.set_parameters([parameter])
    node.set_descriptor(declaration.name, descriptor)
