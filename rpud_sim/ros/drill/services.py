"""Services of the drill: faults, journal, delivery and time, also as the standard has them."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup, MutuallyExclusiveCallbackGroup
from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import deserialize_message
from rpud_msgs.msg import Fault as FaultMessage
from rpud_msgs.msg import JournalEntry, Result, SimulationState
from rpud_msgs.srv import (
    ClearFault,
    GetDelivery,
    GetJournal,
    GetSimulationState,
    InjectFault,
    ListFaults,
    ResetSimulation,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.drill.managed_node import ManagedNode
from rpud_sim.ros.drill.pacing_loop import PacingLoop
from rpud_sim.ros.drill.publishers import nanoseconds_to_time
from rpud_sim.ros.drill.session import Session
from rpud_sim.ros.drill.timeline import INTERRUPTED, LONGEST_STEP, Reached
from rpud_sim.ros.graph import DiscoveryProbe, filled
from rpud_sim.ros.threads import RequestError
from rpud_sim.ros.waiting import OwnGroup
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.changes import Clear, Inject
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.fields import fault_fields
from rpud_sim.simulation.topics import ALL_COMMAND_TOPICS, CHANNELS, TOPICS

try:
    from simulation_interfaces import srv as standard
    from simulation_interfaces.msg import SimulatorFeatures

except ImportError:
    standard = None

STOPPED = SimulationState.STATE_STOPPED
PLAYING = SimulationState.STATE_PLAYING
PAUSED = SimulationState.STATE_PAUSED
QUITTING = SimulationState.STATE_QUITTING
_ALREADY = SetSimulationState.Response.ALREADY_IN_TARGET_STATE

_MOST_NODES = 100  # that are asked at a time, for any request


class DrillServices:
    """Services for faults, journal and time, with the results of ``simulation_interfaces``."""

    def __init__(
        self, node: ManagedNode, loop: PacingLoop, settings: Callable[[], Settings]
    ) -> None:
        self._node = node
        self._loop = loop
        self._settings = settings
        # A step takes long: meanwhile the other services must answer. Tests ask for thousands: a
        # thread answers in a third of the time that an executor takes.
        self.stepping = OwnGroup()
        node.create_service(ListFaults, "list_faults", self._list_faults)
        # A page takes as long as some commands.
        own = MutuallyExclusiveCallbackGroup()
        node.create_service(GetJournal, "~/get_journal", self._get_journal, callback_group=own)
        for kind, name, act, group in (
            (InjectFault, "inject_fault", self._inject, None),
            (ClearFault, "clear_fault", self._clear, None),
            (SetBool, "engage", self._engage, None),
            (GetSimulationState, "simulation/get_state", self.get_state, None),
            (SetSimulationState, "simulation/set_state", self.set_state, None),
            (StepSimulation, "simulation/step", self._step, self.stepping),
            (RunToTime, "simulation/run_to", self._run_to, self.stepping),
            (ResetSimulation, "simulation/reset", self._reset, None),
        ):
            self.offer(kind, name, act, group)

    def offer(
        self,
        kind: Any,
        name: str,
        act: Callable[[Any, Any], object],
        group: CallbackGroup | None = None,
    ) -> None:
        """Offer a service whose response has the result of an action on request and response."""
        self._node.create_service(
            kind,
            name,
            lambda request, response: self.answer(response, lambda: act(request, response)),
            callback_group=group,
        )

    def answer(self, response: Any, act: Callable[[], object]) -> Any:
        """Fill the response with the result of an action, and return it."""
        code, reason = Result.RESULT_OK, ""
        try:
            act()
        except Exception as error:  # the client must get an answer in any case
            code, reason = Result.RESULT_OPERATION_FAILED, str(error)
            own = error.result if isinstance(error, RequestError) else code
            code = Result.RESULT_INCORRECT_STATE if own is None else own
            if code != _ALREADY and not (isinstance(error, RequestError) and own == INTERRUPTED):
                self._node.refuse_request(reason)
        if hasattr(response, "result"):
            response.result.result, response.result.error_message = code, reason
        else:
            response.success, response.message = code == Result.RESULT_OK, reason
        return response

    def _get_journal(self, request: GetJournal.Request, response: Any) -> Any:
        with contextlib.suppress(RequestError):  # then nothing waits to be published
            self._loop.request(Session.publish_changes)
        if (session := self._loop.session) is not None:
            journal = session.publishers.journal
            entries = journal.read(request.first)
            response.first_kept, response.count = journal.first_kept, journal.count
            response.entries = [deserialize_message(data, JournalEntry) for _, data in entries]
            response.publish_times = [published for published, _ in entries]
        return response

    # Faults.

    def _list_faults(self, request: ListFaults.Request, response: Any) -> Any:
        def act(session: Session) -> None:
            simulation, origin = session.run.simulation, session.run.origin
            response.faults = [
                filled(FaultMessage(), fault_fields(record, origin))
                for record in simulation.faults.active
            ]
            response.kinds = list(simulation.supported_kinds())

        with contextlib.suppress(RequestError):  # without a run there are no faults
            self._loop.request(act)
        response.channels = self._channels()
        return response

    def _channels(self) -> list[str]:
        values = self._settings().values()
        return [name for name in CHANNELS if TOPICS[name].is_offered(values)]

    def _inject(self, request: InjectFault.Request, response: Any) -> None:
        def act(session: Session) -> None:
            duration = join_seconds(request.duration.sec, request.duration.nanosec)
            if duration < 0:
                raise ParameterError(f"duration = {duration / SECOND:g} s is less than zero")
            kind = KINDS.get(request.fault.kind)
            if kind is not None and not (kind.physical or request.fault.channel):
                held = ", ".join(self._channels())
                raise ParameterError(f"{request.fault.kind} needs --channel; this drill has {held}")
            fault = message_to_fault(request.fault)
            [response.number] = session.run.apply(Inject(fault, duration))
            session.report()

        self._loop.request(act)

    def _clear(self, request: ClearFault.Request, response: Any) -> None:
        def act(session: Session) -> None:
            session.run.apply(Clear(request.number))
            session.report()

        self._loop.request(act)

    def _engage(self, request: SetBool.Request, response: Any) -> None:
        if self._loop.session is None:
            raise RequestError("the node has not been configured")
        regime = "drilling" if request.data else "free"
        result = self._node.set_parameters([Parameter("regime", value=regime)])[0]
        if not result.successful:
            raise ParameterError(result.reason)

    # Simulation time.

    def controls_time(self) -> bool:
        """Return whether time can be paused and stepped: it follows no other ``/clock``."""
        return (session := self._loop.started) is None or not session.timeline.source.follows

    def get_state(self, request: Any, response: Any) -> None:
        """Answer with the state."""
        session = self._loop.started
        response.state.state = STOPPED if session is None else _state_of(session)

    def set_state(self, request: Any, response: Any) -> None:
        """Play, pause, stop or quit."""
        state = int(request.state.state)
        if state == QUITTING:
            self._loop.quit()
            return
        if state not in (STOPPED, PLAYING, PAUSED):
            raise _unsupported(f"state {state} is unknown")

        def act(session: Session) -> None:
            _check_own_time(session, "control")
            if _state_of(session) == state and session.timeline.goal is None:
                raise RequestError("it is in that state already", _ALREADY)
            timeline = session.timeline
            {STOPPED: session.halt, PLAYING: timeline.play, PAUSED: timeline.pause}[state]()

        self._loop.request(act)

    def reset(self, scope: int, seed: int | None = None) -> None:
        """Restart the time, the state or both."""
        scopes = ResetSimulation.Request
        known = scopes.SCOPE_TIME | scopes.SCOPE_STATE | scopes.SCOPE_SPAWNED
        bits = known if scope in (scopes.SCOPE_DEFAULT, scopes.SCOPE_ALL) else scope
        if bits & ~known:
            raise _unsupported(f"scope {scope} is unknown")
        time, state = bool(bits & scopes.SCOPE_TIME), bool(bits & scopes.SCOPE_STATE)

        def act(session: Session) -> None:
            if time:
                _check_own_time(session, "reset")
            session.reset(time, state, bool(bits & scopes.SCOPE_SPAWNED), seed)

        self._loop.request(act)

    def step_until(self, until_of: Callable[[Session], int], shuffle: int = 0) -> Reached:
        """Step to a time [ns] that is found between two blocks, or raise RequestError.

        ``shuffle`` is as in ``Session.step``.
        """

        def begin(session: Session) -> Any:
            _check_own_time(session, "step")
            return session.step(until_of(session), shuffle)

        reached: Reached = self._loop.request(begin)
        return reached

    def _advance(
        self, request: Any, response: Any, until_of: Callable[[Session], int], shuffle: int = 0
    ) -> None:
        reached = self.step_until(until_of, shuffle)
        response.time = nanoseconds_to_time(reached.stamp)
        response.topics = list(reached.published)
        response.published = list(reached.published.values())
        filled(response.status, reached.status)
        if request.entries_from and (session := self._loop.session) is not None:
            entries = session.publishers.journal.read(request.entries_from)
            response.entries = [deserialize_message(data, JournalEntry) for _, data in entries]
        if reached.failure:
            raise RequestError(reached.failure, Result.RESULT_OPERATION_FAILED)

    def _step(self, request: StepSimulation.Request, response: Any) -> None:
        length = join_seconds(request.duration.sec, request.duration.nanosec)
        shuffle = int(request.shuffle)
        self._advance(request, response, lambda session: session.run.time + length, shuffle)

    def _run_to(self, request: RunToTime.Request, response: Any) -> None:
        stamp = join_seconds(request.time.sec, request.time.nanosec)

        def until(session: Session) -> int:
            if not 0 < stamp - session.stamp <= LONGEST_STEP * SECOND:
                raise ParameterError(
                    f"time = {stamp / SECOND:.6f} s is not after the drill's time, "
                    f"{session.stamp / SECOND:.6f} s, by {LONGEST_STEP:g} s at most"
                )
            return stamp - session.run.origin

        self._advance(request, response, until)

    def _reset(self, request: ResetSimulation.Request, response: Any) -> None:
        self.reset(int(request.scope), int(request.seed) if request.reseed else None)


def message_to_fault(message: FaultMessage) -> Fault:
    """Convert a fault to inject; a magnitude of zero is one that was left out."""
    return Fault(message.kind, message.channel, message.magnitude or math.nan)


def _state_of(session: Session) -> int:
    if session.timeline.playing:
        return PLAYING
    return STOPPED if session.timeline.at_start else PAUSED


def _check_own_time(session: Session, verb: str) -> None:
    if session.timeline.source.follows:
        raise _unsupported(f"the time comes from /clock: {verb} its source")


def _unsupported(reason: str) -> RequestError:
    return RequestError(reason, Result.RESULT_FEATURE_UNSUPPORTED)


class DeliveryServer:
    """Service that shows what the drill has published, and who has discovered it; made last."""

    def __init__(self, node: ManagedNode, loop: PacingLoop) -> None:
        self._node = node
        self._loop = loop
        self._probes: dict[str, DiscoveryProbe] = {}
        # The graph names a publisher before its commands arrive; they count those that reach it.
        self._commands = [each for each in node.subscriptions if each.topic in ALL_COMMAND_TOPICS]
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
        if (session := self._loop.session) is not None:
            own, published = session.publishers.own, session.publishers.published
            response.topics, response.published = list(published), list(published.values())
            response.subscribers = list(own.subscribers.values())
            response.acknowledged = all(each.acknowledged() for each in own.values())
            response.command_topics = [each.topic for each in self._commands]
            response.publishers = [each.get_publisher_count() for each in self._commands]
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


def offer_standard_services(node: Node, services: DrillServices) -> None:
    """Offer ``simulation_interfaces`` where it is installed; a step is a telemetry period."""
    if standard is None:
        return

    def answer_features(request: Any, response: Any) -> Any:
        names = (*_FEATURES, *(_FEATURES_OF_TIME if services.controls_time() else ()))
        response.features.features = sorted(getattr(SimulatorFeatures, name) for name in names)
        response.features.custom_info = "rpud_sim: a step is one period of telemetry_rate"
        return response

    def step(request: Any, response: Any) -> None:
        def until(session: Session) -> int:
            rate = session.settings.telemetry_rate
            return boundary(boundaries_until(session.run.time, rate) + int(request.steps), rate)

        services.step_until(until)

    node.create_service(standard.GetSimulatorFeatures, "get_simulator_features", answer_features)
    services.offer(standard.GetSimulationState, "get_simulation_state", services.get_state)
    services.offer(standard.SetSimulationState, "set_simulation_state", services.set_state)
    services.offer(standard.StepSimulation, "step_simulation", step, services.stepping)
    services.offer(
        standard.ResetSimulation,
        "reset_simulation",
        lambda request, response: services.reset(int(request.scope)),
    )
