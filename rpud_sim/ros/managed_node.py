"""A managed node that answers every request for a transition, also an impossible one."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

Node = TypeVar("Node", bound="ManagedNode")
Transition = Callable[[Node, LifecycleState], TransitionCallbackReturn]


class ManagedNode(LifecycleNode):
    """rclpy's ``LifecycleNode``, but that an error in a transition is shown and ends nothing."""

    # rclpy lets RCLError out of the executor when a client asks for a transition that the present
    # state does not have: the node would end, and the client wait for ever. This name is how Python
    # calls the private method of its mixin.
    def _LifecycleNodeMixin__change_state(  # noqa: N802
        self, transition_id: int
    ) -> TransitionCallbackReturn:
        change = LifecycleNode._LifecycleNodeMixin__change_state  # type: ignore[attr-defined]
        try:
            return change(self, transition_id)
        except RuntimeError as error:  # RCLError
            reason = str(error).partition(", at ")[0]
            self.get_logger().warning(f"transition refused: {reason}")
            return TransitionCallbackReturn.FAILURE


def told(transition: Transition[Node]) -> Transition[Node]:
    """Make a transition log what is raised in it, which rclpy would pass over in silence."""

    def tell(self: Node, state: LifecycleState) -> TransitionCallbackReturn:
        try:
            return transition(self, state)
        except Exception as error:
            self.get_logger().error(f"{transition.__name__}: {error or type(error).__name__}")
            return TransitionCallbackReturn.ERROR

    tell.__name__, tell.__doc__ = transition.__name__, transition.__doc__
    return tell
