"""Client of one running drill."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from builtin_interfaces.msg import Duration, Time
from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.parameter import Parameter
from rpud_msgs import msg, srv
from rpud_msgs.msg import Fault, Feed, Status
from std_srvs.srv import SetBool

from rpud_sim.foundation.quantities import ParameterError, Quantity, Text, did_you_mean, shown
from rpud_sim.foundation.time import SECOND, join_seconds, split_seconds
from rpud_sim.ros.client.drill_connection import SECONDS, DrillConnection
from rpud_sim.ros.client.listening_node import RefusedError
from rpud_sim.ros.client.telemetry import FastTopics, Sink

PATIENCE = 10.0  # time limit of a client, unless it is given another one [s]

# What a reset may restart, by name.
SCOPES: Mapping[str, int] = {
    "all": srv.ResetSimulation.Request.SCOPE_ALL,
    "time": srv.ResetSimulation.Request.SCOPE_TIME,
    "state": srv.ResetSimulation.Request.SCOPE_STATE,
    "faults": srv.ResetSimulation.Request.SCOPE_SPAWNED,
}
_ALREADY = srv.SetSimulationState.Response.ALREADY_IN_TARGET_STATE
_SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)
_FAULT_KIND = Text("kind of a fault", "a kind of fault")
_CHANNEL = Text("topic of a faulty signal", "a topic")
_FAULT_NUMBER = Quantity("", "the number of a fault", 1, 2**32 - 1, whole=True)


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

    def delivery(self, nodes: Sequence[str] = ()) -> srv.GetDelivery.Response:
        """Return what the drill has published, and who has discovered it.

        It asks these nodes, by full names, whether they know the drill: ask again until all have
        answered.
        """
        request = srv.GetDelivery.Request(nodes=nodes)
        return self._call("simulation/get_delivery", request, repeat=True)

    def telemetry(self, sinks: Mapping[str, Sink]) -> FastTopics:
        """Subscribe to fast topics, whose messages are decoded in a few microseconds.

        ``sinks`` has, by topic, a function of the stamp [ns] and the values, as ``FastTopics`` has
        them.
        """
        return FastTopics(self._listening, sinks)

    # Commands: each returns when the drill has accepted it.

    def press(self, force: float) -> None:
        """Command a weight on bit [N]."""
        self._command("weight_on_bit", msg.WeightOnBit(force=_number("force", force)))

    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        """Command amplitude [V] and frequency [Hz], None as they are, or switch the drive off."""
        status = self.status
        present = (status.drive_voltage, status.drive_frequency) if enabled else (0.0, 0.0)
        message = msg.Drive(
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
        self._ask("engage", SetBool.Request(data=bool(on)), repeat=True)
        regime = Status.REGIME_DRILLING if on else Status.REGIME_FREE
        self.until(lambda: self.status.regime == regime, what=f"no status said {regime}")

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill, all of them or none."""
        parameters = [Parameter(name, value=value) for name, value in values.items()]
        request = SetParametersAtomically.Request(
            parameters=[parameter.to_parameter_msg() for parameter in parameters]
        )
        nodes = self.until(
            lambda: list(filter(None, self.publishers)),
            what="the name of the drill's node was not discovered",
        )
        name = f"{nodes[0]}/set_parameters_atomically"
        if name not in self._clients:
            self._clients[name] = self.node.create_client(SetParametersAtomically, name)
            self._introduce(self._patience)
        self._ask(name, request, repeat=True)

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
            kind=_FAULT_KIND.check("kind", kind),
            channel=_CHANNEL.check("channel", channel),
            magnitude=math.nan if magnitude is None else _number("magnitude", magnitude),
        )
        lasting = _time(Duration, "duration", 0.0 if duration is None else duration)
        request = srv.InjectFault.Request(fault=fault, duration=lasting)
        number = int(self._ask("inject_fault", request).number)
        self.until(
            lambda: any(each.number == number for each in self.faults),
            what=f"the topic faults did not show fault {number}",
        )
        return number

    def clear(self, which: int | str = "all") -> list[int]:
        """End active faults now: ``which`` is a number, a kind or ``all``. Return their numbers."""
        if not isinstance(which, str):
            numbers = [int(_FAULT_NUMBER.check("fault", which))]
        else:
            active = self.list_faults().faults
            numbers = [int(each.number) for each in active if which in ("all", each.kind)]
            if not active and which != "all":
                raise RefusedError("no fault is active")
            if active and not numbers:
                hint = did_you_mean(which, sorted({each.kind for each in active}))
                raise RefusedError(f"no fault {shown(which)} is active; {hint}")
        for number in [0] if which == "all" else numbers:
            self._ask("clear_fault", srv.ClearFault.Request(number=number))
        self.until(
            lambda: not any(each.active and each.number in numbers for each in self.faults),
            what="the topic faults did not show the end",
        )
        return numbers

    def list_faults(self) -> srv.ListFaults.Response:
        """Return the active faults, and the kinds and channels that can be injected now."""
        return self._call("list_faults", srv.ListFaults.Request(), repeat=True)

    # Simulation time: a call returns when the topic ``status`` shows the change.

    def pause(self) -> None:
        """Let simulation time stand still; a step that is under way is interrupted."""
        self._set_state(msg.SimulationState.STATE_PAUSED, Status.STATE_PAUSED)

    def play(self) -> None:
        """Let simulation time pass by itself."""
        self._set_state(msg.SimulationState.STATE_PLAYING, Status.STATE_RUNNING)

    def step(self, seconds: float) -> float:
        """Advance a paused drill, and return the stamp that it reached [s].

        Its status and all messages of that time that have arrived are taken before this returns.
        """
        request = srv.StepSimulation.Request(duration=_time(Duration, "step", seconds))
        return self._advance("simulation/step", request)

    def run_to(self, stamp: float) -> float:
        """Advance a paused drill to a stamp [s], and return the stamp that it reached [s]."""
        request = srv.RunToTime.Request(time=_time(Time, "time", stamp))
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
        request = srv.ResetSimulation.Request(scope=bits)
        if seed is not None:
            request.reseed, request.seed = True, int(_SEED.check("seed", seed))
        self._ask("simulation/reset", request)
        # The drill published the status before it answered; they have no common order here.
        delivery = self.delivery()
        number = dict(zip(delivery.topics, delivery.published, strict=True))["status"]
        self.until(lambda: self.status_number >= number, what="no status showed the reset")
        self.take()

    def _set_state(self, state: int, name: str) -> None:
        request = srv.SetSimulationState.Request(state=msg.SimulationState(state=state))
        self._ask("simulation/set_state", request, repeat=True)
        states = (name, Status.STATE_INACTIVE)  # which says nothing about its time
        self.until(lambda: self.status.state in states, what=f"no status said {name}")

    def _advance(self, name: str, request: Any) -> float:
        response = self._ask(name, request)
        self._published = dict(zip(response.topics, response.published, strict=True))
        reached = join_seconds(response.time.sec, response.time.nanosec)
        self.until(
            lambda: _stamp_of(self.status) >= reached, what="no status showed the end of the step"
        )
        self.take()
        return reached / SECOND

    def _ask(self, name: str, request: Any, repeat: bool = False) -> Any:
        """Call a service and return its response, or raise the drill's reason not to do it."""
        response = self._call(name, request, repeat)
        result = getattr(response, "result", response)
        if isinstance(result, msg.Result):
            if result.result not in (result.RESULT_OK, _ALREADY):
                raise RefusedError(result.error_message, result.result)
        elif isinstance(result, SetParametersResult):
            if not result.successful:
                raise RefusedError(result.reason)
        elif not result.success:
            raise RefusedError(result.message)
        return response


# Arguments as fields of messages; the drill itself checks their ranges.


def _number(name: str, value: Any) -> float:
    try:
        return float(value)
    except (TypeError, ValueError, OverflowError):
        raise ParameterError(f"{name} = {shown(value)} is not a number") from None


def _time(kind: Any, name: str, seconds: Any) -> Any:
    """Return seconds as a message of whole ones and the nanoseconds of the rest."""
    total = min(round(SECONDS.check(name, seconds) * SECOND), 2**31 * SECOND - 1)
    sec, nanosec = split_seconds(total)
    return kind(sec=sec, nanosec=nanosec)


def _stamp_of(status: Status) -> int:
    """Return the stamp of a status [ns]."""
    return join_seconds(status.header.stamp.sec, status.header.stamp.nanosec)
