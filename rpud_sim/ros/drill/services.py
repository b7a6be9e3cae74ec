"""Services of the drill: faults, delivery, and simulation time."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from functools import partial
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.exceptions import NameValidationException
from rclpy.parameter import Parameter
from rpud_msgs.msg import Result, SimulationState
from rpud_msgs.srv import (
    ClearFault,
    GetDelivery,
    GetSimulationState,
    InjectFault,
    ListFaults,
    ResetSimulation,
    RestoreSimulation,
    RunToTime,
    SaveSimulation,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.live_run import LONGEST_STEP, InterruptedStepError, LiveRun, Reached
from rpud_sim.ros.drill.managed_node import ManagedNode
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.drill.publishers import message_to_fault, nanoseconds_to_time, record_to_fault
from rpud_sim.ros.graph import DiscoveryProbe
from rpud_sim.ros.threads import StoppedError
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import FaultError, check_kind
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.topics import CHANNELS, TOPICS

STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
QUITTING = SimulationState.STATE_QUITTING

Act = Callable[[Any, Any], object]  # on a request and its response

_MOST_NODES = 100  # that are asked at a time, whoever wants it


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
        node.create_service(InjectFault, "inject_fault", partial(self._answer, _inject))
        node.create_service(ClearFault, "clear_fault", partial(self._answer, _clear))
        node.create_service(ListFaults, "list_faults", self._on_list)
        node.create_service(SetBool, "engage", self._on_engage)

    def _on_list(self, request: ListFaults.Request, response: Any) -> Any:
        def act(live: LiveRun) -> None:
            simulation, origin = live.run.simulation, live.run.origin
            response.faults = [record_to_fault(each, origin) for each in simulation.faults.active]
            response.kinds = list(simulation.supported_kinds())

        with contextlib.suppress(StoppedError):  # without a run there are no faults
            self._loop.request(act)
        values = self._settings().values()
        response.channels = [name for name in CHANNELS if TOPICS[name].is_offered(values)]
        return response

    def _on_engage(self, request: SetBool.Request, response: Any) -> Any:
        if self._loop.live is None:
            return self._refuse(response, "the node has not been configured")
        regime = "drilling" if request.data else "free"
        result = self._node.set_parameters([Parameter("regime", value=regime)])[0]
        response.success = result.successful
        return response if result.successful else self._refuse(response, result.reason)

    def _answer(
        self, act: Callable[[Simulation, Any, Any], None], request: Any, response: Any
    ) -> Any:
        try:
            self._loop.request(
                lambda live: live.act(lambda run: act(run.simulation, request, response))
            )
        except (ParameterError, StoppedError) as error:
            return self._refuse(response, str(error))
        response.success = True
        return response

    def _refuse(self, response: Any, reason: str) -> Any:
        self._node.refuse_request(reason)
        response.message = reason
        return response


def _inject(simulation: Simulation, request: InjectFault.Request, response: Any) -> None:
    duration = join_seconds(request.duration.sec, request.duration.nanosec)
    if duration < 0:
        raise FaultError(f"duration = {duration / SECOND:g} s is less than zero")
    check_kind(request.fault.kind, simulation.supported_kinds())
    response.number = simulation.inject(message_to_fault(request.fault), duration)


def _clear(simulation: Simulation, request: ClearFault.Request, response: Any) -> None:
    if request.number:
        simulation.clear(request.number)
    else:
        simulation.clear_all()


class DeliveryServer:
    """Service that says what the drill has published, and who has discovered it.

    It is to be made after all subscriptions and services. Without a request it costs nothing.
    """

    def __init__(self, node: ManagedNode, loop: PacingLoop) -> None:
        self._node = node
        self._loop = loop
        self._probes: dict[str, DiscoveryProbe] = {}
        group = MutuallyExclusiveCallbackGroup()
        node.create_service(
            GetDelivery, "simulation/get_delivery", self._answer, callback_group=group
        )

    def _answer(self, request: GetDelivery.Request, response: Any) -> Any:
        for name in self._probes.keys() - set(request.nodes):
            self._probes.pop(name).close()
        response.unanswered = [name for name in request.nodes if not self._answered(name)]
        response.services = [each.service_name for each in self._node.services]
        response.clients = [self._node.count_clients(name) for name in response.services]
        live = self._loop.live
        if live is not None:
            publishers, heard = live.publishers, live.reporter.publishers_heard()
            response.topics = list(publishers.published)
            response.published = list(publishers.published.values())
            response.subscribers = list(publishers.subscribers().values())
            response.acknowledged = publishers.acknowledged()
            response.command_topics, response.publishers = list(heard), list(heard.values())
        return response

    def _answered(self, name: str) -> bool:
        if name not in self._probes:
            if len(self._probes) >= _MOST_NODES:
                return False
            try:
                self._probes[name] = DiscoveryProbe(self._node, name)
            except (NameValidationException, RuntimeError):  # RCLError: it is too long
                return False
        return self._probes[name].answered()


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
        for kind, name, act, group in (
            (GetSimulationState, "get_state", self.get_state, None),
            (SetSimulationState, "set_state", self.set_state, None),
            (StepSimulation, "step", self._step, self.stepping),
            (RunToTime, "run_to", self._run_to, self.stepping),
            (ResetSimulation, "reset", self._reset, None),
            (SaveSimulation, "save", self._save, None),
            (RestoreSimulation, "restore", self._restore, None),
        ):
            self.offer(kind, f"simulation/{name}", act, group)

    def offer(self, kind: Any, name: str, act: Act, group: CallbackGroup | None = None) -> None:
        """Offer a service whose response has the result of an action."""
        self._node.create_service(
            kind,
            name,
            lambda request, response: self.answer(response, lambda: act(request, response)),
            callback_group=group,
        )

    def controls_time(self) -> bool:
        """Return whether time can be paused and stepped: it follows no other ``/clock``."""
        return (live := self._loop.begun) is None or not live.follows_clock

    def get_state(self, request: Any, response: Any) -> None:
        """Answer with the state."""
        live = self._loop.begun
        response.state.state = STOPPED if live is None else _state_of(live)

    def set_state(self, request: Any, response: Any) -> None:
        """Play, pause, stop or quit."""
        state = int(request.state.state)
        if state == QUITTING:
            self._loop.quit()
            return
        if state not in (STOPPED, PLAYING, PAUSED):
            raise _unsupported(f"state {state} is unknown")

        def act(live: LiveRun) -> None:
            _check_own_time(live, "control")
            if _state_of(live) == state and live.goal is None:
                already = SetSimulationState.Response.ALREADY_IN_TARGET_STATE
                raise RefusedRequestError(already, "it is in that state already")
            {STOPPED: live.halt, PLAYING: live.play, PAUSED: live.pause}[state]()

        self._loop.request(act)

    def reset(self, scope: int, seed: int | None = None) -> None:
        """Restart the time, the state or both."""
        scopes = ResetSimulation.Request
        known = scopes.SCOPE_TIME | scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED
        bits = known if scope in (scopes.SCOPE_DEFAULT, scopes.SCOPE_ALL) else scope
        if bits & ~known:
            raise _unsupported(f"scope {scope} is unknown")
        time, state = bool(bits & scopes.SCOPE_TIME), bool(bits & scopes.SCOPE_STATE)

        def act(live: LiveRun) -> None:
            if time:
                _check_own_time(live, "reset")
            if bits & scopes.SCOPE_SPAWNED and not state:
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
        result = response.result
        try:
            act()
            result.result = Result.RESULT_OK
        except InterruptedStepError as error:
            result.result = Result.RESULT_OPERATION_FAILED
            result.error_message = f"interrupted: {error}"
        except Exception as error:  # the client must get an answer in any case
            result.result = _result_of(error)
            result.error_message = str(error)
            if result.result != SetSimulationState.Response.ALREADY_IN_TARGET_STATE:
                self._node.refuse_request(str(error))
        return response

    def _step(self, request: StepSimulation.Request, response: Any) -> None:
        length = join_seconds(request.duration.sec, request.duration.nanosec)
        self._advance(response, lambda live: live.run.time + length)

    def _run_to(self, request: RunToTime.Request, response: Any) -> None:
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

        self._advance(response, until)

    def _advance(self, response: Any, until_of: Callable[[LiveRun], int]) -> None:
        reached = self.step_until(until_of)
        response.time = nanoseconds_to_time(reached.stamp)
        response.topics = list(reached.published)
        response.published = list(reached.published.values())

    def _reset(self, request: ResetSimulation.Request, response: Any) -> None:
        self.reset(int(request.scope), int(request.seed) if request.reseed else None)

    def _save(self, request: SaveSimulation.Request, response: Any) -> None:
        def act(live: LiveRun) -> None:
            stamp, names = live.save(request.name)
            response.time, response.names = nanoseconds_to_time(stamp), list(names)

        self._loop.request(act)

    def _restore(self, request: RestoreSimulation.Request, response: Any) -> None:
        def act(live: LiveRun) -> None:
            response.time = nanoseconds_to_time(live.restore(request.name))

        self._loop.request(act)


def _state_of(live: LiveRun) -> int:
    if live.playing:
        return PLAYING
    return STOPPED if live.at_start else PAUSED


def _check_own_time(live: LiveRun, verb: str) -> None:
    if live.follows_clock:
        raise _unsupported(f"the time is that of /clock: {verb} its source")


def _unsupported(reason: str) -> RefusedRequestError:
    return RefusedRequestError(Result.RESULT_FEATURE_UNSUPPORTED, reason)


def _result_of(error: Exception) -> int:
    if isinstance(error, RefusedRequestError):
        return error.result
    stopped = isinstance(error, StoppedError)
    return Result.RESULT_INCORRECT_STATE if stopped else Result.RESULT_OPERATION_FAILED
