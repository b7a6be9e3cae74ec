"""The ``simulation_interfaces`` standard at its own names, where that package is installed."""

from __future__ import annotations

from typing import Any

from rclpy.node import Node

from rpud_sim.ros.drill.live_run import LiveRun
from rpud_sim.ros.drill.services import DrillServices
from rpud_sim.simulation.block import boundaries_until, boundary

try:
    from simulation_interfaces.msg import SimulatorFeatures
    from simulation_interfaces.srv import (
        GetSimulationState,
        GetSimulatorFeatures,
        ResetSimulation,
        SetSimulationState,
        StepSimulation,
    )

    INSTALLED = True
except ImportError:
    INSTALLED = False

_FEATURES = (
    "SIMULATION_RESET",
    "SIMULATION_RESET_STATE",
    "SIMULATION_RESET_SPAWNED",
    "SIMULATION_STATE_GETTING",
)
# Not of a drill that follows another's /clock.
_FEATURES_OF_TIME = (
    "SIMULATION_RESET_TIME",
    "SIMULATION_STATE_SETTING",
    "SIMULATION_STATE_PAUSE",
    "STEP_SIMULATION_SINGLE",
    "STEP_SIMULATION_MULTIPLE",
)


class StandardServer:
    """The standard's services for features, state, steps and resets.

    ``services``, the drill's own, do the work: states, results and refusals are theirs. A step is a
    telemetry period; the first of several goes to the next boundary of one.
    """

    def __init__(self, node: Node, services: DrillServices) -> None:
        self._services = services
        node.create_service(GetSimulatorFeatures, "get_simulator_features", self._on_features)
        services.offer(GetSimulationState, "get_simulation_state", services.get_state)
        services.offer(SetSimulationState, "set_simulation_state", services.set_state)
        services.offer(
            StepSimulation,
            "step_simulation",
            lambda request, response: self._step(int(request.steps)),
            services.stepping,
        )
        services.offer(
            ResetSimulation,
            "reset_simulation",
            lambda request, response: services.reset(int(request.scope)),
        )

    def _on_features(self, request: Any, response: Any) -> Any:
        names = (*_FEATURES, *(_FEATURES_OF_TIME if self._services.controls_time() else ()))
        response.features.features = sorted(getattr(SimulatorFeatures, name) for name in names)
        response.features.custom_info = "rpud_sim: a step is one period of telemetry_rate"
        return response

    def _step(self, steps: int) -> None:
        def until(live: LiveRun) -> int:
            rate = live.settings.telemetry_rate
            return boundary(boundaries_until(live.run.time, rate) + steps, rate)

        self._services.step_until(until)
