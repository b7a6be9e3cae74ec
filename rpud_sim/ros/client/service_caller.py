"""Requests of a client to the services of one drill."""

from __future__ import annotations

from collections.abc import Callable
from math import inf
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rclpy.client import Client
from rpud_msgs import msg, srv
from std_srvs.srv import SetBool

from rpud_sim.foundation.time import SECOND, split_seconds
from rpud_sim.ros.client.listening_node import (
    SECONDS,
    ListeningNode,
    RefusedError,
)
from rpud_sim.ros.graph import RepeatedRequest

_SERVICES = {
    "inject_fault": srv.InjectFault,
    "clear_fault": srv.ClearFault,
    "list_faults": srv.ListFaults,
    "engage": SetBool,
    "simulation/get_delivery": srv.GetDelivery,
    "simulation/set_state": srv.SetSimulationState,
    "simulation/step": srv.StepSimulation,
    "simulation/run_to": srv.RunToTime,
    "simulation/reset": srv.ResetSimulation,
}
_ALREADY = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
_REPETITION = 2.0  # of a request that may be repeated [s]


class ServiceCaller:
    """Clients of the drill's services.

    ``alive`` gives a number that grows while the drill lives: the patience begins again then, as
    some requests take long.
    """

    def __init__(self, listening: ListeningNode, alive: Callable[[], int]) -> None:
        self._listening = listening
        self._alive = alive
        self._clients = {
            name: listening.node.create_client(kind, name) for name, kind in _SERVICES.items()
        }

    def add(self, kind: Any, name: str) -> None:
        """Make the client of a further service, unless it is there."""
        if name not in self._clients:
            self._clients[name] = self._listening.node.create_client(kind, name)
            self.introduce()

    def call(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service and return its response, or raise the drill's reason not to do it.

        With ``repeat`` it is sent again and again, since a server drops a response for a client
        that it has not discovered yet; not if it must act only once.
        """
        response = self._answer(self._clients[name], request, repeat)
        result = getattr(response, "result", response)
        if isinstance(result, msg.Result):
            if result.result not in (result.RESULT_OK, _ALREADY):
                raise RefusedError(result.error_message, result.result)
        elif isinstance(result, SetParametersResult):
            if not result.successful:
                raise RefusedError(result.reason)
        elif not getattr(result, "success", True):
            raise RefusedError(result.message)
        return response

    def introduce(self, patience: float | None = None) -> None:
        """Wait until the drill has discovered all subscriptions and clients of this node.

        Discovery reports them in the order in which they were made: an answer to the last one
        shows that the drill knows all. Otherwise it could drop a response or the first messages.
        """
        node, kind = self._listening.node, srv.GetSimulationState
        last = node.create_client(kind, "simulation/get_state")
        try:
            self._answer(last, kind.Request(), True, patience)
        finally:
            node.destroy_client(last)

    def _answer(
        self, client: Client, request: Any, repeat: bool, patience: float | None = None
    ) -> Any:
        wait_until = self._listening.wait_until
        service = self._listening.node.resolve_service_name(client.srv_name)
        wait_until(client.service_is_ready, f"service {service} did not appear", patience)
        sent = RepeatedRequest(client, request, _REPETITION if repeat else inf)
        what = f"service {service} did not answer"
        try:
            return wait_until(sent.answered, what, patience, self._alive).result()
        finally:
            sent.close()


def to_time(kind: Any, name: str, seconds: Any) -> Any:
    """Return seconds as a ``Time`` or ``Duration``; others than those are a ParameterError."""
    total = min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1)
    sec, nanosec = split_seconds(total)
    return kind(sec=sec, nanosec=nanosec)
