"""Client of one running drill."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypeVar

from builtin_interfaces.msg import Duration, Time
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rpud_msgs.msg import Drive, Fault, Feed, Result, SimulationState, Status, WeightOnBit
from rpud_msgs.srv import (
    ClearFault,
    GetDelivery,
    InjectFault,
    ListFaults,
    ResetSimulation,
    RunToTime,
    SetSimulationState,
    StepSimulation,
)
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, shown
from rpud_sim.foundation.time import SECOND, join_seconds, split_seconds
from rpud_sim.ros.client.drill_connection import SECONDS, DrillConnection
from rpud_sim.ros.client.listening_node import RefusedError
from rpud_sim.ros.client.telemetry import Telemetry

PATIENCE = 10.0  # time limit of a client, unless it is given another one [s]

# What a reset may restart, by name.
SCOPES: Mapping[str, int] = {
    "all": ResetSimulation.Request.SCOPE_ALL,
    "time": ResetSimulation.Request.SCOPE_TIME,
    "state": ResetSimulation.Request.SCOPE_STATE,
    "faults": ResetSimulation.Request.SCOPE_SPAWNED,
}
_SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)
_FAULT_NUMBER = Quantity("", "the number of a fault", 1, 2**32 - 1, whole=True)

Value = TypeVar("Value")


class DrillClient(DrillConnection):
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
    ``NoAnswerError`` after the patience, a missing one a ``NoDrillError``. ``patience`` is in s.
    """

    def __init__(
        self,
        namespace: str = "/rpud",
        domain_id: int | None = None,
        node_name: str = "drill_client",
        patience: float = PATIENCE,
    ) -> None:
        super().__init__(namespace, domain_id, node_name, patience)
        self._published: Mapping[str, int] = {}

    def __enter__(self) -> DrillClient:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def time(self) -> float:
        """Stamp of the latest status [s]."""
        return _stamp_of(self.status) / SECOND

    @property
    def published(self) -> Mapping[str, int]:
        """Messages that the drill had published on each topic when the last step ended."""
        return self._published

    def delivery(self, nodes: Sequence[str] = ()) -> GetDelivery.Response:
        """Return what the drill has published, and who has discovered it.

        It asks these nodes, by full names, whether they know the drill: ask again until all have
        answered.
        """
        request = GetDelivery.Request(nodes=nodes)
        return self._call("simulation/get_delivery", request, repeat=True)

    def telemetry(self, sinks: Mapping[str, Callable[[int, tuple[Any, ...]], object]]) -> Telemetry:
        """Subscribe to fast topics, whose messages are decoded in a few microseconds.

        ``sinks`` has, by topic, a function of the stamp [ns] and the values, as ``Telemetry`` has
        them.
        """
        return Telemetry(self._listening, sinks)

    # Commands: each returns when the drill has accepted it.

    def press(self, force: float) -> None:
        """Command a weight on bit [N]."""
        self._command("weight_on_bit", WeightOnBit(force=_number("force", force)))

    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Command amplitude [V] and frequency [Hz], None as they are, or switch the drive off."""
        status = self.status
        present = (status.drive_voltage, status.drive_frequency) if enabled else (0.0, 0.0)
        message = Drive(
            enabled=bool(enabled),
            voltage=present[0] if voltage is None else _number("voltage", voltage),
            frequency=present[1] if frequency is None else _number("frequency", frequency),
        )
        self._command("drive", message)

    def feed(self, rate: float | None = None, position: float | None = None) -> None:
        """Command the feed of a drill on an arm: its rate or its position, and not both.

        The rate is toward the rock [m/s], where zero holds the mount; the position is along the
        drill axis [m].
        """
        if (rate is None) == (position is None):
            raise ParameterError("feed takes a rate or a position")
        if rate is not None:
            message = Feed(mode=Feed.MODE_RATE, value=_number("rate", rate))
        else:
            message = Feed(mode=Feed.MODE_POSITION, value=_number("position", position))
        self._command("feed", message)

    def engage(self, on: bool = True) -> None:
        """Put the drill tool into the rock, or take it out."""
        _check_success(self._call("engage", SetBool.Request(data=bool(on)), repeat=True))
        regime = Status.REGIME_DRILLING if on else Status.REGIME_FREE
        self.until(lambda: self.status.regime == regime, what=f"no status said {regime}")

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill, all of them or none."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = SetParametersAtomically.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        name = "set_parameters_atomically"
        result = self._call_node(name, SetParametersAtomically, request).result
        if not result.successful:
            raise RefusedError(result.reason)

    # Faults: a call returns when the topic ``faults`` shows the change.

    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        """Inject a fault, such as ``free_mass_jammed``, and return its number.

        ``channel`` is the relative name of the topic with the faulty signal; empty for the physics.
        The magnitude is in the unit of the kind; None for its default. After a duration in
        simulation time [s] it ends by itself; None for never.
        """
        fault = Fault(
            kind=_text("kind", kind),
            channel=_text("channel", channel),
            magnitude=math.nan if magnitude is None else _number("magnitude", magnitude),
        )
        sec, nanosec = _split("duration", 0.0 if duration is None else duration)
        request = InjectFault.Request(fault=fault, duration=Duration(sec=sec, nanosec=nanosec))
        response = _check_success(self._call("inject_fault", request))
        number = int(response.number)
        self.until(
            lambda: any(each.number == number for each in self.faults),
            what=f"the topic faults did not show fault {number}",
        )
        return number

    def clear(self, which: int | str = "all") -> list[int]:
        """End active faults now: ``which`` is a number, a kind or ``all``. Return their numbers."""
        numbers = self._active(which)
        for number in [0] if which == "all" else numbers:
            _check_success(self._call("clear_fault", ClearFault.Request(number=number)))
        self.until(
            lambda: not any(each.active and each.number in numbers for each in self.faults),
            what="the topic faults did not show the end",
        )
        return numbers

    def list_faults(self) -> ListFaults.Response:
        """Return the active faults, and the kinds and channels that can be injected now."""
        return self._call("list_faults", ListFaults.Request(), repeat=True)

    def _active(self, which: int | str) -> list[int]:
        if not isinstance(which, str):
            return [int(_FAULT_NUMBER.check("fault", which))]
        active = self.list_faults().faults
        numbers = [int(each.number) for each in active if which in ("all", each.kind)]
        if not numbers and which != "all":
            if not active:
                raise RefusedError("no fault is active")
            hint = did_you_mean(which, sorted({each.kind for each in active}))
            raise RefusedError(f"no fault {shown(which)} is active; {hint}")
        return numbers

    # Simulation time: a call returns when the topic ``status`` shows the change.

    def pause(self) -> None:
        """Let simulation time stand still; a step that is under way is interrupted."""
        self._set_state(SimulationState.STATE_PAUSED, Status.STATE_PAUSED)

    def play(self) -> None:
        """Let simulation time pass by itself."""
        self._set_state(SimulationState.STATE_PLAYING, Status.STATE_RUNNING)

    def step(self, seconds: float) -> float:
        """Advance a paused drill, and return the stamp that it reached [s].

        Its status and all messages of that time that have arrived are taken before this returns.
        """
        sec, nanosec = _split("step", seconds)
        request = StepSimulation.Request(duration=Duration(sec=sec, nanosec=nanosec))
        return self._advance("simulation/step", request)

    def run_to(self, stamp: float) -> float:
        """Advance a paused drill to a stamp [s], and return the stamp that it reached [s]."""
        sec, nanosec = _split("time", stamp)
        request = RunToTime.Request(time=Time(sec=sec, nanosec=nanosec))
        return self._advance("simulation/run_to", request)

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
            request.reseed, request.seed = True, int(_SEED.check("seed", seed))
        before, count = self.status, self._statuses
        _check_result(self._call("simulation/reset", request).result)
        self.until(
            lambda: self._statuses > count and _is_reset(self.status, before, bits),
            what="no status showed the reset",
        )
        self.take()

    def _set_state(self, state: int, name: str) -> None:
        request = SetSimulationState.Request(state=SimulationState(state=state))
        result = self._call("simulation/set_state", request, repeat=True).result
        if result.result != SetSimulationState.Response.ALREADY_IN_TARGET_STATE:
            _check_result(result)
        states = (name, Status.STATE_INACTIVE)  # which says nothing about its time
        self.until(lambda: self.status.state in states, what=f"no status said {name}")

    def _advance(self, name: str, request: Any) -> float:
        response = self._call(name, request)
        _check_result(response.result)
        self._published = dict(zip(response.topics, response.published, strict=True))
        reached = join_seconds(response.time.sec, response.time.nanosec)
        self.until(
            lambda: _stamp_of(self.status) >= reached, what="no status showed the end of the step"
        )
        self.take()
        return reached / SECOND


# Arguments as fields of messages; the drill itself checks their ranges.


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{name} = {shown(value)} is not a number") from None


def _text(name: str, value: Any) -> str:
    if not isinstance(value, str):
        raise ParameterError(f"{name} = {shown(value)} is not a text")
    return value


def _split(name: str, seconds: Any) -> tuple[int, int]:
    """Return seconds as whole ones and the nanoseconds of the rest, as a message has them."""
    return split_seconds(min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1))


def _stamp_of(status: Status) -> int:
    """Return the stamp of a status [ns]."""
    return join_seconds(status.header.stamp.sec, status.header.stamp.nanosec)


def _check_success(response: Any) -> Any:
    if not response.success:
        raise RefusedError(response.message)
    return response


def _check_result(result: Result) -> None:
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
    began_again = _stamp_of(status) != _stamp_of(before) or _stamp_of(status) == 0
    return (not bits & request.SCOPE_STATE or counts == 0) and (
        not bits & request.SCOPE_TIME or began_again
    )
