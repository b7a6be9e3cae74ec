"""Verbs on a drill: what each does, and its parameters, for scripts, clients and command line."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, TypeVar

from rpud_sim.foundation.options import POSITIVE_SECONDS, SEED, option, positional, required

EXACTLY_ONE = "exactly one"  # group of options: one of them must be given

_Method = TypeVar("_Method", bound=Callable[..., Any])


class Verb(NamedTuple):
    """Verb, which is a method of clients and a command of ``rpud``."""

    text: str  # documentation of the method
    help: str  # help of the command
    example: str  # arguments of the command
    # options of the command; ``off`` is the opposite of the first parameter
    options: Mapping[str, Any]


def verb(method: _Method) -> _Method:
    """Give a method the documentation of its verb."""
    method.__doc__ = VERBS[method.__name__].text
    return method


class DeclaredAttributes:
    """Objects whose public attributes are those that their class annotates.

    ``drill.weight_on_bit = 30`` and ``drill.press = 30`` would do nothing: an AttributeError.
    """

    def __setattr__(self, name: str, value: object) -> None:
        if not name.startswith("_"):
            kind = type(self)
            if not any(name in getattr(each, "__annotations__", ()) for each in kind.__mro__):
                raise AttributeError(f"{name} of a {kind.__name__} cannot be set")
        super().__setattr__(name, value)


def finite_number(text: str) -> float:
    """Return a finite number, whose range the drill checks; a type for argparse."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"{text!r} is not a number")
    return value


def _number(text: str, metavar: str, default: Any = None, **words: Any) -> Any:
    return option(default, text, type=finite_number, metavar=metavar, **words)


VERBS: Mapping[str, Verb] = {
    "press": Verb(
        "Command a weight on bit [N].",
        "press a running drill onto the rock with a weight on bit",
        "30",
        {"force": positional("FORCE", "weight on bit in newtons", type=finite_number)},
    ),
    "drive": Verb(
        "Command amplitude [V] and frequency [Hz], None as they are, or switch the drive off.",
        "drive the actuator of a running drill, or switch it off",
        "--voltage 80",
        {
            "off": option(False, "do not drive the actuator"),
            "voltage": _number("amplitude in volts (default: unchanged)", "V"),
            "frequency": _number("frequency in hertz (default: unchanged)", "HZ"),
        },
    ),
    "feed": Verb(
        "Command the feed of a drill on an arm: a rate [m/s] or a position [m], and not both.",
        "feed a running drill on an arm toward the rock, or retract it",
        "--rate 0.0005",
        {
            "rate": _number("toward the rock in m/s; 0 holds the mount", "V", group=EXACTLY_ONE),
            "position": _number("along the drill axis in metres", "X", group=EXACTLY_ONE),
        },
    ),
    "move": Verb(
        "Command the motion of a given mount: position [m], and velocity [m/s] from there on. A "
        "mount that moves is held where it is after half a second without a motion.",
        "move the mount of a running drill with feed_model given",
        "--position 0.002",
        {
            "position": required("along the drill axis in metres", type=finite_number, metavar="X"),
            "velocity": _number("toward the rock in m/s, from there on", "V", 0.0),
        },
    ),
    "engage": Verb(
        "Put the drill tool into the rock, or take it out.",
        "put the tool of a running drill into the rock, or take it out",
        "--off",
        {"off": option(False, "take the tool out of the rock")},
    ),
    "inject": Verb(
        "Inject a fault, such as ``free_mass_jammed``, and return its number.\n\n"
        "``channel`` is the topic of a signal fault. The duration is simulation time [s].",
        "inject a fault into a running drill, or list its faults",
        "free_mass_jammed --for 5",
        {
            "kind": positional(
                "KIND",
                "kind of the fault; `rpud inject --list` lists those that are possible",
                nargs="?",
                group=EXACTLY_ONE,
            ),
            "channel": option(
                "",
                "topic with the faulty signal, such as reacting_force; only for signal faults",
                metavar="C",
            ),
            "magnitude": _number(
                "fault magnitude, in the fault's unit (default: depends on the fault)", "M"
            ),
            "duration": option(
                None,
                "end the fault after that many seconds of simulation time (default: never)",
                POSITIVE_SECONDS,
                flag="--for",
            ),
            "list": option(
                False,
                "list the active faults, and the kinds and channels that are possible now",
                group=EXACTLY_ONE,
            ),
            "json": option(False, "print the list as one JSON object"),
        },
    ),
    "clear": Verb(
        "End active faults now: ``which`` is a number, a kind or ``all``. Return their numbers.",
        "end faults of a running drill",
        "free_mass_jammed",
        {
            "fault": positional(
                "FAULT", "number of a fault, or a kind of faults", nargs="?", group=EXACTLY_ONE
            ),
            "all": option(False, "end all faults", group=EXACTLY_ONE),
        },
    ),
    "pause": Verb(
        "Pause simulation time; a step that is under way is interrupted.",
        "pause a running drill, so that it can be stepped",
        "",
        {},
    ),
    "play": Verb("Let simulation time pass by itself.", "continue a paused drill", "", {}),
    "step": Verb(
        "Advance a paused drill, and return the stamp that it reached [s].\n\n"
        "The messages up to then are in the lists of ``listen``; ``published`` counts all of them.",
        "advance a paused drill by some seconds of simulation time",
        "0.1",
        {"seconds": positional("SECONDS", "simulation time", type=finite_number)},
    ),
    "reset": Verb(
        "Begin again: ``all``, ``time``, ``state`` or ``faults``, or bits of the service.\n\n"
        "``seed`` is of phase, scenario and noise from here on; None leaves it unchanged.",
        "reset a running drill",
        "--seed 7",
        {
            "scope": option(
                "all",
                "part to reset (default: %(default)s)",
                choices=("all", "time", "state", "faults"),
            ),
            "seed": option(
                None, "seed of phase, scenario and noise from here on (default: unchanged)", SEED
            ),
        },
    ),
}
"""Verbs by name, in the order in which the command line lists them."""
