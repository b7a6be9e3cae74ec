"""Every way into the drill, and a hostile input for each."""

from __future__ import annotations

import math
import random
from collections.abc import Callable, Mapping
from typing import Any

from builtin_interfaces.msg import Duration, Time
from lifecycle_msgs.msg import Transition
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.msg import ParameterType, ParameterValue
from rpud_msgs.msg import Drive, Fault, Result, SimulationState, WeightOnBit

from fuzz import hostile
from fuzz.drill import Drill
from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.ros.drill.managed_node import declare_settings
from rpud_sim.simulation.configuration import (
    CHANGEABLE,
    PARAMETERS,
)
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.topics import CHANNELS

NUMBERS = {
    name: declaration.allowed
    for name, declaration in PARAMETERS.items()
    if isinstance(declaration.allowed, Quantity)
}

SECOND = 1_000_000_000
LONGEST_STEP = 1_000_000 * SECOND  # that the drill takes; a fuzz that waits for one never ends
ROS_NAMES = ("use_sim_time", "start_type_description_service")
# Those that an active drill has would end it, rightly.
IMPOSSIBLE_TRANSITIONS = (0, 1, 2, 3, *range(8, 256))

Reason = str | None  # why it was refused, None where it was accepted
Send = Callable[[random.Random, Drill], Reason]


class NotAnsweredError(AssertionError):
    """A refusal without a reason, or without a count."""


def _command(make: Callable[[random.Random], Any], topic: str) -> Send:
    def send(random: random.Random, drill: Drill) -> Reason:
        message = make(random)
        message.header.stamp = _stamp(random) if random.random() < 0.5 else Time()
        message.header.frame_id = hostile.text(random, surrogates=False)
        rejected = drill.rejected
        drill.reasons.clear()
        drill.command(topic, message)
        counted = drill.rejected - rejected
        if counted != len(drill.reasons) or counted > 1:
            raise NotAnsweredError(f"counted {counted} with the reasons {drill.reasons}")
        return drill.reasons[0] if counted else None

    return send


def _weight_on_bit(random: random.Random) -> WeightOnBit:
    return WeightOnBit(force=hostile.number(random))


def _drive(random: random.Random) -> Drive:
    voltage, frequency = hostile.number(random), hostile.number(random)
    return Drive(enabled=random.random() < 0.8, voltage=voltage, frequency=frequency)


def _stamp(random: random.Random) -> Time:
    return Time(sec=hostile.whole(random, 32, signed=True), nanosec=hostile.whole(random, 32))


def _service(name: str, refusal: Callable[[Any], Reason], /, **fields: Any) -> Send:
    """Call a service; each field is drawn by a function of its own."""

    def send(random: random.Random, drill: Drill) -> Reason:
        request = drill.services[name].srv_type.Request()
        for field, draw in fields.items():
            setattr(request, field, draw(random))
        before = drill.requests_refused
        reason = refusal(drill.call(name, request))
        counted = drill.requests_refused > before or reason == "it is in that state already"
        if reason is not None and not counted:
            raise NotAnsweredError(f"refused, {reason}, but not counted")
        return reason

    return send


def _set_parameter(random: random.Random) -> ParameterMessage:
    kind = random.choice((*range(10), ParameterType.PARAMETER_DOUBLE, hostile.whole(random, 8)))
    value = ParameterValue(
        type=kind,
        bool_value=random.random() < 0.5,
        integer_value=hostile.whole(random, 64, signed=True),
        double_value=hostile.number(random),
        string_value=hostile.text(random, surrogates=False),
        byte_array_value=[bytes([byte]) for byte in random.randbytes(random.randrange(3))],
        bool_array_value=[True] * random.randrange(3),
        integer_array_value=[hostile.whole(random, 64, signed=True)] * random.randrange(3),
        double_array_value=[hostile.number(random)] * random.randrange(3),
        string_array_value=[hostile.text(random, surrogates=False)] * random.randrange(3),
    )
    known = random.choice((CHANGEABLE, (*PARAMETERS, *ROS_NAMES)))
    name = hostile.name(random, known)
    if name in NUMBERS and random.random() < 0.3:  # at the very end of its range
        quantity = NUMBERS[name]
        end = random.choice((quantity.minimum, quantity.maximum))
        value.type = ParameterType.PARAMETER_DOUBLE
        value.double_value = random.choice(
            (end, math.nextafter(end, random.choice((-1, 1)) * 1e99))
        )
    return ParameterMessage(name=name, value=value)


