"""Managed node that answers every request; its parameters, and other nodes of its name."""

from __future__ import annotations

import errno
import hashlib
import socket
import threading
import weakref
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import wraps
from itertools import pairwise
from typing import Any, TypeVar

from lifecycle_msgs.srv import ChangeState
from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.service import Service
from rclpy.subscription import Subscription
from rosgraph_msgs.msg import Clock

from rpud_sim.foundation.quantities import (
    Declaration,
    ParameterError,
    Quantity,
    did_you_mean,
    short_repr,
)
from rpud_sim.ros.threads import raised
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    OF_ROS,
    PARAMETERS,
    ParameterFile,
    Settings,
    not_of_the_drill,
    parse_assignment,
    to_settings,
)
from rpud_sim.simulation.unused_parameters import doubts

Managed = TypeVar("Managed", bound="ManagedNode")
Transition = Callable[[Managed, LifecycleState], TransitionCallbackReturn]

# What changes it while the drill runs, where a command does.
_COMMANDED = {
    "weight_on_bit": "; command it on command/weight_on_bit, as `rpud press {:g}` does",
    "drive_enabled": "; command it on command/drive, as `rpud drive` does",
}
_NOT_INTEGERS = (Parameter.Type.DOUBLE, Parameter.Type.STRING)
_FIXED = {*PARAMETERS, "use_sim_time"} - {*CHANGEABLE}  # while the drill is configured


class ManagedNode(LifecycleNode):
    """rclpy's ``LifecycleNode`` whose process no client's request can end."""

    def create_service(
        self, srv_type: Any, srv_name: str, callback: Callable[[Any, Any], Any], **options: Any
    ) -> Service:
        """Create a service that answers with an empty response if its handler raises an error."""
        if srv_type in (SetParameters, SetParametersAtomically):
            callback = self._set_parameters

        def answer(request: Any, response: Any) -> Any:
            try:
                return callback(request, response)
            except Exception as error:  # out of the executor the client would have no answer
                self.refuse_request(f"{srv_type.__name__}: {raised(error)}")
                return srv_type.Response()

        return super().create_service(srv_type, srv_name, answer, **options)

    def create_subscription(
        self,
        msg_type: Any,
        topic: str,
        callback: Callable[..., Any],
        *arguments: Any,
        **options: Any,
    ) -> Subscription:
        """Create a subscription; the one for ROS time rejects a time that ROS does not allow."""
        if msg_type is not Clock:
            return super().create_subscription(msg_type, topic, callback, *arguments, **options)

        def checked(message: Clock) -> None:
            seconds = message.clock.sec
            if seconds < 0:
                self.refuse_request(f"{topic} = {seconds} s is outside its range [0, 2147483647] s")
            else:
                callback(message)

        return super().create_subscription(msg_type, topic, checked, *arguments, **options)

    def destroy_node(self) -> None:
        """Destroy the node, with the topic of its transitions, which rclpy leaves in the graph."""
        self._state_machine.destroy_when_not_in_use()
        super().destroy_node()

    def refuse_request(self, reason: str) -> None:
        """Log why a client's request to set a parameter or to change the state is rejected."""
        self.get_logger().warning(f"request rejected: {reason}")

    def _set_parameters(self, request: Any, response: Any) -> Any:
        """Set parameters as rclpy does, but name the one that is rejected, whatever its type."""
        if isinstance(request, SetParameters.Request):
            response.results = [self._set_together([each]) for each in request.parameters]
        else:
            response.result = self._set_together(request.parameters)
        return response

    def _set_together(self, messages: Sequence[ParameterMessage]) -> SetParametersResult:
        try:
            changes = [each for each in map(self._change, messages) if each is not None]
            result = self.set_parameters_atomically(changes)
        except ParameterError as error:
            result = SetParametersResult(successful=False, reason=str(error))
        if not result.successful:
            self.refuse_request(result.reason)
        return result

    def _change(self, message: ParameterMessage) -> Parameter | None:
        """Return what is to be set, None for the current value of what is read-only.

        A whole number, and a text such as 1e-06, becomes a number where one is expected, and a
        number without a fraction a whole one.
        """
        name, kind = message.name, message.value.type
        if kind > ParameterType.PARAMETER_STRING_ARRAY:
            raise ParameterError(f"{short_repr(name)} has the type {kind}, which is none")
        if not self.has_parameter(name):
            hint = did_you_mean(name, self.list_parameters([], 0).names)
            raise ParameterError(f"parameter {short_repr(name)} is unknown{hint}")
        descriptor, given = self.describe_parameter(name), Parameter.from_parameter_msg(message)
        if descriptor.read_only and given.value == self.get_parameter(name).value:
            return None
        expected = Parameter.Type(descriptor.type)
        like_number = given.type_ in (Parameter.Type.INTEGER, Parameter.Type.STRING)
        if expected == Parameter.Type.DOUBLE and like_number:
            with suppress(ValueError):
                given = Parameter(name, value=float(given.value))
        if expected == Parameter.Type.INTEGER and given.type_ in _NOT_INTEGERS:
            with suppress(ValueError):
                number = float(given.value)
                whole = int(number) if number.is_integer() else number
                given = Parameter(name, value=whole)
            if given.type_ == Parameter.Type.DOUBLE and name in PARAMETERS:
                PARAMETERS[name].allowed.check(name, given.value)
        if name in PARAMETERS and given.type_ == expected:
            PARAMETERS[name].allowed.check(name, given.value)  # rclpy's error has no unit
        if given.type_ != expected and not descriptor.dynamic_typing:
            types = f"expected {expected.name.lower()}, given {given.type_.name.lower()}"
            raise ParameterError(f"{name} is of another type: {types}")
        return given

    # rclpy lets RCLError out of the executor when a client asks for a transition that the current
    # state does not have: the node would end, and the client wait for ever. This name is how Python
    # calls the private method of its mixin.
    def _LifecycleNodeMixin__on_change_state(  # noqa: N802
        self, request: ChangeState.Request, response: ChangeState.Response
    ) -> ChangeState.Response:
        wanted = request.transition.label or request.transition.id
        known = self._state_machine.available_transitions
        if not any(wanted in (number, label) for number, label, *_ in known):
            _, state = self._state_machine.current_state
            self.refuse_request(f"the state {state} has no transition {short_repr(wanted)}")
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


