"""The ``simulation_interfaces`` standard at its own names, where that package is installed."""

from __future__ import annotations

from typing import Any

from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.node import Node

from rpud_sim.ros.drill.live_run import LiveRun
from rpud_sim.ros.drill.services import DrillServices
from rpud_sim.simulation.block import boundaries_until, boundary

try:
    from simulation_interfaces.action import SimulateSteps
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
    "STEP_SIMULATION_ACTION",
)


class StandardServer:
    """The standard's services for features, state, steps and resets, and its action for steps.

    ``get_simulator_features``, ``get_simulation_state``, ``set_simulation_state``,
    ``step_simulation``, ``reset_simulation`` and ``simulate_steps``; states, results and refusals
    are those of the drill's own services. A step is a telemetry period; the first of several goes
    to the next boundary of one. ``services``, the drill's own, do the work.
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
        self._action = ActionServer(
            node,
            SimulateSteps,
            "simulate_steps",
            self._on_simulate_steps,
            callback_group=ReentrantCallbackGroup(),
            cancel_callback=lambda goal: CancelResponse.ACCEPT,
        )

    def _on_features(self, request: Any, response: Any) -> Any:
        names = (*_FEATURES, *(_FEATURES_OF_TIME if self._services.controls_time() else ()))
        response.features.features = sorted(getattr(SimulatorFeatures, name) for name in names)
        response.features.custom_info = "rpud_sim: a step is one period of telemetry_rate"
        return response

    def _on_simulate_steps(self, goal: Any) -> Any:
        steps = int(goal.request.steps)
        wanted = max(steps, 1)  # zero steps are refused as the first one is
        completed = 0

        def act() -> None:
            nonlocal completed
            while completed < wanted and not goal.is_cancel_requested:
                self._step(min(steps, 1))
                completed += 1
                goal.publish_feedback(
                    SimulateSteps.Feedback(
                        completed_steps=completed, remaining_steps=wanted - completed
                    )
                )

        result = self._services.answer(SimulateSteps.Result(), act)
        if completed == wanted:
            goal.succeed()
        elif goal.is_cancel_requested:
            goal.canceled()
        else:
            goal.abort()
        return result

    def _step(self, steps: int) -> None:
        def until(live: LiveRun) -> int:
            rate = live.settings.telemetry_rate
            return boundary(boundaries_until(live.run.time, rate) + steps, rate)

        self._services.step_until(until)
