"""Managed node that answers every request, impossible ones too, and its parameters."""

from __future__ import annotations

import threading
from collections.abc import Callable
from functools import partial, wraps
from typing import Any, TypeVar

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import (
    FloatingPointRange,
    ParameterDescriptor,
    ParameterType,
    ParameterValue,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service

from rpud_sim.foundation.parameters import Declaration
from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, shown
from rpud_sim.ros.threads import raised
from rpud_sim.simulation.configuration import CHANGEABLE, PARAMETERS, Settings, to_settings

Managed = TypeVar("Managed", bound="ManagedNode")
Transition = Callable[[Managed, LifecycleState], TransitionCallbackReturn]
Handler = Callable[[Any, Any], Any]

# Parameters that every ROS node may be started with; some are declared later than ours.
_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_FIXED = {*PARAMETERS, "use_sim_time"} - {*CHANGEABLE}  # while the drill is configured


class ManagedNode(LifecycleNode):
    """rclpy's ``LifecycleNode`` whose process no client's request can end."""

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Handler, **options: Any
    ) -> Service:
        """Create a service that always answers.

        A handler that raises an error answers with an empty response. Services that set parameters
        name the one that they refuse.
        """
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = partial(self._set_parameters, callback)

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:  # out of the executor the client would have no answer
                self.refuse_request(f"{srv_type.__name__}: {raised(error)}")
                return srv_type.Response()

        return super().create_service(srv_type, srv_name, answer, **options)

    def destroy_node(self) -> None:
        """Destroy the node, with the topic of its transitions, which rclpy leaves in the graph."""
        self._state_machine.destroy_when_not_in_use()
        super().destroy_node()

    def complete(self, trigger: Callable[[], TransitionCallbackReturn]) -> None:
        """Do a transition; a RuntimeError says that it failed."""
        if trigger() != TransitionCallbackReturn.SUCCESS:
            raise RuntimeError("the drill cannot be started; the log says why")

    def refuse_request(self, reason: str) -> None:
        """Log why a client's request to set a parameter or to change the state is rejected."""
        self.get_logger().warning(f"request refused: {reason}")

    def _set_parameters(self, callback: Handler, request: Any, response: Any) -> Any:
        """Let rclpy set parameters, but for what it would not answer well; log refusals."""
        results = [_result_without_rclpy(self, each) for each in request.parameters]
        answered = list(zip(request.parameters, results, strict=True))
        if isinstance(request, SetParameters.Request):
            for parameter, result in answered:
                if result is None:
                    callback(SetParameters.Request(parameters=[parameter]), response)
                else:
                    response.results.append(result)
            found = response.results
        else:
            refused = [result for result in results if result and not result.successful]
            if refused:
                response.result = refused[0]
            else:
                request.parameters = [parameter for parameter, result in answered if result is None]
                response = callback(request, response)
            found = [response.result]
        for result in found:
            if not result.successful:
                self.refuse_request(result.reason)
        return response

    # rclpy lets RCLError out of the executor when a client asks for a transition that the present
    # state does not have: the node would end, and the client wait for ever. This name is how Python
    # calls the private method of its mixin.
    def _LifecycleNodeMixin__on_change_state(  # noqa: N802
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        wanted = request.transition.label or request.transition.id
        known = self._state_machine.available_transitions
        if not any(wanted in (number, label) for number, label, *_ in known):
            _, state = self._state_machine.current_state
            self.refuse_request(f"the state {state} has no transition {shown(wanted)}")
            response.success = False
            return response
        change = LifecycleNode._LifecycleNodeMixin__on_change_state  # type: ignore[attr-defined]
        return change(self, request, response)


def log_exceptions(transition: Transition[Managed]) -> Transition[Managed]:
    """Make a transition log its exceptions; rclpy would drop them."""

    @wraps(transition)
    def logged(self: Managed, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(self, state)
        except Exception as error:
            self.get_logger().error(f"{transition.__name__}: {error or type(error).__name__}")
            return TransitionCallbackReturn.ERROR

    return logged


def _result_without_rclpy(
    node: ManagedNode, message: ParameterMessage
) -> SetParametersResult | None:
    """Return the answer to what rclpy would not answer well; None if it is for rclpy to set.

    rclpy ends at a type that it does not know, names no parameter that is unknown or of another
    type, and refuses the present value of one that is read-only. What stands for a number becomes
    one: a whole number, and a text such as 1e-06, which ``ros2 param`` does not read as a number.
    """
    name, number = message.name, message.value.type
    if number > ParameterType.PARAMETER_STRING_ARRAY:
        return _refusal(f"{shown(name)} has the type {number}, which is none")
    if not node.has_parameter(name):
        known = node.list_parameters([], 0).names
        return _refusal(f"parameter {shown(name)} is unknown; {did_you_mean(name, known)}")
    descriptor, present = node.describe_parameter(name), node.get_parameter(name)
    if descriptor.type == ParameterType.PARAMETER_DOUBLE:
        message.value = _to_number(message.value)
    given = Parameter.from_parameter_msg(message)
    if descriptor.read_only and given.value == present.value:
        return SetParametersResult(successful=True)
    expected = Parameter.Type(descriptor.type)
    if given.type_ == expected or descriptor.dynamic_typing:
        return None
    types = f"expected {expected.name.lower()}, given {given.type_.name.lower()}"
    return _refusal(f"{name} is of another type: {types}")


def _to_number(value: ParameterValue) -> ParameterValue:
    """Return a value as a number if it stands for one; otherwise as it is."""
    if value.type == ParameterType.PARAMETER_INTEGER:
        number = float(value.integer_value)
    elif value.type == ParameterType.PARAMETER_STRING:
        try:
            number = float(value.string_value)
        except ValueError:
            return value
    else:
        return value
    return ParameterValue(type=ParameterType.PARAMETER_DOUBLE, double_value=number)


def _refusal(reason: str) -> SetParametersResult:
    return SetParametersResult(successful=False, reason=reason)


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