class DrillParameters:
    """Parameters of the drill node, and the settings that they hold.

    ``changed`` is called with new settings; ``fixed`` explains why some settings need a reset.
    ``words`` are the arguments of ROS that the node is started with.
    """

    def __init__(
        self,
        node: Node,
        changed: Callable[[Settings], None],
        fixed: Callable[[], str],
        words: Sequence[str] = (),
    ) -> None:
        self._node = node
        self._changed = changed
        self._fixed = fixed
        self.settings = declare_settings(node, words)
        # A reset sets parameters in the pacing thread, a service in another one.
        self._applying = threading.Lock()
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def restore(self, settings: Settings) -> None:
        """Set the changeable parameters to the values of these settings."""
        values = {name: settings.value(name) for name in CHANGEABLE}
        self._node.set_parameters_atomically(
            [Parameter(name, value=values[name]) for name in values if self._differs(name, values)]
        )

    def _check(self, changes: list[Parameter]) -> SetParametersResult:
        values = {change.name: change.value for change in changes}
        fixed = self._fixed()
        reason = ""
        for name in values if fixed else ():
            # The current value is not a change: a dump of these parameters may be loaded.
            if name in _FIXED and self._differs(name, values):
                reason = f"{name} {fixed}{_COMMANDED.get(name, '').format(values[name])}"
        try:
            self.settings.replace({name: values[name] for name in values if name in PARAMETERS})
        except ParameterError as error:
            reason = reason or str(error)
        return SetParametersResult(successful=not reason, reason=reason)

    def _apply(self, changes: list[Parameter]) -> None:
        if not any(change.name in PARAMETERS for change in changes):
            return
        # All of them: a reset may set others back at the same time.
        with self._applying:
            values = {name: self._node.get_parameter(name).value for name in PARAMETERS}
            self.settings = self.settings.replace(values)
        self._changed(self.settings)

    def _differs(self, name: str, values: dict[str, Any]) -> bool:
        return bool(self._node.get_parameter(name).value != values[name])


