"""Every way into the drill, and a hostile input for each."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Collection, Mapping
from typing import Any

from builtin_interfaces.msg import Time
from rcl_interfaces.msg import ParameterType
from rpud_msgs.msg import Drive, Result, SimulationState, WeightOnBit

from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.ros.drill.managed_node import declare_settings
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
)
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.topics import CHANNELS
from tools.fuzz import hostile
from tools.fuzz.drill import Drill

NUMBERS = {
    name: declaration.allowed
    for name, declaration in PARAMETERS.items()
    if isinstance(declaration.allowed, Quantity)
}

SECOND = 1_000_000_000
LONGEST_STEP = 1_000_000 * SECOND  # that the drill takes; a fuzz that waits for one never ends
ROS_NAMES = ("use_sim_time", "start_type_description_service")
KNOWN: Mapping[str, Collection[Any]] = {  # values of fields, by their names
    "kind": KINDS,
    "channel": (*[""] * len(CHANNELS), *CHANNELS, "waveform"),
    "name": (*CHANGEABLE * 2, *PARAMETERS, *ROS_NAMES),
    **dict.fromkeys(("names", "nodes", "prefixes"), tuple(PARAMETERS)),
    "type": (*range(10), *[ParameterType.PARAMETER_DOUBLE] * 9, 200),
    # Those that an active drill has would end it, rightly.
    "id": (0, 1, 2, 3, *range(8, 256)),
    "label": ("configure", "activate", "cleanup", "", *hostile.WORDS),
    "state": {*range(256)} - {SimulationState.STATE_QUITTING},
}

Reason = str | None  # why it was refused, None where it was accepted
Send = Callable[[random.Random, Drill], Reason]


class NotAnsweredError(AssertionError):
    """A refusal without a reason, or without a count."""


def _command(kind: Callable[[], Any], topic: str) -> Send:
    def send(random: random.Random, drill: Drill) -> Reason:
        message = hostile.fill(random, kind(), KNOWN)
        if random.random() < 0.5:
            message.header.stamp = Time()
        rejected = drill.rejected
        drill.reasons.clear()
        drill.command(topic, message)
        counted = drill.rejected - rejected
        if counted != len(drill.reasons) or counted > 1:
            raise NotAnsweredError(f"counted {counted} with the reasons {drill.reasons}")
        return drill.reasons[0] if counted else None

    return send


def _service(name: str, refusal: Callable[[Any], Reason], /, **known: Collection[Any]) -> Send:
    """Call a service with values of all its fields; ``known`` has other ones than ``KNOWN``."""

    def send(random: random.Random, drill: Drill) -> Reason:
        request = drill.services[name].srv_type.Request()
        hostile.fill(random, request, {**KNOWN, **known})
        for parameter in getattr(request, "parameters", ()):
            if parameter.name in NUMBERS and random.random() < 0.3:  # at the very end of its range
                quantity = NUMBERS[parameter.name]
                end = random.choice((quantity.minimum, quantity.maximum))
                beyond = math.nextafter(end, random.choice((-1, 1)) * 1e99)
                parameter.value.type = ParameterType.PARAMETER_DOUBLE
                parameter.value.double_value = random.choice((end, beyond))
        before = drill.requests_refused
        reason = refusal(drill.call(name, request))
        counted = drill.requests_refused > before or reason == "it is in that state already"
        if reason is not None and not counted:
            raise NotAnsweredError(f"refused, {reason}, but not counted")
        return reason

    return send


def _step(name: str, field: str) -> Send:
    """A step of a drill that is paused; but for those that would rightly take for ever."""

    def send(random: random.Random, drill: Drill) -> Reason:
        request = drill.services[name].srv_type.Request()
        drawn = getattr(request, field)
        while True:
            drawn.sec = random.choice((0, hostile.whole(random, 32, signed=True)))
            drawn.nanosec = random.choice((1, 1_000_000, hostile.whole(random, 32)))
            length = drawn.sec * SECOND + drawn.nanosec
            if field == "time":
                length -= drill.now()
            if not SECOND // 100 < length <= LONGEST_STEP:
                break
        if random.random() < 0.5:  # it plays, and refuses
            return _of_result(drill.call(name, request))
        with drill.paused():
            before = drill.state()
            reason = _of_result(drill.call(name, request))
            if reason is not None and drill.state() != before:
                raise NotAnsweredError(f"refused, {reason}, but the state has changed")
        return reason

    return send


def _of_result(response: Any) -> Reason:
    result = response.result
    return None if result.result == Result.RESULT_OK else result.error_message


def _of_success(response: Any) -> Reason:
    return None if response.success else response.message


def _of_transition(response: Any) -> Reason:
    return None if response.success else "the state machine has no such transition"


def _of_parameters(response: Any) -> Reason:
    refused = [result.reason for result in response.results if not result.successful]
    accepted = len(refused) < len(response.results) or not response.results
    return None if accepted else " and ".join(refused)


def _of_parameters_at_once(response: Any) -> Reason:
    return None if response.result.successful else response.result.reason


def _answered(response: Any) -> Reason:
    return None


def _node(random: random.Random, drill: Drill) -> Reason:
    """Another node, with overrides of the types that rcl knows."""
    values = {
        random.choice(tuple(PARAMETERS)): random.choice(
            (
                hostile.number(random),
                hostile.whole(random, 63),
                random.random() < 0.5,
                hostile.text(random, surrogates=False).replace("\0", ""),
                [hostile.number(random)],
                [hostile.text(random, surrogates=False).replace("\0", "")],
                [True],
            )
        )
    }
    node = drill.create_node(values)
    try:
        with drill.paused():
            declare_settings(node)
    except ParameterError as error:
        return str(error)
    finally:
        node.destroy_node()
    return None


WAYS: Mapping[str, Send] = {
    "command/weight_on_bit": _command(WeightOnBit, "command/weight_on_bit"),
    "command/drive": _command(Drive, "command/drive"),
    "set_parameters": _service("set_parameters", _of_parameters),
    "set_parameters_atomically": _service("set_parameters_atomically", _of_parameters_at_once),
    "get_parameters": _service("get_parameters", _answered),
    "get_parameter_types": _service("get_parameter_types", _answered),
    "describe_parameters": _service("describe_parameters", _answered),
    "list_parameters": _service("list_parameters", _answered),
    "change_state": _service("change_state", _of_transition),
    "engage": _service("engage", _of_success),
    "inject_fault": _service("inject_fault", _of_success),
    "clear_fault": _service("clear_fault", _of_success),
    "list_faults": _service("list_faults", _answered),
    "simulation/get_state": _service("simulation/get_state", _of_result),
    "simulation/get_delivery": _service("simulation/get_delivery", _answered),
    "simulation/set_state": _service("simulation/set_state", _of_result),
    "simulation/step": _step("simulation/step", "duration"),
    "simulation/run_to": _step("simulation/run_to", "time"),
    "simulation/reset": _service("simulation/reset", _of_result),
    "get_journal": _service("~/get_journal", _answered),
    "node": _node,
}
# Their share of the turns: these take milliseconds, and rclpy never frees all that a node took.
RARE = {"node": 0.005, "simulation/reset": 0.2}
