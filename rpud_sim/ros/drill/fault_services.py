"""Services that engage the rock, and inject, clear and list faults."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter
from rpud_msgs.srv import ClearFault, InjectFault, ListFaults
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.messages import message_to_fault, record_to_fault
from rpud_sim.ros.drill.pacing import NANOSECONDS
from rpud_sim.ros.requests import StoppedError
from rpud_sim.simulation.channels import CHANNELS
from rpud_sim.simulation.faults import FaultError
from rpud_sim.simulation.simulation import Simulation

_NOT_ACTIVATED = "the node has not been activated"


class FaultServices:
    """``inject_fault``, ``clear_fault`` and ``list_faults``, and ``engage``, which is no fault.

    Args:
        node: that owns them.
        drilling: gives what they act on, None while there is nothing.
        origin: gives the stamp of simulation time zero [ns].
        refused: told the reason of each refusal.
    """

    def __init__(
        self,
        node: Node,
        drilling: Callable[[], Drilling | None],
        origin: Callable[[], int],
        refused: Callable[[str], None],
    ) -> None:
        self._node = node
        self._drilling = drilling
        self._origin = origin
        self._refused = refused
        node.create_service(InjectFault, "inject_fault", self._on_inject)
        node.create_service(ClearFault, "clear_fault", self._on_clear)
        node.create_service(ListFaults, "list_faults", self._on_list)
        node.create_service(SetBool, "engage", self._on_engage)

    def _on_inject(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        duration = request.duration.sec * NANOSECONDS + request.duration.nanosec

        def act(simulation: Simulation) -> None:
            if duration < 0:
                raise FaultError(f"duration = {duration / NANOSECONDS:g} s is less than zero")
            response.number = simulation.inject(message_to_fault(request.fault), duration)

        return self._answer(response, act)

    def _on_clear(
        self, request: ClearFault.Request, response: ClearFault.Response
    ) -> ClearFault.Response:
        def act(simulation: Simulation) -> None:
            if request.number:
                simulation.clear(request.number)
            else:
                simulation.clear_all()

        return self._answer(response, act)

    def _on_list(
        self, request: ListFaults.Request, response: ListFaults.Response
    ) -> ListFaults.Response:
        def act(simulation: Simulation) -> None:
            response.faults = [
                record_to_fault(record, self._origin()) for record in simulation.faults.active
            ]
            response.kinds = list(simulation.honoured_kinds())

        drilling = self._drilling()
        if drilling is not None:
            with contextlib.suppress(StoppedError):  # nothing lasts any more
                drilling.request(lambda: act(drilling.simulation))
        response.channels = list(CHANNELS)
        return response

    def _on_engage(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        regime = "drilling" if request.data else "free"
        result = self._node.set_parameters([Parameter("regime", value=regime)])[0]
        response.success = result.successful
        response.message = result.reason
        if not result.successful:
            self._refused(result.reason)
        return response

    def _answer(self, response: Any, act: Callable[[Simulation], None]) -> Any:
        drilling = self._drilling()
        try:
            if drilling is None:
                raise StoppedError(_NOT_ACTIVATED)
            drilling.request(lambda: drilling.act_on_faults(act))
            response.success = True
        except (ParameterError, StoppedError) as error:
            self._refused(str(error))
            response.message = str(error)
        return response
