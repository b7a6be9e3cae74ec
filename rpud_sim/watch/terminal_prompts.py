"""Questions of the terminal: what an action needs to know, and how an answer is read."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, did_you_mean, shown
from rpud_sim.watch.picture import Picture

Arguments = Mapping[str, Any]

_SCOPES = ("all", "time", "state", "faults")
_OPTIONS = ("magnitude", "for")


def _nothing(picture: Picture) -> str:
    return ""


def _none(picture: Picture) -> Sequence[str]:
    return ()


@dataclasses.dataclass(frozen=True)
class Prompt:
    """Question that an action begins with."""

    key: str  # that asks it
    action: str  # of ``LiveDrill.act``
    question: str  # before the answer
    # returns the action's arguments, None for no action; raises ``ParameterError``
    read: Callable[[str, Picture], Arguments | None]
    default: Callable[[Picture], str] = _nothing  # answer that is there already
    hint: Callable[[Picture], str] = _nothing  # line that says what can be answered
    suggestions: Callable[[Picture], Sequence[str]] = _none  # answers that complete what is typed


def read_drive(text: str, picture: Picture) -> Arguments | None:
    """Return the arguments of ``drive``: ``off``, ``on``, or a voltage and perhaps a frequency."""
    words = text.split()
    if not words:
        return None
    if words[0] in ("on", "off"):
        if len(words) > 1:
            raise ParameterError(f"drive = {shown(text)}: nothing may follow {words[0]}")
        return {"enabled": words[0] == "on"}
    if len(words) > 2:
        raise ParameterError(f"drive = {shown(text)} is more than a voltage and a frequency")
    return {"enabled": True, **dict(zip(("voltage", "frequency"), words, strict=False))}


def has_feed(picture: Picture) -> bool:
    """Return whether the drill hangs on an arm: its feed is commanded, and no weight on bit."""
    return math.isfinite(picture.status.get("feed_value", math.nan))


def read_feed(text: str, picture: Picture) -> Arguments | None:
    """Return the arguments of ``feed``: a rate, or ``to`` and a position."""
    words = text.split()
    if not words:
        return None
    name = "rate"
    if words[0] == "to":
        name, words = "position", words[1:]
    if len(words) != 1:
        raise ParameterError(f"feed = {shown(text)} is not a rate, or to and a position")
    return {name: _number(name, words[0])}


def read_inject(text: str, picture: Picture) -> Arguments | None:
    """Return the arguments of ``inject``: a kind, perhaps a channel, ``magnitude=M``, ``for=S``."""
    words = text.split()
    if not words:
        return None
    named = dict(word.split("=", 1) for word in words if "=" in word)
    plain = [word for word in words if "=" not in word]
    for name in named:
        if name not in _OPTIONS:
            raise ParameterError(f"{shown(name)} is unknown; {did_you_mean(name, _OPTIONS)}")
    if not 1 <= len(plain) <= 2:
        raise ParameterError(f"fault = {shown(text)} is not a kind and perhaps a channel")
    arguments: dict[str, Any] = {"kind": plain[0]}
    if len(plain) > 1:
        arguments["channel"] = plain[1]
    for name, argument in (("magnitude", "magnitude"), ("for", "duration")):
        if name in named:
            arguments[argument] = _number(name, named[name])
    return arguments


def read_clear(text: str, picture: Picture) -> Arguments | None:
    """Return the arguments of ``clear``: a number, a kind or ``all``."""
    text = text.strip()
    return {"which": int(text) if text.isdecimal() else text} if text else None


def read_reset(text: str, picture: Picture) -> Arguments | None:
    """Return the arguments of ``reset``: what to reset."""
    return {"scope": text.strip()} if text.strip() else None


def _read_number(name: str) -> Callable[[str, Picture], Arguments | None]:
    def read(text: str, picture: Picture) -> Arguments | None:
        return {name: _number(name, text)} if text.strip() else None

    return read


def _number(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ParameterError(f"{name} = {shown(text)} is not a number") from None


def _active_faults(picture: Picture) -> list[str]:
    active = [fault for fault in picture.faults if fault.active]
    return ["all", *(str(fault.number) for fault in active), *(fault.kind for fault in active)]


def _kinds_and_channels(picture: Picture) -> list[str]:
    from rpud_sim.simulation.faults import KINDS

    # A signal fault needs its channel.
    kinds = [kind for kind in picture.kinds if kind in KINDS]
    signal = [kind for kind in kinds if not KINDS[kind].physical]
    return [
        *(kind for kind in kinds if KINDS[kind].physical),
        *(f"{kind} {channel}" for kind in signal for channel in picture.channels),
    ]


PROMPTS: Mapping[str, Prompt] = {
    "press": Prompt(
        "p",
        "press",
        "weight on bit [N]:",
        _read_number("force"),
        hint=lambda picture: (
            "on an arm the weight on bit follows from the feed: f commands the feed, Esc leaves it"
            if has_feed(picture)
            else "Enter presses, Esc leaves it"
        ),
    ),
    "feed": Prompt(
        "f",
        "feed",
        "rate of the feed [m/s]:",
        read_feed,
        hint=lambda picture: (
            "such as: 0.0005   or: -0.001 retracts   or: 0 holds   or a position [m]: to 0.01"
            if has_feed(picture)
            else "without an arm there is no feed: p commands the weight on bit, Esc leaves it"
        ),
    ),
    "drive": Prompt(
        "d",
        "drive",
        "voltage [V] and frequency [Hz], on or off:",
        read_drive,
        hint=lambda picture: "such as: 100 20000   or: 100   or: off",
        suggestions=lambda picture: ("on", "off"),
    ),
    "inject": Prompt(
        "i",
        "inject",
        "fault:",
        read_inject,
        hint=lambda picture: " ".join(picture.kinds) or "KIND [CHANNEL] [magnitude=M] [for=S]",
        suggestions=_kinds_and_channels,
    ),
    "clear": Prompt(
        "c",
        "clear",
        "clear which fault:",
        read_clear,
        default=lambda picture: "all",
        hint=lambda picture: "a number, a kind or all",
        suggestions=_active_faults,
    ),
    "step": Prompt(
        "s",
        "step",
        "step [s]:",
        _read_number("seconds"),
        default=lambda picture: "0.1",
        hint=lambda picture: "simulation time; the drill has to stand still (space)",
    ),
    "reset": Prompt(
        "r",
        "reset",
        "reset what:",
        read_reset,
        default=lambda picture: "all",
        hint=lambda picture: ", ".join(_SCOPES),
        suggestions=lambda picture: _SCOPES,
    ),
}
"""Questions by action."""