def _set_parameters(random: random.Random) -> list[ParameterMessage]:
    return [_set_parameter(random) for _ in range(random.choice((0, 1, 1, 1, 2, 5)))]


def _names(random: random.Random) -> list[str]:
    return [hostile.name(random, tuple(PARAMETERS)) for _ in range(random.randrange(4))]


def _fault(random: random.Random) -> Any:
    kind = hostile.name(random, tuple(KINDS))
    channel = "" if random.random() < 0.5 else hostile.name(random, (*CHANNELS, "waveform"))
    return Fault(
        kind=kind,
        channel=channel,
        magnitude=hostile.number(random),
        number=hostile.whole(random, 32),
        active=random.random() < 0.5,
        onset=_stamp(random),
    )


def _duration(random: random.Random) -> Any:
    stamp = _stamp(random)
    return Duration(sec=stamp.sec, nanosec=stamp.nanosec)


def _state(random: random.Random) -> Any:
    state = hostile.whole(random, 8)
    quitting = state == SimulationState.STATE_QUITTING  # ends the node, rightly
    return SimulationState(state=255 if quitting else state)


def _checkpoint(random: random.Random) -> str:
    if random.random() < 0.5:
        return random.choice(("before", "after", "befor"))
    return hostile.text(random, surrogates=False)


def _transition(random: random.Random) -> Any:
    known = ("configure", "activate", "cleanup", "")
    return Transition(
        id=random.choice(IMPOSSIBLE_TRANSITIONS),
        label=random.choice((*known, *hostile.WORDS)) if random.random() < 0.5 else "",
    )


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
    "command/weight_on_bit": _command(_weight_on_bit, "command/weight_on_bit"),
    "command/drive": _command(_drive, "command/drive"),
    "set_parameters": _service("set_parameters", _of_parameters, parameters=_set_parameters),
    "set_parameters_atomically": _service(
        "set_parameters_atomically", _of_parameters_at_once, parameters=_set_parameters
    ),
    "get_parameters": _service("get_parameters", _answered, names=_names),
    "get_parameter_types": _service("get_parameter_types", _answered, names=_names),
    "describe_parameters": _service("describe_parameters", _answered, names=_names),
    "list_parameters": _service(
        "list_parameters",
        _answered,
        prefixes=_names,
        depth=lambda random: hostile.whole(random, 64),
    ),
    "change_state": _service("change_state", _of_transition, transition=_transition),
    "engage": _service("engage", _of_success, data=lambda random: random.random() < 0.5),
    "inject_fault": _service("inject_fault", _of_success, fault=_fault, duration=_duration),
    "clear_fault": _service(
        "clear_fault", _of_success, number=lambda random: hostile.whole(random, 32)
    ),
    "list_faults": _service("list_faults", _answered),
    "simulation/get_state": _service("simulation/get_state", _of_result),
    "simulation/get_delivery": _service("simulation/get_delivery", _answered, nodes=_names),
    "simulation/set_state": _service("simulation/set_state", _of_result, state=_state),
    "simulation/step": _step("simulation/step", "duration"),
    "simulation/run_to": _step("simulation/run_to", "time"),
    "simulation/reset": _service(
        "simulation/reset",
        _of_result,
        scope=lambda random: hostile.whole(random, 8),
        reseed=lambda random: random.random() < 0.5,
        seed=lambda random: hostile.whole(random, 32),
    ),
    "simulation/save": _service("simulation/save", _of_result, name=_checkpoint),
    "simulation/restore": _service("simulation/restore", _of_result, name=_checkpoint),
    "node": _node,
}
# Their share of the turns: these take milliseconds, and rclpy never frees all that a node took.
RARE = {"node": 0.005, "simulation/reset": 0.2, "simulation/restore": 0.2}
