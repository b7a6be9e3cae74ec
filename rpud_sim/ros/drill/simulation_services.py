"""Services that play, pause, step and reset the simulation, and take it back to checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rpud_msgs.msg import Result, SimulationState
from rpud_msgs.srv import (
    GetSimulationState,
    ResetSimulation,
    RestoreSimulation,
    RunToTime,
    SaveSimulation,
    SetSimulationState,
    StepSimulation,
)

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.live_run import LONGEST_STEP, InterruptedStepError, LiveRun, Reached
from rpud_sim.ros.drill.managed_node import ManagedNode
from rpud_sim.ros.drill.messages import nanoseconds_to_time
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.threads import StoppedError

STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
QUITTING = SimulationState.STATE_QUITTING


class RefusedRequestError(Exception):
    """Refused request, with the number of its result."""

    def __init__(self, result: int, reason: str) -> None:
        super().__init__(reason)
        self.result = result


class SimulationServer:
    """Services of the namespace ``simulation``: states, steps, resets and checkpoints.

    States, results and refusals are those of the ``simulation_interfaces`` standard.
    """

    def __init__(self, node: ManagedNode, loop: PacingLoop) -> None:
        self._node = node
        self._loop = loop
        # A step takes long: meanwhile the other services must answer.
        self.stepping = MutuallyExclusiveCallbackGroup()
        for kind, name, handler, group in (
            (GetSimulationState, "get_state", self.get_state, None),
            (SetSimulationState, "set_state", self.set_state, None),
            (StepSimulation, "step", self._on_step, self.stepping),
            (RunToTime, "run_to", self._on_run_to, self.stepping),
            (ResetSimulation, "reset", self._on_reset, None),
            (SaveSimulation, "save", self._on_save, None),
            (RestoreSimulation, "restore", self._on_restore, None),
        ):
            node.create_service(kind, f"simulation/{name}", handler, callback_group=group)

    def controls_time(self) -> bool:
        """Return whether time can be paused and stepped: it follows no other ``/clock``."""
        return (live := self._loop.begun) is None or not live.follows_clock

    def get_state(self, request: Any, response: Any) -> Any:
        """Answer with the state."""
        live = self._loop.begun
        response.state.state = STOPPED if live is None else _state_of(live)
        response.result.result = Result.RESULT_OK
        return response

    def set_state(self, request: Any, response: Any) -> Any:
        """Play, pause, stop or quit."""
        return self.answer(response, lambda: self._set_state(int(request.state.state)))

    def reset(self, scope: int, seed: int | None = None) -> None:
        """Restart the time, the state or both."""
        whole = ResetSimulation.Request
        known = whole.SCOPE_TIME | whole.SCOPE_STATE | whole.SCOPE_SPAWNED
        bits = known if scope in (whole.SCOPE_DEFAULT, whole.SCOPE_ALL) else scope
        if bits & ~known:
            raise RefusedRequestError(
                Result.RESULT_FEATURE_UNSUPPORTED, f"scope {scope} is unknown"
            )
        time, state = bool(bits & whole.SCOPE_TIME), bool(bits & whole.SCOPE_STATE)

        def act(live: LiveRun) -> None:
            if time:
                _check_own_time(live, "reset")
            if bits & whole.SCOPE_SPAWNED and not state:
                live.act(lambda run: run.simulation.clear_all())
            live.reset(time=time, state=state, seed=seed)

        self._loop.request(act)

    def step_until(self, until_of: Callable[[LiveRun], int]) -> Reached:
        """Step to the simulation time [ns] that ``until_of`` returns between two blocks.

        A step that ends before its time is an InterruptedStepError.
        """

        def begin(live: LiveRun) -> Any:
            _check_own_time(live, "step")
            live.check_paused()
            return live.step(until_of(live))

        reached: Reached = self._loop.request(begin)
        return reached

    def answer(self, response: Any, act: Callable[[], Any]) -> Any:
        """Fill the response with the result of an action, and return it."""
        try:
            act()
            response.result.result = Result.RESULT_OK
        except InterruptedStepError as error:
            response.result.result = Result.RESULT_OPERATION_FAILED
            response.result.error_message = f"interrupted: {error}"
        except Exception as error:  # the client must get an answer in any case
            response.result.result = _result_of(error)
            response.result.error_message = str(error)
            if response.result.result != SetSimulationState.Response.ALREADY_IN_TARGET_STATE:
                self._node.refuse_request(str(error))
        return response

    def _set_state(self, state: int) -> None:
        if state == QUITTING:
            self._loop.quit()
            return
        if state not in (STOPPED, PLAYING, PAUSED):
            unsupported = Result.RESULT_FEATURE_UNSUPPORTED
            raise RefusedRequestError(unsupported, f"state {state} is unknown")

        def act(live: LiveRun) -> None:
            _check_own_time(live, "control")
            if _state_of(live) == state and live.goal is None:
                already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
                raise RefusedRequestError(already, "it is in that state already")
            {STOPPED: live.halt, PLAYING: live.play, PAUSED: live.pause}[state]()

        self._loop.request(act)

    def _on_step(
        self, request: StepSimulation.Request, response: StepSimulation.Response
    ) -> StepSimulation.Response:
        length = join_seconds(request.duration.sec, request.duration.nanosec)
        return self._answer_step(response, lambda live: live.run.time + length)

    def _on_run_to(
        self, request: RunToTime.Request, response: RunToTime.Response
    ) -> RunToTime.Response:
        stamp = join_seconds(request.time.sec, request.time.nanosec)

        def until(live: LiveRun) -> int:
            given = f"time = {stamp / SECOND:.6f} s"
            if stamp <= live.stamp:
                now = f"{live.stamp / SECOND:.6f} s"
                raise ParameterError(f"{given} is not after the drill's time, {now}")
            if stamp > live.stamp + LONGEST_STEP * SECOND:
                raise ParameterError(
                    f"{given} is more than {LONGEST_STEP:g} s after the drill's time"
                )
            return stamp - live.run.origin

        return self._answer_step(response, until)

    def _answer_step(self, response: Any, until_of: Callable[[LiveRun], int]) -> Any:
        def act() -> None:
            reached = self.step_until(until_of)
            response.time = nanoseconds_to_time(reached.stamp)
            response.topics = list(reached.published)
            response.published = list(reached.published.values())

        return self.answer(response, act)

    def _on_reset(
        self, request: ResetSimulation.Request, response: ResetSimulation.Response
    ) -> ResetSimulation.Response:
        seed = int(request.seed) if request.reseed else None
        return self.answer(response, lambda: self.reset(int(request.scope), seed))

    def _on_save(
        self, request: SaveSimulation.Request, response: SaveSimulation.Response
    ) -> SaveSimulation.Response:
        def act(live: LiveRun) -> None:
            stamp, names = live.save(request.name)
            response.time = nanoseconds_to_time(stamp)
            response.names = list(names)

        return self.answer(response, lambda: self._loop.request(act))

    def _on_restore(
        self, request: RestoreSimulation.Request, response: RestoreSimulation.Response
    ) -> RestoreSimulation.Response:
        def act(live: LiveRun) -> None:
            response.time = nanoseconds_to_time(live.restore(request.name))

        return self.answer(response, lambda: self._loop.request(act))


def _state_of(live: LiveRun) -> int:
    if live.playing:
        return PLAYING
    return STOPPED if live.at_start else PAUSED


def _check_own_time(live: LiveRun, verb: str) -> None:
    if live.follows_clock:
        reason = f"the time is that of /clock: {verb} its source"
        raise RefusedRequestError(Result.RESULT_FEATURE_UNSUPPORTED, reason)


def _result_of(error: Exception) -> int:
    if isinstance(error, RefusedRequestError):
        return error.result
    stopped = isinstance(error, StoppedError)
    return Result.RESULT_INCORRECT_STATE if stopped else Result.RESULT_OPERATION_FAILED
