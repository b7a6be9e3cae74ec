"""Services that play, pause, step and reset the simulation, and take it back to checkpoints."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.node import Node
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

from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.host import DrillHost
from rpud_sim.ros.drill.messages import nanoseconds_to_time
from rpud_sim.ros.drill.time_control import InterruptedStepError, Reached, TimeControl
from rpud_sim.ros.requests import StoppedError

STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
QUITTING = SimulationState.STATE_QUITTING

LONGEST_STEP = 1e6  # [s]; longer than any mission


class RefusedError(Exception):
    """Refused request, with the number of its result."""

    def __init__(self, result: int, reason: str) -> None:
        super().__init__(reason)
        self.result = result


class SimulationServices:
    """Services of the namespace ``simulation``: states, steps, resets and checkpoints.

    States, results and refusals are those of the ``simulation_interfaces`` standard.
    """

    def __init__(self, node: Node, host: DrillHost) -> None:
        self._host = host
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
        drilling = self._host.drilling
        return drilling is None or not drilling.follows_clock

    def get_state(self, request: Any, response: Any) -> Any:
        """Answer with the state."""
        drilling = self._host.drilling
        response.state.state = STOPPED if drilling is None else _state_of(drilling.time_control)
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
            raise RefusedError(Result.RESULT_FEATURE_UNSUPPORTED, f"scope {scope} is unknown")
        drilling = self._controlled()
        time, state = bool(bits & whole.SCOPE_TIME), bool(bits & whole.SCOPE_STATE)
        if time and drilling.follows_clock:
            raise RefusedError(
                Result.RESULT_FEATURE_UNSUPPORTED, "the time is that of /clock: reset its source"
            )

        def act(drilling: Drilling) -> None:
            if bits & whole.SCOPE_SPAWNED and not state:
                drilling.act(lambda run: run.simulation.clear_all())
            drilling.reset(time=time, state=state, seed=seed)

        self._host.request(act)

    def step_until(self, until_of: Callable[[Drilling], int]) -> Reached:
        """Step to a simulation time [ns].

        ``until_of`` returns that time between two blocks, and may raise a RefusedError. A step that
        ends before its time is an InterruptedStepError.
        """
        drilling = self._controlled()
        if drilling.follows_clock:
            raise RefusedError(
                Result.RESULT_FEATURE_UNSUPPORTED, "the time is that of /clock: step its source"
            )

        def begin(drilling: Drilling) -> Any:
            control = drilling.time_control
            for holds, state in (
                (control.playing, "playing"),
                (control.at_start, "stopped"),
                (control.stepping, "stepping already"),
            ):
                if holds:
                    raise RefusedError(Result.RESULT_OPERATION_FAILED, f"it is {state}, not paused")
            until = until_of(drilling)
            now = drilling.run.time
            if not now < until <= now + LONGEST_STEP * SECOND:
                ahead = (until - now) / SECOND
                raise RefusedError(
                    Result.RESULT_OPERATION_FAILED,
                    f"step = {ahead:g} s is outside its range (0, {LONGEST_STEP:g}] s",
                )
            return drilling.step(until)

        reached: Reached = self._host.request(begin)
        return reached

    def answer(self, response: Any, act: Callable[[], Any]) -> Any:
        """Fill the response with the result of an action, and return it."""
        try:
            act()
            response.result.result = Result.RESULT_OK
        except RefusedError as refused:
            response.result.result = refused.result
            response.result.error_message = str(refused)
            if refused.result != SetSimulationState.Response.ALREADY_IN_TARGET_STATE:
                self._host.refuse_request(str(refused))
        except InterruptedStepError as error:
            response.result.result = Result.RESULT_OPERATION_FAILED
            response.result.error_message = f"interrupted: {error}"
        except StoppedError as error:
            response.result.result = Result.RESULT_INCORRECT_STATE
            response.result.error_message = str(error)
            self._host.refuse_request(str(error))
        except Exception as error:  # the client must get an answer in any case
            response.result.result = Result.RESULT_OPERATION_FAILED
            response.result.error_message = str(error)
            self._host.refuse_request(str(error))
        return response

    def _controlled(self) -> Drilling:
        drilling = self._host.drilling
        if drilling is None:
            raise RefusedError(Result.RESULT_INCORRECT_STATE, "the node has not been activated")
        return drilling

    def _set_state(self, state: int) -> None:
        if state == QUITTING:
            self._host.quit()
            return
        if state not in (STOPPED, PLAYING, PAUSED):
            raise RefusedError(Result.RESULT_FEATURE_UNSUPPORTED, f"state {state} is unknown")
        drilling = self._controlled()
        if drilling.follows_clock:
            raise RefusedError(
                Result.RESULT_FEATURE_UNSUPPORTED, "the time is that of /clock: control its source"
            )

        def act(drilling: Drilling) -> None:
            if _state_of(drilling.time_control) == state and not drilling.time_control.stepping:
                already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
                raise RefusedError(already, "it is in that state already")
            {STOPPED: drilling.halt, PLAYING: drilling.play, PAUSED: drilling.pause}[state]()

        self._host.request(act)

    def _on_step(
        self, request: StepSimulation.Request, response: StepSimulation.Response
    ) -> StepSimulation.Response:
        length = join_seconds(request.duration.sec, request.duration.nanosec)
        return self._answer_step(response, lambda drilling: drilling.run.time + length)

    def _on_run_to(
        self, request: RunToTime.Request, response: RunToTime.Response
    ) -> RunToTime.Response:
        stamp = join_seconds(request.time.sec, request.time.nanosec)

        def until(drilling: Drilling) -> int:
            now = drilling.run.origin + drilling.run.time
            given = f"time = {stamp / SECOND:.6f} s"
            if stamp <= now:
                reason = f"{given} is not after the drill's time, {now / SECOND:.6f} s"
                raise RefusedError(Result.RESULT_OPERATION_FAILED, reason)
            if stamp > now + LONGEST_STEP * SECOND:
                reason = f"{given} is more than {LONGEST_STEP:g} s after the drill's time"
                raise RefusedError(Result.RESULT_OPERATION_FAILED, reason)
            return stamp - drilling.run.origin

        return self._answer_step(response, until)

    def _answer_step(self, response: Any, until_of: Callable[[Drilling], int]) -> Any:
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
        def act() -> None:
            self._controlled()
            stamp, names = self._host.request(lambda drilling: drilling.save(request.name))
            response.time = nanoseconds_to_time(stamp)
            response.names = list(names)

        return self.answer(response, act)

    def _on_restore(
        self, request: RestoreSimulation.Request, response: RestoreSimulation.Response
    ) -> RestoreSimulation.Response:
        def act() -> None:
            self._controlled()
            stamp = self._host.request(lambda drilling: drilling.restore(request.name))
            response.time = nanoseconds_to_time(stamp)

        return self.answer(response, act)


def _state_of(control: TimeControl) -> int:
    if control.playing:
        return PLAYING
    return STOPPED if control.at_start else PAUSED
