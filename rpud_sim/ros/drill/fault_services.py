"""Services that engage the rock, and inject, clear and list faults."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from typing import Any

from rclpy.parameter import Parameter
from rpud_msgs.srv import ClearFault, InjectFault, ListFaults
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.live_run import LiveRun
from rpud_sim.ros.drill.managed_node import ManagedNode
from rpud_sim.ros.drill.messages import message_to_fault, record_to_fault
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.threads import StoppedError
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import FaultError, check_kind
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import CHANNELS, TOPICS


class FaultServer:
    """Services ``inject_fault``, ``clear_fault``, ``list_faults`` and ``engage``.

    ``settings`` gives the settings of the node, configured or not.
    """

    def __init__(
        self, node: ManagedNode, loop: PacingLoop, settings: Callable[[], Settings]
    ) -> None:
        self._node = node
        self._loop = loop
        self._settings = settings
        node.create_service(InjectFault, "inject_fault", self._on_inject)
        node.create_service(ClearFault, "clear_fault", self._on_clear)
        node.create_service(ListFaults, "list_faults", self._on_list)
        node.create_service(SetBool, "engage", self._on_engage)

    def _on_inject(
        self, request: InjectFault.Request, response: InjectFault.Response
    ) -> InjectFault.Response:
        duration = join_seconds(request.duration.sec, request.duration.nanosec)

        def act(simulation: Simulation) -> None:
            if duration < 0:
                raise FaultError(f"duration = {duration / SECOND:g} s is less than zero")
            check_kind(request.fault.kind, simulation.supported_kinds())
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
        def act(live: LiveRun) -> None:
            run = live.run
            response.faults = [
                record_to_fault(record, run.origin) for record in run.simulation.faults.active
            ]
            response.kinds = list(run.simulation.supported_kinds())

        with contextlib.suppress(StoppedError):  # without a run there are no faults
            self._loop.request(act)
        values = self._settings().values()
        response.channels = [name for name in CHANNELS if TOPICS[name].is_offered(values)]
        return response

    def _on_engage(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        if self._loop.live is None:
            response.message = "the node has not been configured"
            self._node.refuse_request(response.message)
            return response
        regime = "drilling" if request.data else "free"
        result = self._node.set_parameters([Parameter("regime", value=regime)])[0]
        response.success = result.successful
        response.message = result.reason
        if not result.successful:
            self._node.refuse_request(result.reason)
        return response

    def _answer(self, response: Any, act: Callable[[Simulation], None]) -> Any:
        try:
            self._loop.request(lambda live: live.act(lambda run: act(run.simulation)))
            response.success = True
        except (ParameterError, StoppedError) as error:
            self._node.refuse_request(str(error))
            response.message = str(error)
        return response
