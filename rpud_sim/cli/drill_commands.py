"""Commands on a running drill: press, drive, feed, move, engage, faults, time, parameters, echo."""

from __future__ import annotations

import argparse
import math
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any, TypeVar

from rpud_sim.cli.options import AT_MOST_ONE, EXACTLY_ONE, PLACE, Fields, command
from rpud_sim.cli.program import ExitCode
from rpud_sim.foundation.json_text import finite_values, json_text
from rpud_sim.foundation.options import POSITIVE_SECONDS, SEED, option, positional, required
from rpud_sim.foundation.quantities import ExpectedError, Quantity
from rpud_sim.foundation.terminal import cell, complain, printable, table

if TYPE_CHECKING:
    from rpud_sim.ros.client import DrillClient
    from rpud_sim.ros.client.listening_node import ListeningNode

_COUNT = Quantity("", "a number of messages", 1, 2**63 - 1, whole=True)
_WIDTH = 2**31 - 1  # of a line of YAML: no text is folded
_WAIT = 0.1  # between looks at the clock and at signals [s]

_Act = TypeVar("_Act", bound=Callable[..., str])  # takes the drill and the options


def _number(text: str) -> float:
    """Return a finite number, whose range the drill checks."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


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
            raise ExpectedError(f"the drill refuses: {error}") from error


def _acting(name: str, example: str, text: str, **own: Any) -> Callable[[_Act], _Act]:
    """Declare a command that acts on a running drill, with own options, and prints one text."""

    def declare(act: _Act) -> _Act:
        @command(name, example, text, "", _DRILL, **own)
        def run(options: Any) -> ExitCode:
            with _connected_drill(name, options) as drill:
                said = act(drill, **{each: getattr(options, each) for each in own})
            print(said)
            return ExitCode.DONE

        return act

    return declare


def _quantity(text: str, metavar: str, **words: Any) -> Any:
    return option(None, text, type=_number, metavar=metavar, **words)


@_acting(
    "press",
    "30",
    "press a running drill onto the rock with a weight on bit",
    force=positional("FORCE", "weight on bit in newtons", type=_number),
)
def _press(drill: DrillClient, force: float) -> str:
    drill.press(force)
    return f"weight on bit: {force:g} N"


@_acting(
    "drive",
    "--voltage 80",
    "drive the actuator of a running drill, or switch it off",
    off=option(False, "do not drive the actuator"),
    voltage=_quantity("amplitude in volts (default: the present one)", "V"),
    frequency=_quantity("in hertz (default: the present one)", "HZ"),
)
def _drive(drill: DrillClient, off: bool, voltage: float | None, frequency: float | None) -> str:
    drill.drive(not off, voltage, frequency)
    status = drill.status
    state = "on" if status.drive_enabled else "off"
    return f"drive: {state}, {status.drive_voltage:g} V, {status.drive_frequency:g} Hz"


@_acting(
    "feed",
    "--rate 0.0005",
    "feed a running drill on an arm toward the rock, or retract it",
    rate=_quantity("toward the rock in m/s; 0 holds the mount", "V", group=EXACTLY_ONE),
    position=_quantity("along the drill axis in metres", "X", group=EXACTLY_ONE),
)
def _feed(drill: DrillClient, rate: float | None, position: float | None) -> str:
    drill.feed(rate, position)
    return f"feed: to {position:g} m" if rate is None else f"feed: {rate:g} m/s"


@_acting(
    "move",
    "--position 0.002",
    "move the mount of a running drill with feed_model given",
    position=required("along the drill axis in metres", type=_number, metavar="X"),
    velocity=option(0.0, "toward the rock in m/s, from there on", type=_number, metavar="V"),
)
def _move(drill: DrillClient, position: float, velocity: float) -> str:
    drill.move(position, velocity)
    return f"mount: at {position:g} m, {velocity:g} m/s"


@_acting(
    "engage",
    "--off",
    "put the tool of a running drill into the rock, or take it out",
    off=option(False, "take the tool out of the rock"),
)
def _engage(drill: DrillClient, off: bool) -> str:
    drill.engage(not off)
    return f"regime: {drill.status.regime}"


@_acting(
    "inject",
    "free_mass_jammed --for 5",
    "inject a fault into a running drill, or list its faults",
    kind=positional(
        "KIND",
        "kind of the fault; `rpud inject --list` lists those that are possible",
        nargs="?",
        group=EXACTLY_ONE,
    ),
    channel=option(
        "",
        "topic with the faulty signal, such as reacting_force; only for signal faults",
        metavar="C",
    ),
    magnitude=_quantity("how much, in the unit of the kind (default: that of the kind)", "M"),
    duration=option(
        None,
        "end the fault after that many seconds of simulation time (default: never)",
        POSITIVE_SECONDS,
        flag="--for",
    ),
    list=option(
        False,
        "list the active faults, and the kinds and channels that are possible now",
        group=EXACTLY_ONE,
    ),
    json=option(False, "print the list as one JSON object"),
)
def _inject(drill: DrillClient, kind: str | None, list: bool, json: bool, **fault: Any) -> str:
    if kind is None:
        return _faults(drill, json)
    from rpud_sim.simulation.fault_kinds import fault_text

    number = drill.inject(kind, **fault)
    return f"fault {number}: {fault_text(kind, fault['channel'])}"


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


@_acting(
    "clear",
    "free_mass_jammed",
    "end faults of a running drill",
    fault=positional(
        "FAULT", "number of a fault, or a kind of faults", nargs="?", group=EXACTLY_ONE
    ),
    all=option(False, "end all faults", group=EXACTLY_ONE),
)
def _clear(drill: DrillClient, fault: str | None, all: bool) -> str:
    which = "all" if fault is None else fault
    cleared = drill.clear(int(which) if which.isdecimal() else which)
    return f"cleared: {printable(', '.join(map(str, cleared)) or 'no fault was active')}"


@_acting("pause", "", "pause a running drill, so that it can be stepped")
def _pause(drill: DrillClient) -> str:
    drill.pause()
    return f"state: {drill.status.state}"


@_acting("play", "", "continue a paused drill")
def _play(drill: DrillClient) -> str:
    drill.play()
    return f"state: {drill.status.state}"


@_acting(
    "step",
    "0.1",
    "advance a paused drill by some seconds of simulation time",
    seconds=positional("SECONDS", "of simulation time", type=_number),
)
def _step(drill: DrillClient, seconds: float) -> str:
    return f"time: {drill.step(seconds):.9f} s"


@_acting(
    "reset",
    "--seed 7",
    "reset a running drill",
    scope=option(
        "all",
        "what to reset (default: %(default)s)",
        choices=("all", "time", "state", "faults"),
    ),
    seed=option(None, "of phase, scenario and noise from here on (default: the present one)", SEED),
)
def _reset(drill: DrillClient, scope: str, seed: int | None) -> str:
    drill.reset(scope, seed)
    return f"state: {drill.status.state}, time: {drill.time:.9f} s"


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
        said = 0  # losses that are reported
        for message in _received(listening, topic.name, messages, options):
            value = message if field is None else field(message)
            sys.stdout.write(text(None if value is None else to_plain(value, cut)))
            if not messages:
                sys.stdout.flush()
            if topic.lost > said:
                said = topic.lost
                complain("rpud echo", f"{said} messages of {topic.name} were lost")
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
