"""Attack on a real drill: its callbacks get hostile messages, as the executor would give them.

A refusal has a reason of one line, is counted, and changes nothing; nothing ends the drilling.
"""

from __future__ import annotations

import contextlib
import ctypes
import gc
import math
import random
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

import rclpy
from rcl_interfaces.msg import ParameterType
from rclpy.logging import LoggingSeverity, get_logger
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from rpud_msgs.msg import Result, SimulationState

from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.drill_node import DrillNode
from rpud_sim.ros.drill.managed_node import declare_settings
from rpud_sim.simulation.configuration import CHANGEABLE, PARAMETERS
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.topics import CHANNELS, COMMAND_TOPICS
from tools.fuzz import Outcome, hostile

LONGEST_REASON = 20_000  # rclpy repeats the names that it does not know
MOST_GROWTH = 10_000_000  # of memory in the second half of the inputs; the journal grows [byte]
OPTIONS = {
    "rock_model": "specific_energy",  # so that every fault is possible
    "actuator_model": "resonance",
    "command_timeout": 3600.0,  # so that stamps are looked at
    "telemetry_rate": 500,  # each input waits for the end of a block
}
KNOWN = {  # values of fields, by their names
    "kind": KINDS,
    "channel": (*[""] * 3 * len(CHANNELS), *CHANNELS, "waveform"),
    "name": (*CHANGEABLE * 2, *PARAMETERS, "use_sim_time", "start_type_description_service"),
    **dict.fromkeys(("names", "nodes", "prefixes"), tuple(PARAMETERS)),
    "type": (*range(10), *[ParameterType.PARAMETER_DOUBLE] * 9, 200),
    "id": (0, 1, 2, 3, *range(8, 256)),  # those that an active drill has would end it, rightly
    "label": ("configure", "activate", "cleanup", "", *hostile.WORDS),
    "state": (*(0, 1, 2) * 80, *{*range(256)} - {SimulationState.STATE_QUITTING}),
    "magnitude": (*(0.0, 0.5) * 30, *hostile.NUMBERS),
    "sec": (0, 0, 0, -1, 2**31 - 1, -(2**31)),  # the drill would take a long step, and never end
    "entries_from": (0,),  # its page grows with the journal
}
RARE = {"node": 0.005, "simulation/reset": 0.2}  # they take milliseconds; rclpy frees no node


_MOST_OF_A_BLOCK = 512  # of Python's own allocator [byte]


class _Allocator(ctypes.Structure):
    """What ``mallinfo2`` of the C library returns [byte]."""

    _fields_ = [
        (name, ctypes.c_size_t)
        for name in (
            *("arena", "ordblks", "smblks", "hblks", "hblkhd"),
            *("usmblks", "fsmblks", "uordblks", "fordblks", "keepcost"),
        )
    ]


