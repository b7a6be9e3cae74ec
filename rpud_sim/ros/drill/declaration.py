"""ROS parameters of the drill node: with ranges and descriptions, fixed or changeable."""

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
_FIXED = {*PARAMETERS, "use_sim_time"} - {*CHANGEABLE}  # while the drill is configured


class DrillParameters:
    """Parameters of the drill node, and the settings that they hold.

    ``changed`` is called with the settings after each change of a parameter of the drill.
    ``fixed`` says why all but the changeable ones have to stay as they are; empty if they may
    change.
    """

    def __init__(
        self, node: Node, changed: Callable[[Settings], None], fixed: Callable[[], str]
    ) -> None:
        self._node = node
        self._changed = changed
        self._fixed = fixed
        self.settings = declare_settings(node)
        # A reset sets parameters in the pacing thread, a service in another one.
        self._applying = threading.Lock()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def restore(self, settings: Settings) -> None:
        """Set the changeable parameters to the values of these settings."""
        self._node.set_parameters_atomically(
            [
                Parameter(name, value=settings.value(name))
                for name in CHANGEABLE
                if self._value(name) != settings.value(name)
            ]
        )

    def _check(self, changes: list[Parameter]) -> SetParametersResult:
        if fixed := self._fixed():
            for change in changes:
                # The present value is no change: a dump of these parameters may be loaded.
                if change.name in _FIXED and change.value != self._value(change.name):
                    return SetParametersResult(successful=False, reason=f"{change.name} {fixed}")
        try:
            self.settings.replace(
                {change.name: change.value for change in changes if change.name in PARAMETERS}
            )
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[Parameter]) -> None:
        if not any(change.name in PARAMETERS for change in changes):
            return
        # All of them: a reset may set others back at the same time.
        with self._applying:
            values = {name: self._value(name) for name in PARAMETERS}
            self.settings = self.settings.replace(values)
        self._changed(self.settings)

    def _value(self, name: str) -> Any:
        return self._node.get_parameter(name).value


def declare_settings(node: Node) -> Settings:
    """Declare all parameters on the node and return the settings that they hold.

    A whole number is accepted for a number, as in ``weight_on_bit: 20``.
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
    )
    if isinstance(allowed, Quantity):
        value = float(value)
        descriptor.description = _description(allowed)
        descriptor.additional_constraints = f"in {allowed.range}"
        limits = FloatingPointRange(from_value=allowed.minimum, to_value=allowed.maximum)
        descriptor.floating_point_range = [limits]
    if not declaration.changeable:
        descriptor.additional_constraints += "; fixed while the drill is configured"
    parameter = Parameter(declaration.name, value=value)
    descriptor.type = parameter.type_.value
    node.set_parameters([parameter])
    node.set_descriptor(declaration.name, descriptor)
