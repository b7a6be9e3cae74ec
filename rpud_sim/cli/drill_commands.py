"""Commands on a running drill: press, drive, feed, move, engage, faults, time, parameters, echo."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING, Any

from rpud_sim.cli.options import AT_MOST_ONE, PLACE, Fields, command
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.json_text import finite_values, json_text
from rpud_sim.foundation.options import POSITIVE_SECONDS, option, positional
from rpud_sim.foundation.quantities import ExpectedError, Quantity
from rpud_sim.foundation.terminal import cell, print_error, printable, table
from rpud_sim.foundation.verbs import VERBS

if TYPE_CHECKING:
    from rpud_sim.ros.client import DrillClient
    from rpud_sim.ros.client.listening_node import ListeningNode

_COUNT = Quantity("", "a number of messages", 1, 2**63 - 1, whole=True)
_WIDTH = 2**31 - 1  # width of a line of YAML: no text is folded
_WAIT = 0.1  # time between looks at the clock and at signals [s]


_DRILL: Fields = {  # options of every command on a running drill
    **PLACE,
    "patience": option(
        5.0,
        "fail if there is no drill or no answer within that many seconds (default: %(default)g)",
        POSITIVE_SECONDS,
        last=True,
    ),
}


@contextmanager
def _connected_drill(name: str, options: Any) -> Iterator[DrillClient]:
    """Connect a command to its drill; each error becomes one line."""
    from rpud_sim.ros.client import DrillClient, RefusedError

    with DrillClient(
        options.namespace,
        domain_id=options.domain,
        node_name=f"rpud_{name}",
        patience=options.patience,
    ) as drill:
        try:
            yield drill
        except RefusedError as error:
            raise ExpectedError(f"the drill rejects it: {error}") from error


def _drive(drill: DrillClient, **_: Any) -> str:
    status = drill.status
    state = "on" if status.drive_enabled else "off"
    return f"drive: {state}, {status.drive_voltage:g} V, {status.drive_frequency:g} Hz"


def _feed(drill: DrillClient, rate: float | None, position: float | None, **_: Any) -> str:
    return f"feed: to {position:g} m" if rate is None else f"feed: {rate:g} m/s"


def _inject(drill: DrillClient, result: int, kind: str, channel: str, **_: Any) -> str:
    from rpud_sim.simulation.fault_kinds import fault_text

    return f"fault {result}: {fault_text(kind, channel)}"


def _state(drill: DrillClient, **_: Any) -> str:
    return f"state: {drill.status.state}"


# What a command prints when the drill has accepted it, of the arguments and the result.
_TEXTS: dict[str, Callable[..., str]] = {
    "press": lambda drill, force, result: f"weight on bit: {force:g} N",
    "drive": _drive,
    "feed": _feed,
    "move": lambda drill, position, velocity, result: f"mount: at {position:g} m, {velocity:g} m/s",
    "engage": lambda drill, **_: f"regime: {drill.status.regime}",
    "inject": _inject,
    "clear": lambda drill, which, result: (
        f"cleared: {printable(', '.join(map(str, result)) or 'no fault was active')}"
    ),
    "pause": _state,
    "play": _state,
    "step": lambda drill, seconds, result: f"time: {result:.9f} s",
    "reset": lambda drill, **_: f"{_state(drill)}, time: {drill.time:.9f} s",
}


def _run(name: str, options: Any) -> ExitCode:
    """Let a drill carry out a verb, and print the outcome."""
    arguments = {each: getattr(options, each) for each in VERBS[name].options}
    with _connected_drill(name, options) as drill:
        if name == "inject":
            as_json = arguments.pop("json")
            if arguments.pop("list"):
                print(_faults(drill, as_json))
                return ExitCode.DONE
        elif name == "clear":
            fault = arguments.pop("fault")
            which = "all" if arguments.pop("all") else fault
            arguments["which"] = int(which) if which.isdecimal() else which
        on = [not arguments.pop("off")] if "off" in arguments else []
        result = getattr(drill, name)(*on, **arguments)
        print(_TEXTS[name](drill, **arguments, result=result))
    return ExitCode.DONE


for _name, _verb in VERBS.items():
    command(_name, _verb.example, _verb.help, "", _DRILL, **_verb.options)(partial(_run, _name))


def _faults(drill: DrillClient, as_json: bool) -> str:
    answer = drill.list_faults()
    active = [
        {
            "number": fault.number,
            "kind": fault.kind,
            "channel": fault.channel,
            # NaN, for none, is not JSON.
            "magnitude": None if math.isnan(fault.magnitude) else fault.magnitude,
            "onset": fault.onset.sec + fault.onset.nanosec / 1e9,
        }
        for fault in answer.faults
    ]
    if as_json:
        kinds, channels = [*answer.kinds], [*answer.channels]
        return json_text({"active": active, "kinds": kinds, "channels": channels}, indent=2)
    rows = [
        (
            *(each["kind"], each["channel"] or "-", each["number"]),
            *(cell(each["magnitude"], "g"), cell(each["onset"], ".3f")),
        )
        for each in active
    ]
    head = ("active fault", "channel", "number", "magnitude", "onset [s]")
    lines = table(head, rows, left=2) if rows else ["no fault is active"]
    lines.append(printable(f"possible kinds: {', '.join(answer.kinds)}"))
    lines.append(printable(f"channels of signal faults: {', '.join(answer.channels)}"))
    return "\n".join(lines)


@command(
    "set",
    "real_time_factor=0.5",
    "set parameters of a running drill",
    "",
    _DRILL,
    assignments=positional(
        "NAME=VALUE",
        "a parameter that may change while the drill runs, in SI units",
        nargs="+",
    ),
)
def _set(options: Any) -> ExitCode:
    from rpud_sim.simulation.configuration import parse_assignment

    values = dict(map(parse_assignment, options.assignments))  # before the drill is looked for
    with _connected_drill("set", options) as drill:
        drill.set_parameters(**values)
    print(printable(", ".join(f"{name}: {value}" for name, value in values.items())))
    return ExitCode.DONE


@command(
    "echo",
    "status --once",
    "print the messages of a topic, of any installed type",
    "Each message is a YAML document. The subscription asks for what the publishers offer, so a "
    "latched topic gives its last messages. Lost messages are counted on standard error.",
    _DRILL,
    topic=positional("TOPIC", "name, relative to the namespace or absolute"),
    once=option(False, "end after one message", group=AT_MOST_ONE),
    count=option(
        None,
        "end after that many messages (default: at SIGINT or SIGTERM)",
        _COUNT,
        group=AT_MOST_ONE,
    ),
    duration=option(None, "end after that many seconds", POSITIVE_SECONDS),
    json=option(False, "print one line of JSON per message"),
    field=option(None, "print only this field, such as header.stamp.sec", metavar="PATH"),
    full_length=option(
        False, "print arrays and texts in full; otherwise YAML cuts them after 128 elements"
    ),
)
def _echo(options: Any) -> ExitCode:
    from rpud_sim.ros.client.listening_node import ListeningNode
    from rpud_sim.ros.client.topics import CUT, field_getter, listen, to_plain

    with ListeningNode(
        "rpud_echo", options.namespace, options.domain, options.patience
    ) as listening:
        messages: list[Any] = []
        topic = listen(listening, options.topic, messages)
        field = field_getter(options.field, topic.kind) if options.field else None
        cut = None if options.full_length or options.json else CUT
        text = _json_text if options.json else _yaml_text()
        reported = 0  # lost messages
        for message in _received(listening, topic.name, messages, options):
            value = message if field is None else field(message)
            sys.stdout.write(text(None if value is None else to_plain(value, cut)))
            if not messages:
                sys.stdout.flush()
            if topic.lost > reported:
                reported = topic.lost
                print_error("rpud echo", f"{reported} messages of {topic.name} were lost")
    return ExitCode.DONE


def _received(
    listening: ListeningNode, name: str, messages: list[Any], options: Any
) -> Iterator[Any]:
    """Take the messages off a list that is filled meanwhile, until a signal or the end."""
    from rpud_sim.ros.process import StopRequest

    wanted = 1 if options.once else options.count
    end = None if options.duration is None else time.monotonic() + options.duration
    shown = 0
    with StopRequest() as stop:
        while not stop.requested and (wanted is None or shown < wanted):
            if messages:
                shown += 1
                yield messages.pop(0)
                continue
            rest = _WAIT if end is None else min(_WAIT, end - time.monotonic())
            if rest <= 0.0:
                if wanted is None:
                    return
                limit = f"within {options.duration:g} s"
                raise ExpectedError(f"{shown} of {wanted} messages on {name} {limit}")
            listening.spin(rest)


def _json_text(plain: Any) -> str:
    return json_text(finite_values(plain)) + "\n"


def _yaml_text() -> Callable[[Any], str]:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

    def write(plain: Any) -> str:
        text = yaml.dump(plain, Dumper=dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
        return str(text).removesuffix("...\n") + "---\n"

    return write