class Drill:
    """Drill that plays in real time while it is attacked from another thread."""

    def __init__(self) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context)
        self.node = self.create_node(DrillNode, OPTIONS)
        for logger in (self.node.get_logger(), get_logger("rcl_lifecycle"), get_logger("rcl")):
            logger.set_level(LoggingSeverity.FATAL)  # thousands of reasons
        self.reasons: list[str] = []  # of refused commands
        self.inbox = self.node._inbox
        refuse = self.inbox.refuse
        self.inbox.refuse = lambda result, reason: (
            self.reasons.append(reason),
            refuse(result, reason),
        )
        sys.setswitchinterval(1e-4)  # the attack must not keep the drill from its turn
        self.node.start()
        self.services = {
            each.srv_name.rsplit("drill_node/")[-1].removeprefix("/"): each
            for each in self.node.services
            if not each.srv_name.endswith("get_type_description")  # rclpy's own
        }
        named = {each.topic_name.removeprefix("/"): each for each in self.node.subscriptions}
        self.commands = {name: named[name] for name in COMMAND_TOPICS if name in named}
        self.ways = [*self.commands, *self.services, "node"]
        self._parameters = self.parameters()

    def create_node(self, kind: Any, overrides: dict[str, Any]) -> Any:
        """Make a node, as a launch with these parameters would."""
        given = [Parameter(name, value=value) for name, value in overrides.items()]
        name = ("another",) if kind is Node else ()
        return kind(*name, context=self._context, parameter_overrides=given)

    def close(self) -> None:
        """End the drill."""
        self.node.stop()
        self.node.destroy_node()
        rclpy.shutdown(context=self._context)
        sys.setswitchinterval(0.005)

    def call(self, name: str, request: Any = None, **fields: Any) -> Any:
        """Call a service, as if the request had come over DDS."""
        kind = self.services[name].srv_type
        return self.services[name].callback(request or kind.Request(**fields), kind.Response())

    def parameters(self) -> dict[str, Any]:
        """All parameters."""
        return {k: each.value for k, each in self.node.get_parameters_by_prefix("").items()}

    def state(self) -> str:
        """All that a refused input must leave as it is."""
        journal = self.call("~/get_journal", first=2**64 - 1).count  # of all changes
        state = self.call("simulation/get_state").state.state
        return f"{sorted(self.parameters().items())} {journal} {state}"

    def set_state(self, state: int) -> None:
        """Play or pause."""
        self.call("simulation/set_state", state=SimulationState(state=state))

    @contextlib.contextmanager
    def paused(self) -> Iterator[None]:
        """Let its time stand still, for what no drill does while it plays."""
        self.set_state(SimulationState.STATE_PAUSED)
        try:
            yield
        finally:
            self.set_state(SimulationState.STATE_PLAYING)

    def restore(self) -> list[str]:
        """Take back what was accepted, so that every input meets the same drill.

        Return why something of it could not be taken back.
        """
        now = self.parameters()
        changed = {k: v for k, v in self._parameters.items() if repr(now.get(k)) != repr(v)}
        given = [Parameter(name, value=value) for name, value in changed.items()]
        results = [self.node.set_parameters_atomically(given)]
        self.node.loop.request(lambda live: live.act())
        results += [self.call("simulation/reset")]
        self.set_state(SimulationState.STATE_PLAYING)
        reasons = [reason_of(each) for each in results]
        return [f"cannot be taken back: {reason}" for reason in reasons if reason is not None]

    def held(self) -> int:
        """Memory that is in use at the start of a run [byte].

        While it plays, a drill holds all segments of the last second. The allocator may keep their
        pages, where something small between them is in use: these do not count.
        """
        self.restore()
        gc.collect()
        allocator = ctypes.CDLL(None).mallinfo2
        allocator.restype = _Allocator
        native = allocator()
        return native.uordblks + native.hblkhd + _MOST_OF_A_BLOCK * sys.getallocatedblocks()

    def send(self, drawn: random.Random, way: str) -> str | None:
        """Send one hostile input; return why it was refused, None if it was accepted."""
        if way == "node":
            return self._declare(drawn)
        if way in self.commands:
            return self._command(drawn, way)
        request = hostile.fill(drawn, self.services[way].srv_type.Request(), KNOWN)
        for each in getattr(request, "parameters", ()):
            allowed = getattr(PARAMETERS.get(each.name), "allowed", None)
            if isinstance(allowed, Quantity) and drawn.random() < 0.3:  # the very end of its range
                end = drawn.choice((allowed.minimum, allowed.maximum))
                beyond = math.nextafter(end, drawn.choice((-1, 1)) * 1e99)
                each.value.type = ParameterType.PARAMETER_DOUBLE
                each.value.double_value = drawn.choice((end, beyond))
        if way == "simulation/run_to" and drawn.random() < 0.3:  # soon
            now = self.node.loop.request(lambda live: live.stamp)
            request.time.sec, request.time.nanosec = divmod(now + SECOND // 200, SECOND)
        waits = way in ("simulation/step", "simulation/run_to") and drawn.random() < 0.5
        with self.paused() if waits else contextlib.nullcontext():
            refused, before = self.inbox.requests_refused, self.state() if waits else ""
            reason = reason_of(self.call(way, request))
            counted = self.inbox.requests_refused > refused
            if waits and reason is not None:
                assert self.state() == before, f"refused, {reason}, but changed"
        known = reason in (None, "it is in that state already")
        assert known or counted, f"refused, {reason}, but not counted"
        return reason

    def _command(self, drawn: random.Random, topic: str) -> str | None:
        subscription = self.commands[topic]
        message = hostile.fill(drawn, subscription.msg_type(), KNOWN)
        if drawn.random() < 0.5:
            message.header.stamp = type(message.header.stamp)()
        rejected = self.inbox.rejected
        self.reasons.clear()
        info = {"received_timestamp": time.time_ns(), "publication_sequence_number": None}
        subscription.callback(serialize_message(message), info)
        self.node.loop.request(lambda live: live.act())  # where commands are checked
        counted = self.inbox.rejected - rejected
        assert counted == len(self.reasons) <= 1, f"counted {counted}, said {self.reasons}"
        return self.reasons[0] if counted else None

    def _declare(self, drawn: random.Random) -> str | None:
        """Start another node, with overrides of the types that rcl knows."""
        text = hostile.text(drawn).replace("\0", "")
        number, whole = hostile.number(drawn), hostile.whole(drawn, 63)
        value = drawn.choice((number, whole, whole < 5, text, [number], [text], [True]))
        node = self.create_node(Node, {drawn.choice(tuple(PARAMETERS)): value})
        try:
            with self.paused():
                declare_settings(node)
        except ParameterError as error:
            return str(error)
        finally:
            node.destroy_node()
        return None


def reason_of(response: Any) -> str | None:
    """Return why a request was refused, whatever form the response has; None if it was not."""
    result = getattr(response, "result", response)
    if hasattr(result, "error_message"):
        return None if result.result == Result.RESULT_OK else result.error_message
    if hasattr(result, "successful"):
        return None if result.successful else result.reason
    if hasattr(response, "success"):
        unnamed = "the state machine has no such transition"
        return None if response.success else getattr(response, "message", unnamed)
    refused = [each.reason for each in getattr(response, "results", ()) if not each.successful]
    return " and ".join(refused) if refused and len(refused) == len(response.results) else None


def run(numbers: Sequence[int], seed: int) -> Iterator[Outcome]:
    """Send inputs, each drawn from the seed and its number, and check what follows from each."""
    drill, warm = Drill(), 0
    weights = [RARE.get(way, 1.0) for way in drill.ways]
    before = drill.state()
    for number in numbers:
        drawn = random.Random(f"{seed}:{number}")
        way = drawn.choices(drill.ways, weights)[0]
        way = drill.ways[number] if number < len(drill.ways) else way
        harms, reason, began = [], None, time.perf_counter()
        try:
            reason = drill.send(drawn, way)
        except Exception as error:
            harms.append(f"{type(error).__name__}: {error}"[:500])
        seconds = time.perf_counter() - began
        after = drill.state()
        if reason is None and after != before:
            harms += drill.restore()
            after = drill.state()
        elif reason is not None:
            if not reason.strip() or "\n" in reason or len(reason) > LONGEST_REASON:
                harms.append(f"the reason is not one line: {reason[:500]!r}")
            if after != before:
                harms.append(f"refused, {reason}, but the state has changed")
        before = after
        if drill.node.loop.failure is not None:
            harms.append(f"the drilling has ended: {drill.node.loop.failure}")
        if number == len(numbers) // 2 - 1:
            warm = drill.held()  # what is used the first time takes memory once
            before = drill.state()
        if number == len(numbers) - 1 and warm and (grown := drill.held() - warm) > MOST_GROWTH:
            harms.append(f"memory has grown by {grown / 1e6:.1f} MB")
        yield Outcome(number, way, reason is not None, seconds, harms)
    drill.close()
