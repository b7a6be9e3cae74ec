"""Simulation time of a drill, as a client pauses, steps and resets it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rpud_msgs.msg import Result, SimulationState, Status
from rpud_msgs.srv import ResetSimulation, RunToTime, SetSimulationState, StepSimulation

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.client.arguments import SEED, to_duration, to_time
from rpud_sim.ros.client.client_part import ClientPart
from rpud_sim.ros.client.drill_connection import DrillConnection
from rpud_sim.ros.client.drill_watch import stamp_of
from rpud_sim.ros.client.errors import RefusedError

# What a reset may restart, by name.
SCOPES: Mapping[str, int] = {
    "all": ResetSimulation.Request.SCOPE_ALL,
    "time": ResetSimulation.Request.SCOPE_TIME,
    "state": ResetSimulation.Request.SCOPE_STATE,
    "faults": ResetSimulation.Request.SCOPE_SPAWNED,
}


class SimulationServices(ClientPart):
    """Simulation time of a drill; a call returns when the topic ``status`` shows the change."""

    def __init__(self, drill: DrillConnection) -> None:
        super().__init__(drill)
        self._published: Mapping[str, int] = {}

    @property
    def published(self) -> Mapping[str, int]:
        """Messages that the drill had published on each topic when the last step ended."""
        return self._published

    def pause(self) -> None:
        """Let simulation time stand still; a step that is under way is interrupted."""
        self._set(SimulationState.STATE_PAUSED, Status.STATE_PAUSED)

    def play(self) -> None:
        """Let simulation time pass by itself."""
        self._set(SimulationState.STATE_PLAYING, Status.STATE_RUNNING)

    def step(self, seconds: float) -> float:
        """Advance a paused drill, and return the stamp that it reached [s].

        Its status and all messages of that time that have arrived are taken before this returns.
        """
        duration = to_duration("step", seconds)
        return self._advance("simulation/step", StepSimulation.Request(duration=duration))

    def run_to(self, stamp: float) -> float:
        """Advance a paused drill to a stamp [s], and return the stamp that it reached [s]."""
        time = to_time("time", stamp)
        return self._advance("simulation/run_to", RunToTime.Request(time=time))

    def reset(self, scope: str | int = "all", seed: int | None = None) -> None:
        """Begin again; the drill plays on if it played.

        ``scope`` is ``all``, ``time``, ``state``, ``faults``, or the bits of
        ``rpud_msgs/ResetSimulation``. ``seed`` is of the vibration's phase, the scenario and the
        noise from here on; None for the present one.
        """
        if isinstance(scope, str) and scope not in SCOPES:
            raise ParameterError(
                f"scope = {shown(scope)} is unknown; {did_you_mean(scope, SCOPES)}"
            )
        bits = SCOPES[scope] if isinstance(scope, str) else int(scope)
        request = ResetSimulation.Request(scope=bits)
        if seed is not None:
            request.reseed, request.seed = True, int(SEED.check("seed", seed))
        before, count = self.status, self._drill.watch.statuses
        _check(self._drill.call("simulation/reset", request).result)
        self._drill.until(
            lambda: self._drill.watch.statuses > count and _is_reset(self.status, before, bits),
            "no status showed the reset",
        )
        self._drill.listening.settle()

    def _set(self, state: int, name: str) -> None:
        request = SetSimulationState.Request(state=SimulationState(state=state))
        result = self._drill.call("simulation/set_state", request, repeat=True).result
        if result.result != SetSimulationState.Response.ALREADY_IN_TARGET_STATE:
            _check(result)
        states = (name, Status.STATE_INACTIVE)  # which says nothing about its time
        self._drill.until(lambda: self.status.state in states, f"no status said {name}")

    def _advance(self, name: str, request: Any) -> float:
        response = self._drill.call(name, request)
        _check(response.result)
        self._published = dict(zip(response.topics, response.published, strict=True))
        reached = join_seconds(response.time.sec, response.time.nanosec)
        self._drill.until(
            lambda: stamp_of(self.status) >= reached, "no status showed the end of the step"
        )
        self._drill.listening.settle()
        return reached / SECOND


def _check(result: Result) -> None:
    if result.result != Result.RESULT_OK:
        raise RefusedError(result.error_message, result.result)


def _is_reset(status: Status, before: Status, bits: int) -> bool:
    """Return whether a status is one of after a reset.

    The drill publishes it before it answers, but a topic and a service have no common order.
    """
    if status.state == Status.STATE_RUNNING:
        return True  # its counters and stamps rise again at once
    request = ResetSimulation.Request
    bits = bits or request.SCOPE_ALL
    counts = status.commands_accepted + status.commands_rejected
    began_again = stamp_of(status) != stamp_of(before) or stamp_of(status) == 0
    return (not bits & request.SCOPE_STATE or counts == 0) and (
        not bits & request.SCOPE_TIME or began_again
    )
