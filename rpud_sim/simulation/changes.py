"""Changes of a run: commands, faults, parameters and origin, each at its time."""

from __future__ import annotations

import dataclasses
import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

from rpud_sim.foundation.quantities import ParameterError, check_names
from rpud_sim.foundation.time import NEVER
from rpud_sim.simulation.commands import (
    Command,
    Drive,
    DriveChange,
    Feed,
    MountMotion,
    WeightOnBit,
)
from rpud_sim.simulation.configuration import CHANGEABLE, PARAMETERS
from rpud_sim.simulation.faults import Fault


@dataclasses.dataclass(frozen=True)
class Inject:
    """Injection of a fault."""

    fault: Fault  # fault that begins
    duration: int = 0  # time after which it ends by itself [ns]; 0 for never


@dataclasses.dataclass(frozen=True)
class Clear:
    """End of a fault, or of all."""

    number: int = 0  # number of the fault; 0 for all
    # Kind and channel identify a fault where numbers differ, as in a fork; empty for the number.
    kind: str = ""
    channel: str = ""


@dataclasses.dataclass(frozen=True)
class Configure:
    """Change of parameters."""

    parameters: Mapping[str, Any]  # new values by name; the others stay


@dataclasses.dataclass(frozen=True)
class SetOrigin:
    """New stamp of simulation time zero."""

    origin: int  # the stamp [ns]


@dataclasses.dataclass(frozen=True)
class Stop:
    """End of a block before its boundary."""


@dataclasses.dataclass(frozen=True)
class Flush:
    """Publication of what waveform and trajectory still hold."""

    ends: bool = False  # whether the run ends here


Action = Command | DriveChange | Inject | Clear | Configure | SetOrigin | Stop | Flush


@dataclasses.dataclass(frozen=True)
class Change:
    """Action at a simulation time."""

    time: int  # simulation time [ns]
    action: Action
    # begins an error message, such as file and line with a colon
    place: str = dataclasses.field(default="", compare=False)


def injected(changes: Iterable[Change]) -> Iterator[tuple[Change, Fault]]:
    """Yield the changes that inject a fault, each with its fault."""
    for change in changes:
        if isinstance(change.action, Inject):
            yield change, change.action.fault


class ChangeError(ParameterError):
    """Change that cannot be carried out; the text reports which and why, in one line."""


class Schedule:
    """Changes still to come, in order of time; of equal times the ends of faults come first."""

    def __init__(self, changes: Iterable[Change] = ()) -> None:
        self._waiting: list[tuple[int, bool, int, Change]] = []
        self._count = 0
        for change in changes:
            self.add(change)

    @property
    def next(self) -> int:
        """Time of the next change [ns]; ``NEVER`` if none is left."""
        return self._waiting[0][0] if self._waiting else NEVER

    def add(self, change: Change, *, first: bool = False) -> None:
        """Add a change, ``first`` before others of its time."""
        heapq.heappush(self._waiting, (change.time, not first, self._count, change))
        self._count += 1

    def due(self, time: int) -> Iterator[Change]:
        """Take what comes up to a time [ns], one after the other."""
        while self.next <= time:
            yield heapq.heappop(self._waiting)[-1]


@dataclasses.dataclass(frozen=True)
class PlannedChanges:
    """Changes of files and of the command line; their times count from where they begin."""

    changes: tuple[Change, ...] = ()  # changes in the order of their times
    replaces_commands: bool = False  # whether the recorded commands of a fork are left out

    @property
    def empty(self) -> bool:
        return not (self.changes or self.replaces_commands)

    @property
    def parameters(self) -> dict[str, Any]:
        """New values of parameters, by name."""
        actions = (change.action for change in self.changes)
        found = (each.parameters for each in actions if isinstance(each, Configure))
        return {name: value for values in found for name, value in values.items()}

    def __add__(self, other: PlannedChanges) -> PlannedChanges:
        """Return both; of equal times the other's come last, and so win."""
        return PlannedChanges(
            in_order((*self.changes, *other.changes)),
            self.replaces_commands or other.replaces_commands,
        )


