"""Client of one running drill."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from typing import Any

from builtin_interfaces.msg import Duration, Time
from rcl_interfaces.srv import SetParametersAtomically
from rclpy.qos import QoSProfile
from rpud_msgs import msg, srv
from rpud_msgs.msg import Fault, Feed, Status
from std_srvs.srv import SetBool

from rpud_sim.foundation.options import NAMESPACE, SEED_OR_NONE
from rpud_sim.foundation.quantities import (
    Flag,
    ParameterError,
    Quantity,
    Text,
    did_you_mean,
    short_repr,
)
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.foundation.verbs import DeclaredAttributes, verb
from rpud_sim.ros.client.arguments import to_number, to_parameter, to_time
from rpud_sim.ros.client.latest_messages import FOLLOWED, LatestMessages
from rpud_sim.ros.client.listening_node import (
    PATIENCE,
    CommandSender,
    ListeningNode,
    NoAnswerError,
    NoDrillError,
    RefusedError,
    ServiceCaller,
    Value,
    drill_nodes,
    no_drill,
)
from rpud_sim.ros.client.topics import FastTopics, listen
from rpud_sim.ros.received import ReceivedTopic
from rpud_sim.simulation.faults import Fault as CheckedFault
from rpud_sim.simulation.scenario_file import DURATION as FAULT_DURATION

# What a reset may restart, by name.
SCOPES: Mapping[str, int] = {
    "all": srv.ResetSimulation.Request.SCOPE_ALL,
    "time": srv.ResetSimulation.Request.SCOPE_TIME,
    "state": srv.ResetSimulation.Request.SCOPE_STATE,
    "faults": srv.ResetSimulation.Request.SCOPE_SPAWNED,
}
_TINY = 1e-300  # magnitude with the effect of zero, which in a message means the default
_DELIVERY = 1.0  # that the messages of a step may take to arrive [s]
_STATUS_PERIOD = 2.5  # in which every living drill publishes a status, at any load [s]
_ON = Flag("whether something is on")
_FAULT_KIND = Text("kind of a fault", "a kind of fault")
_CHANNEL = Text("topic of a faulty signal", "a topic")
_FAULT_NUMBER = Quantity("", "the number of a fault", 1, 2**32 - 1, whole=True)


class DrillClient(DeclaredAttributes, ListeningNode):
    """Client that commands one running drill, and has its messages.

    ::

        with DrillClient() as drill:
            drill.pause()
            drill.press(30.0)
            drill.step(0.5)
            print(drill.status.impacts)

    A command returns when the drill has accepted it; a rejection is a ``RefusedError`` with the
    drill's reason. Messages are taken while a method waits: use it from one thread.
    ``patience`` is in s.
    """

    # messages that the drill had published on each topic when the last step ended
    published: Mapping[str, int]

    def __init__(
        self,
        namespace: str = NAMESPACE,
        domain_id: int | None = None,
        node_name: str = "drill_client",
        patience: float = PATIENCE,
    ) -> None:
        super().__init__(node_name, namespace, domain_id, patience)
        self._found = False
        self._listened: list[ReceivedTopic] = []
        self.published = {}
        self._latest = LatestMessages(self, lambda results: self._commands.take(results))
        self._latest.follow(FOLLOWED)
        self._services = ServiceCaller(self, lambda: self.status_number)
        self._commands = CommandSender(self, self._services, lambda: self.status_number)

    # What the drill is and reports.

    @property
    def namespace(self) -> str:
        """Namespace of the drill."""
        return str(self.node.get_namespace())

    @property
    def publishers(self) -> list[str]:
        """Full names of the nodes that publish the drill's status; no node, no drill."""
        return drill_nodes(self.node)

    @property
    def status(self) -> Status:
        """Latest status of the drill, a ``rpud_msgs/Status``."""
        self.found()
        return self._latest["status"]

    @property
    def status_number(self) -> int:
        """Number that the drill's publisher has given to the latest status; 0 before the first."""
        return self._latest.status_number

    @property
    def faults(self) -> list[Fault]:
        """Faults since the start, those that last and those that are over, by number."""
        self.until(lambda: "faults" in self._latest, what="no list of faults came")
        return list(self._latest["faults"].faults)

    @property
    def time(self) -> float:
        """Stamp of the latest status [s]."""
        stamp = self.status.header.stamp
        return join_seconds(stamp.sec, stamp.nanosec) / SECOND

    def delivery(self, nodes: Sequence[str] = ()) -> srv.GetDelivery.Response:
        """Return what the drill has published, who has discovered it, and which nodes answered."""
        return self._ask("simulation/get_delivery", srv.GetDelivery.Request(nodes=nodes), True)

    # Waiting and listening.

    def found(self, patience: float | None = None) -> None:
        """Wait until the drill is found and has published its status; ``patience`` is in s."""
        if self._found:
            return
        patience = self.patience if patience is None else float(patience)
        try:
            self._services.wait_until_discovered(patience)
        except NoAnswerError:
            raise NoDrillError(
                no_drill(self.node, self.namespace, self.domain_id, patience)
            ) from None
        try:
            self.wait_until(lambda: "status" in self._latest, "", patience)
        except NoAnswerError:
            raise NoDrillError(
                f"the drill in {self.namespace} published no status within {patience:g} s: it is "
                "still starting, or waits for the transition configure"
            ) from None
        self._check_alone()
        self._found = True

    def until(
        self,
        condition: Callable[[], Value],
        patience: float | None = None,
        what: str = "the condition did not hold",
    ) -> Value:
        """Take messages until a condition holds, and return its value; ``patience`` is in s.

        ``what`` is a sentence for the error, without the limit.
        """
        self.found()
        return self.wait_until(condition, what, patience)

    def listen(
        self,
        topic: str,
        kind: Any = None,
        qos: QoSProfile | None = None,
        patience: float | None = None,
    ) -> list[Any]:
        """Subscribe to a topic of any node, and return the list that its messages are added to.

        Without ``kind`` and ``qos`` the publishers decide. ``patience`` is in s.
        """
        self.found()
        messages: list[Any] = []
        listened = listen(self, topic, messages, kind, qos, patience)
        self._services.wait_until_discovered()
        self._listened.append(listened)
        return messages

    def observe(self, observer: Callable[[str, Any, int], object], *topics: str) -> None:
        """Call a function with topic, message and publishing time [ns] of the drill's topics.

        Without any they are status, faults, journal and command_results.
        """
        self._latest.follow(topics or FOLLOWED, observer)

    def telemetry(self, topics: Iterable[str]) -> FastTopics:
        """Subscribe to fast topics: see ``FastTopics``."""
        return FastTopics(self, topics)

    # Commands: each returns when the drill has accepted it.

    @verb
    def press(self, force: float) -> None:
        self._command("weight_on_bit", msg.WeightOnBit(force=to_number("force", force)))

    @verb
    def drive(
        self, enabled: bool = True, voltage: float | None = None, frequency: float | None = None
    ) -> None:
        status = self.status
        present = (status.drive_voltage, status.drive_frequency) if enabled else (0.0, 0.0)
        message = msg.Drive(
            enabled=_ON.check("drive enabled", enabled),
            voltage=present[0] if voltage is None else to_number("voltage", voltage),
            frequency=present[1] if frequency is None else to_number("frequency", frequency),
        )
        self._command("drive", message)

    @verb
    def feed(self, rate: float | None = None, position: float | None = None) -> None:
        if (rate is None) == (position is None):
            raise ParameterError("feed takes a rate or a position")
        if rate is not None:
            message = Feed(mode=Feed.MODE_RATE, rate=to_number("rate", rate))
        else:
            message = Feed(mode=Feed.MODE_POSITION, position=to_number("position", position))
        self._command("feed", message)

    @verb
    def move(self, position: float, velocity: float = 0.0) -> None:
        place, rate = to_number("position", position), to_number("velocity", velocity)
        self._command("mount", msg.MountMotion(position=place, velocity=rate))

    @verb
    def engage(self, on: bool = True) -> None:
        self._ask("engage", SetBool.Request(data=_ON.check("engage", on)), repeat=True)
        regime = Status.REGIME_DRILLING if on else Status.REGIME_FREE
        self.until(lambda: self.status.regime == regime, what=f"no status reported {regime}")

    def set_parameters(self, **values: Any) -> None:
        """Set parameters of the drill, all of them or none."""
        self._set_parameters(self._drill_node(), values)

    def _set_parameters(self, node: str, values: Mapping[str, Any]) -> None:
        parameters = [to_parameter(*each).to_parameter_msg() for each in values.items()]
        request = SetParametersAtomically.Request(parameters=parameters)
        name = f"{node}/set_parameters_atomically"
        self._services.add(SetParametersAtomically, name)
        self._ask(name, request, repeat=True)

    def journal(self, first: int) -> list[msg.JournalEntry]:
        """Return a page of the drill's journal, from an entry on; none after the last."""
        name = f"{self._drill_node()}/get_journal"
        self._services.add(srv.GetJournal, name)
        entries = self._ask(name, srv.GetJournal.Request(first=first), repeat=True).entries
        return list(entries)

    # Faults: a call returns when the topic ``faults`` shows the change.

    @verb
    def inject(
        self,
        kind: str,
        channel: str = "",
        magnitude: float | None = None,
        duration: float | None = None,
    ) -> int:
        size = math.nan if magnitude is None else to_number("magnitude", magnitude)
        if size == 0.0 and CheckedFault(kind, channel, size).declared.magnitude:
            size = _TINY
        fault = Fault(
            kind=_FAULT_KIND.check("kind", kind),
            channel=_CHANNEL.check("channel", channel),
            magnitude=size,
        )
        length = 0.0 if duration is None else FAULT_DURATION.check("duration", duration)
        lasting = to_time(Duration, "duration", length)
        request = srv.InjectFault.Request(fault=fault, duration=lasting)
        number = int(self._ask("inject_fault", request).number)
        self.until(
            lambda: any(each.number == number for each in self.faults),
            what=f"the topic faults did not show fault {number}",
        )
        return number

    @verb
    def clear(self, which: int | str = "all") -> list[int]:
        if not isinstance(which, str):
            numbers = [int(_FAULT_NUMBER.check("fault", which))]
        else:
            active = self.list_faults().faults
            numbers = [int(each.number) for each in active if which in ("all", each.kind)]
            if not active and which != "all":
                raise RefusedError("no fault is active")
            if active and not numbers:
                hint = did_you_mean(which, sorted({each.kind for each in active}))
                raise RefusedError(f"no fault {short_repr(which)} is active{hint}")
        for number in [0] if which == "all" else numbers:
            self._ask("clear_fault", srv.ClearFault.Request(number=number))
        self.until(
            lambda: not any(each.active and each.number in numbers for each in self.faults),
            what="the topic faults did not show the end",
        )
        return numbers

    def list_faults(self) -> srv.ListFaults.Response:
        """Return the active faults, and the kinds and channels that can be injected now."""
        return self._ask("list_faults", srv.ListFaults.Request(), repeat=True)

    # Simulation time: a call returns when the topic ``status`` shows the change.

    @verb
    def pause(self) -> None:
        self._set_state(msg.SimulationState.STATE_PAUSED, Status.STATE_PAUSED)

    @verb
    def play(self) -> None:
        self._set_state(msg.SimulationState.STATE_PLAYING, Status.STATE_RUNNING)

    @verb
    def step(self, seconds: float) -> float:
        request = srv.StepSimulation.Request(duration=to_time(Duration, "step", seconds))
        return _reached(self._advance("simulation/step", request))

    def run_to(self, stamp: float) -> float:
        """Advance a paused drill to a stamp [s], and return the stamp that it reached [s]."""
        request = srv.RunToTime.Request(time=to_time(Time, "time", stamp))
        return _reached(self._advance("simulation/run_to", request))

    @verb
    def reset(self, scope: str | int = "all", seed: int | None = None) -> None:
        if isinstance(scope, str) and scope not in SCOPES:
            raise ParameterError(
                f"scope = {short_repr(scope)} is unknown{did_you_mean(scope, SCOPES)}"
            )
        bits = SCOPES[scope] if isinstance(scope, str) else int(scope)
        request = srv.ResetSimulation.Request(scope=bits)
        if seed is not None:
            request.reseed, request.seed = True, int(SEED_OR_NONE.check("seed", seed))
        self._ask("simulation/reset", request)
        # The drill published the status before it answered; they have no common order here.
        delivery = self.delivery()
        number = dict(zip(delivery.topics, delivery.published, strict=True))["status"]
        self.until(lambda: self.status_number >= number, what="no status showed the reset")
        self.take()

    def _drill_node(self) -> str:
        """Return the full name of the drill's node, which a remap may have changed."""
        nodes = self.until(
            lambda: list(filter(None, self.publishers)),
            what="the name of the drill's node was not discovered",
        )
        return nodes[0]

    def _set_state(self, state: int, name: str) -> None:
        request = srv.SetSimulationState.Request(state=msg.SimulationState(state=state))
        self._ask("simulation/set_state", request, repeat=True)
        states = (name, Status.STATE_INACTIVE)  # which does not depend on its time
        self.until(lambda: self.status.state in states, what=f"no status reported {name}")

    def _advance(self, name: str, request: Any) -> Any:
        """Call a service that advances the drill, and return its response, whose status counts."""
        response = self._ask(name, request)
        self.published = dict(zip(response.topics, response.published, strict=True))
        self._latest.show(self.published["status"], response.status)
        if self._listened:
            self._await_listened()
        self.take()
        return response

    def _await_listened(self) -> None:
        """Wait until the lists of ``listen`` have what the drill has published."""
        expected = {self.node.resolve_topic_name(n): count for n, count in self.published.items()}
        with suppress(NoAnswerError):  # a best-effort subscription may have lost the last ones
            self.wait_until(
                lambda: all((e.number or 0) >= expected.get(e.name, 0) for e in self._listened),
                "",
                min(self.patience, _DELIVERY),
            )

    def _ask(self, name: str, request: Any, repeat: bool = False) -> Any:
        self.found()
        return self._services.call(name, request, repeat)

    def _command(self, name: str, message: Any) -> None:
        self.found()
        self._commands.send(name, message)

    def _check_alone(self) -> None:
        """Check that one drill alone is there; one that was killed counts for nothing."""

        def is_alone() -> bool:
            names = self.publishers
            # The middleware remembers a killed drill for 20 s. Only numbers of living ones grow.
            if len(names) > 1 and self._latest.numbers_fall:
                raise NoDrillError(
                    f"{len(names)} nodes publish {self.node.resolve_topic_name('status')} "
                    f"({', '.join(filter(None, names))}): all of them would answer; start each "
                    "drill in a namespace of its own"
                )
            return len(names) <= 1

        with suppress(NoAnswerError):
            self.wait_until(is_alone, "", _STATUS_PERIOD)


def _reached(response: Any) -> float:
    return join_seconds(response.time.sec, response.time.nanosec) / SECOND
