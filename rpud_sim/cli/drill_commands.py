"""Commands on a running drill: press, drive, feed, engage, faults, time, parameters, echo."""

from __future__ import annotations

import argparse
import json
import math
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, TypeVar

from rpud_sim.cli.options import AT_MOST_ONE, EXACTLY_ONE, PlaceOptions, command
from rpud_sim.cli.output import table
from rpud_sim.cli.program import CommandError, ExitCode
from rpud_sim.foundation.options import POSITIVE_SECONDS, option, positional
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.terminal import complain, printable

if TYPE_CHECKING:
    from rpud_sim.ros.client import DrillClient
    from rpud_sim.ros.client.topic_listener import TopicListener

_SEED = Quantity("", "a seed", 0, 2**32 - 1, whole=True)
_COUNT = Quantity("", "a number of messages", 1, 2**63 - 1, whole=True)
_WIDTH = 2**31 - 1  # of a line of YAML: no text is folded
_WAIT = 0.1  # between looks at the clock and at signals [s]

_Act = TypeVar("_Act", bound=Callable[..., str])  # takes the drill and the options


def _number(text: str) -> float:
    """Return a finite number, whose range the drill checks; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


@dataclass(frozen=True, kw_only=True)
class DrillOptions(PlaceOptions):
    """Options of every command on a running drill."""

    patience: float = option(
        5.0,
        "fail if there is no drill or no answer within that many seconds (default: %(default)g)",
        POSITIVE_SECONDS,
        last=True,
    )


@contextmanager
def _connected_drill(name: str, options: DrillOptions) -> Iterator[DrillClient]:
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
            raise CommandError(f"the drill refuses: {error}") from error


def _acting(name: str, example: str, text: str, kind: type[DrillOptions]) -> Callable[[_Act], _Act]:
    """Declare a command that acts on a running drill and prints one text."""

    def declare(act: _Act) -> _Act:
        @command(name, example, text, kind)
        def run(options: DrillOptions) -> ExitCode:
            with _connected_drill(name, options) as drill:
                said = act(drill, options)
            print(said)
            return ExitCode.DONE

        return act

    return declare


@dataclass(frozen=True, kw_only=True)
class _Press(DrillOptions):
    force: float = positional("FORCE", "weight on bit in newtons", type=_number)


@_acting("press", "30", "press a running drill onto the rock with a weight on bit", _Press)
def _press(drill: DrillClient, options: _Press) -> str:
    drill.press(options.force)
    return f"weight on bit: {options.force:g} N"


@dataclass(frozen=True, kw_only=True)
class _Drive(DrillOptions):
    off: bool = option(False, "do not drive the actuator")
    voltage: float | None = option(
        None, "amplitude in volts (default: the present one)", type=_number, metavar="V"
    )
    frequency: float | None = option(
        None, "in hertz (default: the present one)", type=_number, metavar="HZ"
    )


@_acting("drive", "--voltage 80", "drive the actuator of a running drill, or switch it off", _Drive)
def _drive(drill: DrillClient, options: _Drive) -> str:
    drill.drive(not options.off, options.voltage, options.frequency)
    status = drill.status
    state = "on" if status.drive_enabled else "off"
    return f"drive: {state}, {status.drive_voltage:g} V, {status.drive_frequency:g} Hz"


@dataclass(frozen=True, kw_only=True)
class _Feed(DrillOptions):
    rate: float | None = option(
        None,
        "toward the rock in m/s; 0 holds the mount",
        type=_number,
        metavar="V",
        group=EXACTLY_ONE,
    )
    position: float | None = option(
        None, "along the drill axis in metres", type=_number, metavar="X", group=EXACTLY_ONE
    )


@_acting(
    "feed", "--rate 0.0005", "feed a running drill on an arm toward the rock, or retract it", _Feed
)
def _feed(drill: DrillClient, options: _Feed) -> str:
    drill.feed(options.rate, options.position)
    if options.rate is not None:
        return f"feed: {options.rate:g} m/s"
    return f"feed: to {options.position:g} m"


@dataclass(frozen=True, kw_only=True)
class _Engage(DrillOptions):
    off: bool = option(False, "take the tool out of the rock")


@_acting(
    "engage", "--off", "put the tool of a running drill into the rock, or take it out", _Engage
)
def _engage(drill: DrillClient, options: _Engage) -> str:
    drill.engage(not options.off)
    return f"regime: {drill.status.regime}"


@dataclass(frozen=True, kw_only=True)
class _Inject(DrillOptions):
    kind: str | None = positional(
        "KIND",
        "kind of the fault; `rpud inject --list` lists those that are possible",
        nargs="?",
    )
    channel: str = option(
        "",
        "topic with the faulty signal, such as reacting_force; only for signal faults",
        metavar="C",
    )
    magnitude: float | None = option(
        None,
        "how much, in the unit of the kind (default: that of the kind)",
        type=_number,
        metavar="M",
    )
    duration: float | None = option(
        None,
        "end the fault after that many seconds of simulation time (default: never)",
        POSITIVE_SECONDS,
        flag="--for",
    )
    list: bool = option(
        False, "list the active faults, and the kinds and channels that are possible now"
    )
    json: bool = option(False, "print the list as one JSON object")

    def __post_init__(self) -> None:
        if (self.kind is None) != self.list:
            raise CommandError("needs either KIND or --list", ExitCode.USAGE)


@_acting(
    "inject",
    "free_mass_jammed --for 5",
    "inject a fault into a running drill, or list its faults",
    _Inject,
)
def _inject(drill: DrillClient, options: _Inject) -> str:
    if options.kind is None:
        return _faults(drill, options.json)
    fault = drill.inject(options.kind, options.channel, options.magnitude, options.duration)
    return f"fault {fault}: {' on '.join(filter(None, (options.kind, options.channel)))}"


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
        return json.dumps({"active": active, "kinds": kinds, "channels": channels}, indent=2)
    rows = [
        (
            fault["kind"],
            fault["channel"] or "-",
            fault["number"],
            "-" if fault["magnitude"] is None else f"{fault['magnitude']:g}",
            f"{fault['onset']:.3f}",
        )
        for fault in active
    ]
    head = ("active fault", "channel", "number", "magnitude", "onset [s]")
    return "\n".join(
        [
            *(table(head, rows, left=2) if rows else ["no fault is active"]),
            printable(f"possible kinds: {', '.join(answer.kinds)}"),
            printable(f"channels of signal faults: {', '.join(answer.channels)}"),
        ]
    )


@dataclass(frozen=True, kw_only=True)
class _Clear(DrillOptions):
    fault: str | None = positional("FAULT", "number of a fault, or a kind of faults", nargs="?")
    all: bool = option(False, "end all faults")

    def __post_init__(self) -> None:
        if (self.fault is None) != self.all:
            raise CommandError("needs either FAULT or --all", ExitCode.USAGE)


@_acting("clear", "free_mass_jammed", "end faults of a running drill", _Clear)
def _clear(drill: DrillClient, options: _Clear) -> str:
    which = "all" if options.fault is None else options.fault
    cleared = drill.clear(int(which) if which.isdecimal() else which)
    return f"cleared: {printable(', '.join(map(str, cleared)) or 'no fault was active')}"


@_acting(
    "pause",
    "",
    "let the time of a running drill stand still, so that it can be stepped",
    DrillOptions,
)
def _pause(drill: DrillClient, options: DrillOptions) -> str:
    drill.pause()
    return f"state: {drill.status.state}"


@_acting("play", "", "let the time of a paused drill pass", DrillOptions)
def _play(drill: DrillClient, options: DrillOptions) -> str:
    drill.play()
    return f"state: {drill.status.state}"


@dataclass(frozen=True, kw_only=True)
class _Step(DrillOptions):
    seconds: float = positional("SECONDS", "of simulation time", type=_number)


@_acting("step", "0.1", "advance a paused drill by some seconds of simulation time", _Step)
def _step(drill: DrillClient, options: _Step) -> str:
    return f"time: {drill.step(options.seconds):.9f} s"


@dataclass(frozen=True, kw_only=True)
class _Reset(DrillOptions):
    scope: str = option(
        "all",
        "what begins again (default: %(default)s)",
        choices=("all", "time", "state", "faults"),
    )
    seed: int | None = option(
        None, "of phase, scenario and noise from here on (default: the present one)", _SEED
    )


@_acting("reset", "--seed 7", "let a running drill begin again", _Reset)
def _reset(drill: DrillClient, options: _Reset) -> str:
    drill.reset(options.scope, options.seed)
    return f"state: {drill.status.state}, time: {drill.time:.9f} s"


@dataclass(frozen=True, kw_only=True)
class _Set(DrillOptions):
    assignments: Sequence[str] = positional(
        "NAME=VALUE",
        "a parameter that may change while the drill runs, in SI units",
        nargs="+",
    )

    def __post_init__(self) -> None:
        self.values()  # a mistake ends before the drill is looked for

    def values(self) -> dict[str, Any]:
        from rpud_sim.simulation.configuration import parse_assignment

        return dict(map(parse_assignment, self.assignments))


@_acting("set", "real_time_factor=0.5", "set parameters of a running drill", _Set)
def _set(drill: DrillClient, options: _Set) -> str:
    values = options.values()
    drill.set_parameters(**values)
    return printable(", ".join(f"{name}: {value}" for name, value in values.items()))


@dataclass(frozen=True, kw_only=True)
class _Echo(DrillOptions):
    topic: str = positional("TOPIC", "name, relative to the namespace or absolute")
    once: bool = option(False, "end after one message", group=AT_MOST_ONE)
    count: int | None = option(
        None,
        "end after that many messages (default: at SIGINT or SIGTERM)",
        _COUNT,
        group=AT_MOST_ONE,
    )
    duration: float | None = option(None, "end after that many seconds", POSITIVE_SECONDS)
    json: bool = option(False, "print one line of JSON per message")
    field: str | None = option(
        None, "print only this field, such as header.stamp.sec", metavar="PATH"
    )
    full_length: bool = option(
        False, "print arrays and texts in full; otherwise YAML cuts them after 128 elements"
    )


@command(
    "echo",
    "status --once",
    "print the messages of a topic, of any installed type",
    _Echo,
    "Each message is a YAML document. The subscription asks for what the publishers offer, so a "
    "latched topic gives its last messages. Lost messages are counted on standard error.",
)
def _echo(options: _Echo) -> ExitCode:
    from rpud_sim.ros.client.listening_node import ListeningNode
    from rpud_sim.ros.client.topic_listener import CUT, TopicListener, field_getter, to_plain

    with ListeningNode("rpud_echo", options.namespace, options.domain) as listening:
        listener = TopicListener(listening, options.topic, options.patience)
        field = field_getter(options.field, listener.kind) if options.field else None
        cut = None if options.full_length or options.json else CUT
        text = _json_text if options.json else _yaml_text()

        def show(message: Any) -> None:
            value = message if field is None else field(message)
            sys.stdout.write(text(None if value is None else to_plain(value, cut)))

        return _listen(listener, show, options)


def _listen(listener: TopicListener, show: Callable[[Any], None], options: _Echo) -> ExitCode:
    from rpud_sim.ros.stopping import StopRequest

    wanted = 1 if options.once else options.count
    end = None if options.duration is None else time.monotonic() + options.duration
    shown = lost = 0
    with StopRequest() as stop:
        while not stop.requested and (wanted is None or shown < wanted):
            rest = _WAIT if end is None else min(_WAIT, end - time.monotonic())
            if rest <= 0.0:
                if wanted is None:
                    break
                limit = f"within {options.duration:g} s"
                raise CommandError(f"{shown} of {wanted} messages on {listener.topic} {limit}")
            messages = listener.take(rest)
            for message in messages[: None if wanted is None else wanted - shown]:
                show(message)
                shown += 1
            if messages:
                sys.stdout.flush()
            if listener.lost > lost:
                lost = listener.lost
                complain("rpud echo", f"{lost} messages of {listener.topic} were lost")
    return ExitCode.DONE


def _json_text(plain: Any) -> str:
    from rpud_sim.foundation.json_values import finite_values

    return json.dumps(finite_values(plain)) + "\n"


def _yaml_text() -> Callable[[Any], str]:
    import yaml

    dumper = getattr(yaml, "CSafeDumper", yaml.SafeDumper)

    def write(plain: Any) -> str:
        text = yaml.dump(plain, Dumper=dumper, sort_keys=False, allow_unicode=True, width=_WIDTH)
        return str(text).removesuffix("...\n") + "---\n"

    return write