def in_order(changes: Iterable[Change]) -> tuple[Change, ...]:
    return tuple(sorted(changes, key=lambda change: change.time))


# Parameters that change by a command, for they hold only until the first command
_COMMANDED: Mapping[str, Callable[[Any], Action]] = {
    "weight_on_bit": WeightOnBit,
    "drive_enabled": DriveChange,
}


def parameter_changes(values: Mapping[str, Any], fixed: Sequence[str] = ()) -> PlannedChanges:
    """Return the changes of ``--set``, values by name; names in ``fixed`` may be given too.

    They are checked with the other values of the run when they are carried out.
    """
    allowed = (*CHANGEABLE, *_COMMANDED, *fixed)
    check_names(values, PARAMETERS)
    for name in values:
        if name not in allowed:
            raise ParameterError(
                f"{name} cannot change during a run; those that can are {', '.join(allowed)}"
            )
        PARAMETERS[name].allowed.check(name, values[name])
    others = {name: value for name, value in values.items() if name not in _COMMANDED}
    commands = [_COMMANDED[name](values[name]) for name in _COMMANDED if name in values]
    actions = [*([Configure(others)] if others else []), *commands]
    return PlannedChanges(tuple(Change(0, action) for action in actions))


def journal_form(action: Action) -> tuple[str, dict[str, Any]]:
    """Return kind and content of the journal's entry of an action."""
    if isinstance(action, Clear) and not action.number:
        return "clear_all", {}
    kind = "end" if isinstance(action, Flush) and action.ends else _KINDS[type(action)]
    return kind, {} if isinstance(action, Stop | Flush) else dataclasses.asdict(action)


_KINDS: Mapping[type, str] = {
    WeightOnBit: "weight_on_bit",
    Drive: "drive",
    DriveChange: "drive",
    Feed: "feed",
    MountMotion: "mount",
    Inject: "inject",
    Clear: "clear",
    Configure: "configure",
    SetOrigin: "origin",
    Stop: "stop",
    Flush: "flush",
}


def action_of(kind: str, content: Mapping[str, Any]) -> Action:
    """Return the action of a journal's entry, the inverse of ``journal_form``.

    Raises:
        ArithmeticError, LookupError, TypeError, ValueError: if the entry is unusable.
    """
    if kind not in _ACTIONS:
        raise ValueError("there is no such kind")
    return _ACTIONS[kind](content)


def whole_time(value: Any) -> int:
    """Return a time or a duration out of a journal [ns]; a ValueError reports that it is none."""
    if type(value) is not int or not 0 <= value < NEVER:
        raise ValueError(f"{value!r:.40} is not a time in ns")
    return value


def _sample_time(value: Any) -> int:
    """Return the time of a sample, which may be before the run [ns]."""
    return -whole_time(-value) if type(value) is int and value < 0 else whole_time(value)


_ACTIONS: Mapping[str, Callable[[Mapping[str, Any]], Action]] = {
    "weight_on_bit": lambda content: WeightOnBit(content["force"]),
    "drive": lambda content: Drive(content["enabled"], content["voltage"], content["frequency"]),
    "feed": lambda content: Feed(content["mode"], content["value"]),
    "mount": lambda content: MountMotion(
        content["position"], content["velocity"], _sample_time(content["sampled"])
    ),
    "inject": lambda content: Inject(Fault(**content["fault"]), whole_time(content["duration"])),
    "clear": lambda content: Clear(
        content["number"], content.get("kind", ""), content.get("channel", "")
    ),
    "clear_all": lambda content: Clear(),
    "configure": lambda content: Configure(dict(content["parameters"])),
    "origin": lambda content: SetOrigin(content["origin"]),
    "stop": lambda content: Stop(),
    "flush": lambda content: Flush(),
    "end": lambda content: Flush(ends=True),
}