def declare_settings(node: Node, words: Sequence[str] = ()) -> Settings:
    """Declare all parameters on the node and return the settings that they hold.

    Of the arguments ``words``, parameter files are read as ``--config`` reads them, and ``-p`` goes
    before them. In a file only a mistake is an error: what is there for other nodes is logged.
    """
    pairs = list(pairwise(words))
    paths = [each for word, each in pairs if word == "--params-file"]
    rules = [each.partition(":=") for word, each in pairs if word in ("-p", "--param")]
    # What a file has for others is not a parameter of the drill; what is given by name must be one.
    known = {*PARAMETERS, *(target.rpartition(":")[2] for target, _, _ in rules)}
    values = {
        name: override.value
        for name, override in node._parameter_overrides.items()
        if not (node.has_parameter(name) or name.startswith(OF_ROS))
        and (name in known or not paths)
    }
    for path in paths:
        file = ParameterFile(path, node.get_fully_qualified_name())
        if file.missing:
            node.get_logger().warning(str(file.missing))
        if file.foreign:
            node.get_logger().info(f"{path}: {not_of_the_drill(file.foreign)}")
        values.update(file.values)
    # ROS lets a section of this node in a file go before a value that is given for all nodes.
    for target, _, text in rules:
        owner, _, name = target.rpartition(":")
        if name in PARAMETERS and owner in ("", node.get_name(), node.get_fully_qualified_name()):
            values.update([parse_assignment(f"{name}={text}")])
    settings = to_settings(values)
    for line in doubts(values, settings):
        node.get_logger().warning(line)
    for declaration in PARAMETERS.values():
        value = settings.value(declaration.name)
        if isinstance(declaration.allowed, Quantity) and not declaration.allowed.whole:
            value = float(value)
        # Of the checked value alone: rclpy's error at an override of another type names less.
        node.declare_parameter(
            declaration.name, value, _descriptor(declaration), ignore_override=True
        )
    return settings


def _descriptor(declaration: Declaration) -> ParameterDescriptor:
    allowed = declaration.allowed
    descriptor = ParameterDescriptor(
        description=allowed.description, additional_constraints=allowed.range
    )
    if isinstance(allowed, Quantity):
        # A count or a seed has no unit.
        if unit := allowed.unit or ("" if allowed.whole else "1"):
            descriptor.description += f" [{unit}]"
        descriptor.additional_constraints = f"in {allowed.range}"
        least, most = allowed.minimum, allowed.maximum
        if allowed.whole:
            whole = IntegerRange(from_value=int(least), to_value=int(most), step=1)
            descriptor.integer_range = [whole]
        else:
            limits = FloatingPointRange(from_value=float(least), to_value=float(most))
            descriptor.floating_point_range = [limits]
    if not declaration.changeable:
        descriptor.additional_constraints += "; fixed while the drill is configured"
    return descriptor


class NameHold:
    """Hold of a node's name on this machine: an abstract Unix socket, known without discovery."""

    def __init__(self, name: str, domain: int) -> None:
        # Whether a living process of this machine holds the name, in the same domain.
        self.taken = False
        digest = hashlib.sha256(f"{domain} {name}".encode()).hexdigest()  # names may be too long
        held = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self.release = weakref.finalize(self, held.close)
        try:
            held.bind(f"\0rpud_sim/{digest}")
        except OSError as error:  # a sandbox may forbid it
            self.taken = error.errno == errno.EADDRINUSE
            self.release()


class DuplicateNodes:
    """Count of the other nodes of a node's name, which it holds; it warns if there are some."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._name = (node.get_name(), node.get_namespace())
        self._count = 0
        self._hold = NameHold(node.get_fully_qualified_name(), node.context.get_domain_id())
        self.close = self._hold.release

    def count(self) -> int:
        """Return how many other nodes have the name; one that was killed counts for 20 s more."""
        before = self._count
        names = self._node.get_node_names_and_namespaces()
        self._count = max(0, names.count(self._name) - 1)
        if self._count > before:
            self._node.get_logger().warning(
                f"{self._count + 1} nodes are named {self._node.get_fully_qualified_name()}: all "
                "of them answer the same requests; start each in a namespace of its own"
            )
        return self._count
