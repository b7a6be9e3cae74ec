"""Client of one running drill."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from types import TracebackType
from typing import Any, TypeVar

from rcl_interfaces.srv import ListParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from rpud_msgs.msg import Drive, Fault, Feed, Result, SimulationState, Status, WeightOnBit
from rpud_msgs.srv import (
    ClearFault,
    InjectFault,
    ListFaults,
    ResetSimulation,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.ros.client.arguments import (
    FAULT_NUMBER,
    SEED,
    to_duration,
    to_number,
    to_text,
    to_time,
)
from rpud_sim.ros.client.confirmation import stamp_of
from rpud_sim.ros.client.drill_connection import DrillConnection
from rpud_sim.ros.client.errors import RefusedError
from rpud_sim.ros.client.telemetry import Telemetry

PATIENCE = 10.0
"""Time limit of a client, unless it is given another one [s]."""

SCOPES: Mapping[str, int] = {
    "all": ResetSimulation.Request.SCOPE_ALL,
    "time": ResetSimulation.Request.SCOPE_TIME,
    "state": ResetSimulation.Request.SCOPE_STATE,
    "faults": ResetSimulation.Request.SCOPE_SPAWNED,
}
"""What a reset may restart, by name."""

Value = TypeVar("Value")


class DrillClient:
    """Commands and hears one running drill.

    A command returns when the drill has accepted it, so that a step which follows cannot overtake
    it. It raises a ``RefusedError`` with the drill's own reason if the drill refuses it::

        with DrillClient() as drill:
            drill.pause()
            drill.press(30.0)
            drill.step(0.5)
            print(drill.status.impacts)

    The client has one node in a context of its own, and no thread: it takes messages while one of
    its methods waits. Use it from one thread. A drill that does not answer raises a
    ``NoAnswerError`` after the patience, a missing one a ``NoDrillError``.

    Args:
        namespace: of the drill.
        domain_id: ROS domain; None for that of the environment.
        node_name: name of the client's node.
        patience: time limit for each answer [s].

    Raises:
        StartError: if ROS or the node cannot start.
        ParameterError: if the patience is not a duration.
    """

    def __init__(
        self,
        namespace: str = "/rpud",
        domain_id: int | None = None,
        node_name: str = "drill_client",
        patience: float = PATIENCE,
    ) -> None:
        self._drill = DrillConnection(namespace, domain_id, node_name, patience)

    def __enter__(self) -> DrillClient:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def close(self) -> None:
        """Leave the graph."""
        self._drill.listening.close()

    @property
    def node(self) -> Node:
        """Node of the client, for publishers and services of your own."""
        return self._drill.node

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return self._drill.namespace

    @property
    def status(self) -> Status:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        return self._drill.status

    @property
    def time(self) -> float:
        """Stamp of the latest status [s]."""
        return stamp_of(self.status) / SECOND

    def check_while_waiting(self, check: Callable[[], object]) -> None:
        """Call this while a method waits; an error that it raises ends the wait.

        A test that has started the drill knows at once that the drill has died.
        """
        self._drill.listening.check = check

    @property
    def status_number(self) -> int:
        """Number that the drill's publisher has given to the latest status; 0 before the first."""
        return self._drill.watch.number

    @property
    def faults(self) -> list[Fault]:
        """Faults since the start, those that last and those that are over, by number."""
        self.found()
        faults = self._drill.until(lambda: self._drill.watch.faults, "no list of faults came")
        assert faults is not None  # until waits for it
        return list(faults.faults)

    def found(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status.

        Every other method does this first.

        Args:
            patience: time limit [s]; None for that of the client. A drill that has never run on a
                machine may compile for a minute.

        Raises:
            NoDrillError: if there is no such drill, or more than one.
            NoAnswerError: if it does not answer.
        """
        self._drill.find(patience)

    def press(self, force: float) -> None:
        """Command a weight on bit [N].

        Raises:
            RefusedError: if the drill refuses it.
        """
        force = to_number("force", force)
        self._drill.command(
            "weight_on_bit", WeightOnBit(force=force), {"force": force}, {"weight_on_bit": force}
        )

    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Command the voltage on the piezoelectric stack, or switch it off.

        Args:
            enabled: whether the actuator is driven.
            voltage: amplitude [V]; None for the present one.
            frequency: [Hz]; None for the present one.

        Raises:
            RefusedError: if the drill refuses it.
        """
        status = self.status
        present = (status.drive_voltage, status.drive_frequency) if enabled else (0.0, 0.0)
        message = Drive(
            enabled=bool(enabled),
            voltage=present[0] if voltage is None else to_number("voltage", voltage),
            frequency=present[1] if frequency is None else to_number("frequency", frequency),
        )
        values: dict[str, Any] = {"enabled": message.enabled}
        # While the drive is off, zero stands for the present value.
        if enabled or message.voltage:
            values["voltage"] = message.voltage
        if message.frequency:
            values["frequency"] = message.frequency
        in_status = {f"drive_{name}": value for name, value in values.items()}
        self._drill.command("drive", message, values, in_status)

    def feed(self, rate: float | None = None, position: float | None = None) -> None:
        """Command the feed of a drill on an arm: its rate or its position, and not both.

        Args:
            rate: toward the rock [m/s]; zero holds the mount.
            position: along the drill axis [m].

        Raises:
            ParameterError: if not exactly one of them is given.
            RefusedError: if the drill refuses it.
        """
        if (rate is None) == (position is None):
            raise ParameterError("feed takes a rate or a position")
        if rate is not None:
            mode, name, value = Feed.MODE_RATE, "rate", to_number("rate", rate)
        else:
            mode, name, value = Feed.MODE_POSITION, "position", to_number("position", position)
        message = Feed(mode=mode, value=value)
        in_status = {"feed_mode": mode, "feed_value": value}
        self._drill.command("feed", message, {"mode": name, "value": value}, in_status)

    def engage(self, on: bool = True) -> None:
        """Put the drill tool into the rock, or take it out.

        Raises:
            RefusedError: if the drill refuses it.
        """
        response = self._drill.call("engage", SetBool.Request(data=bool(on)), repeat=True)
        if not response.success:
            raise RefusedError(response.message)
        regime = Status.REGIME_DRILLING if on else Status.REGIME_FREE
        self._drill.until(lambda: self.status.regime == regime, f"no status said {regime}")

    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        """Inject a fault and return its number.

        Args:
            kind: such as ``free_mass_jammed``.
            channel: relative name of the topic with the faulty signal; empty for the physics.
            magnitude: in the unit of the kind; None for its default.
            duration: simulation time after which it ends by itself [s]; None for never.

        Raises:
            RefusedError: if the drill refuses it.
        """
        fault = Fault(
            kind=to_text("kind", kind),
            channel=to_text("channel", channel),
            magnitude=math.nan if magnitude is None else to_number("magnitude", magnitude),
        )
        length = to_duration("duration", 0.0 if duration is None else duration)
        request = InjectFault.Request(fault=fault, duration=length)
        response = self._drill.call("inject_fault", request)
        if not response.success:
            raise RefusedError(response.message)
        number = int(response.number)
        self._drill.until(
            lambda: any(each.number == number for each in self.faults),
            f"the topic faults did not show fault {number}",
        )
        return number

    def clear(self, which: int | str = "all") -> list[int]:
        """End active faults now and return their numbers.

        Args:
            which: number of a fault, a kind of faults, or ``all``.

        Raises:
            RefusedError: if no such fault is active.
        """
        numbers = self._active(which)
        for number in [0] if which == "all" else numbers:
            response = self._drill.call("clear_fault", ClearFault.Request(number=number))
            if not response.success:
                raise RefusedError(response.message)
        self._drill.until(
            lambda: not any(each.active and each.number in numbers for each in self.faults),
            "the topic faults did not show the end",
        )
        return numbers

    def list_faults(self) -> ListFaults.Response:
        """Return the active faults, and the kinds and channels that can be injected now."""
        return self._drill.call("list_faults", ListFaults.Request(), repeat=True)

    def pause(self) -> None:
        """Let simulation time stand still; a step that is under way is interrupted.

        Raises:
            RefusedError: if the drill refuses it.
        """
        self._set(SimulationState.STATE_PAUSED, Status.STATE_PAUSED)

    def play(self) -> None:
        """Let simulation time pass by itself.

        Raises:
            RefusedError: if the drill refuses it.
        """
        self._set(SimulationState.STATE_PLAYING, Status.STATE_RUNNING)

    def step(self, seconds: float) -> float:
        """Advance a paused drill, and return the stamp that it reached [s].

        Its status and all messages of that time that have arrived are taken before this returns.

        Args:
            seconds: of simulation time.

        Raises:
            RefusedError: if the drill refuses it.
        """
        duration = to_duration("step", seconds)
        return self._advance("simulation/step", StepSimulation.Request(duration=duration))

    def run_to(self, stamp: float) -> float:
        """Advance a paused drill to a stamp [s], and return the stamp that it reached [s].

        Raises:
            RefusedError: if the drill refuses it.
        """
        time = to_time("time", stamp)
        return self._advance("simulation/run_to", RunToTime.Request(time=time))

    def reset(self, scope: str | int = "all", seed: int | None = None) -> None:
        """Begin again; the drill plays on if it played.

        Args:
            scope: ``all``, ``time``, ``state``, ``faults``, or the bits of
                ``rpud_msgs/ResetSimulation``.
            seed: of the vibration's phase, the scenario and the noise from here on; None for the
                present one.

        Raises:
            RefusedError: if the drill refuses it.
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

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill, all of them or none.

        Raises:
            RefusedError: if the drill refuses one.
        """
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = SetParametersAtomically.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        name = "set_parameters_atomically"
        result = self._drill.call_node(name, SetParametersAtomically, request).result
        if not result.successful:
            raise RefusedError(self._unknown_parameter(values) or result.reason)

    def listen(
        self,
        topic: str,
        kind: Any = None,
        qos: QoSProfile | None = None,
        patience: float | None = None,
    ) -> list[Any]:
        """Subscribe to a topic, and return the list that its messages are added to.

        Args:
            topic: of any node; a relative name is one of the drill's namespace.
            kind: class of its messages; None for that with which it is published.
            qos: of the subscription; None for what its publishers offer.
            patience: time limit for the topic [s]; None for that of the client.

        Raises:
            NoAnswerError: if the topic has no publisher, and no type is given.
            UnknownTypeError: if the type is not installed.
        """
        return self._drill.listen(topic, kind, qos, patience)

    def until(
        self,
        condition: Callable[[], Value],
        patience: float | None = None,
        what: str = "the condition did not hold",
    ) -> Value:
        """Take messages until a condition holds, and return its value.

        Args:
            condition: looked at after each message.
            patience: time limit in real time [s]; None for that of the client.
            what: sentence for the error, without the limit.

        Raises:
            NoAnswerError: if it does not hold within the time limit.
        """
        self.found()
        return self._drill.until(condition, what, patience)

    def observe(self, observer: Callable[[str, Any], object]) -> None:
        """Call a function with the topic and each message of ``status``, ``faults``, ``journal``.

        They are latched: what came before is not repeated. Observe before the client has waited.
        """
        self._drill.watch.observer = observer

    def telemetry(self, sinks: Mapping[str, Callable[[int, tuple[Any, ...]], object]]) -> Telemetry:
        """Subscribe to fast topics, whose messages are decoded in a few microseconds.

        Args:
            sinks: by topic, a function of the stamp [ns] and the values, as ``Telemetry`` has them.
        """
        return Telemetry(self._drill.listening, sinks)

    def take(self) -> None:
        """Take all messages that have arrived, without a wait; responses and events stay."""
        self._drill.listening.settle()

    def spin(self, seconds: float = 0.0) -> None:
        """Take messages, responses and events that have arrived, or wait for the next one [s]."""
        self._drill.listening.spin(seconds)

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the drill's status; no node, no drill."""
        return self._drill.watch.publishers

    @property
    def last_refusal(self) -> tuple[int, str]:
        """Count of the commands that the drill has refused, and its reason for the latest."""
        return self._drill.watch.last_refusal

    def _active(self, which: int | str) -> list[int]:
        """Return the numbers of the active faults that are meant."""
        if not isinstance(which, str):
            return [int(FAULT_NUMBER.check("fault", which))]
        active = self.list_faults().faults
        numbers = [int(each.number) for each in active if which in ("all", each.kind)]
        if not numbers and which != "all":
            if not active:
                raise RefusedError("no fault is active")
            hint = did_you_mean(which, sorted({each.kind for each in active}))
            raise RefusedError(f"no fault {shown(which)} is active; {hint}")
        return numbers

    def _unknown_parameter(self, names: Iterable[str]) -> str:
        """Return a reason if one of these is no parameter: rclpy's does not name it."""
        response = self._drill.call_node(
            "list_parameters", ListParameters, ListParameters.Request()
        )
        known = response.result.names
        for name in names:
            if name not in known:
                return f"parameter {shown(name)} is unknown; {did_you_mean(name, known)}"
        return ""

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
