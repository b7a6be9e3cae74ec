"""ROS parameters of the drill node: with ranges and descriptions, read-only or changeable."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from rpud_sim.foundation.parameters import Declaration
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.simulation.configuration import CHANGEABLE, PARAMETERS, Settings, to_settings

# Parameters that every ROS node may be started with; some are declared later than ours.
_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class DrillParameters:
    """Parameters of the drill node, and the settings that they hold.

    ``changed`` is called with the settings after each change of a parameter of the drill.
    """

    def __init__(self, node: Node, changed: Callable[[Settings], None]) -> None:
        self._node = node
        self._changed = changed
        self._settings = declare_settings(node)
        # A reset sets parameters in the pacing thread, a service in another one.
        self._applying = threading.Lock()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    @property
    def settings(self) -> Settings:
        return self._settings

    def restore(self, settings: Settings) -> None:
        """Set the changeable parameters to the values of these settings."""
        self._node.set_parameters_atomically(
            [
                Parameter(name, value=settings.value(name))
                for name in CHANGEABLE
                if self._node.get_parameter(name).value != settings.value(name)
            ]
        )

    def _check(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            self._settings.replace(
                {change.name: change.value for change in changes if change.name in CHANGEABLE}
            )
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[Parameter]) -> None:
        if not any(change.name in CHANGEABLE for change in changes):
            return
        # All of them: a reset may set others back at the same time.
        with self._applying:
            values = {name: self._node.get_parameter(name).value for name in CHANGEABLE}
            self._settings = self._settings.replace(values)
        self._changed(self._settings)


def declare_settings(node: Node) -> Settings:
    """Declare all parameters on the node and return the settings that they hold.

    A whole number is accepted for a number, as in ``weight_on_bit: 20``. All but ``CHANGEABLE`` are
    read-only once the node runs.
    """
    values: dict[str, Any] = {"regime": _declare(node, "regime", "drilling")}
    defaults = to_settings(values).values()
    for name in PARAMETERS:
        if name not in values:
            values[name] = _declare(node, name, defaults[name])
    settings = to_settings({**_unknown(node), **values})
    checked = settings.values()
    for declaration in PARAMETERS.values():
        _describe(node, declaration, checked[declaration.name])
    node.add_pre_set_parameters_callback(_to_numbers)
    return settings


def _declare(node: Node, name: str, default: Any) -> Any:
    """Declare a parameter of any type, so that a wrong one gets our error; return its value."""
    if isinstance(default, int) and not isinstance(default, bool):
        default = float(default)
    return node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value


def _unknown(node: Node) -> dict[str, Any]:
    return {
        name: parameter.value
        for name, parameter in node._parameter_overrides.items()
        if not (node.has_parameter(name) or name.startswith(_OF_ROS))
    }


def _to_numbers(changes: list[Parameter]) -> list[Parameter]:
    return [
        Parameter(change.name, value=float(change.value))
        if change.type_ == Parameter.Type.INTEGER and _is_number(change.name)
        else change
        for change in changes
    ]


def _is_number(name: str) -> bool:
    return name in PARAMETERS and isinstance(PARAMETERS[name].allowed, Quantity)


def _description(quantity: Quantity) -> str:
    """Return the description of a number with its unit; a count or a seed has none."""
    unit = quantity.unit or ("" if quantity.whole else "1")
    return f"{quantity.description} [{unit}]" if unit else quantity.description


def _describe(node: Node, declaration: Declaration, value: Any) -> None:
    allowed = declaration.allowed
    descriptor = ParameterDescriptor(
        name=declaration.name,
        description=allowed.description,
        additional_constraints=allowed.range,
        read_only=not declaration.changeable,
    )
    if isinstance(allowed, Quantity):
        value = float(value)
        descriptor.description = _description(allowed)
        descriptor.additional_constraints = f"in {allowed.range}"
        limits = FloatingPointRange(from_value=allowed.minimum, to_value=allowed.maximum)
        descriptor.floating_point_range = [limits]
    parameter = Parameter(declaration.name, value=value)
    descriptor.type = parameter.type_.value
    node.set_parameters([parameter])
    node.set_descriptor(declaration.name, descriptor)
