"""Scenario files, command files and the faults of ``--inject``."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import Flag, ParameterError, Quantity, shown
from rpud_sim.foundation.schema import as_it_is, here, key, list_of, one_of, read
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import Cursor, cursor_at, open_yaml
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings, parse_assignment
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError
from rpud_sim.simulation.plans import (
    Changes,
    DriveChange,
    Injection,
    Planned,
    Scenario,
    ScheduledFault,
    in_order,
)

SEED = Quantity("", "seed of the values that are drawn", 0.0, 2.0**63, below=True, whole=True)
ONSET = Quantity("s", "simulation time at which a fault begins", 0.0, 1e6)
DURATION = Quantity("s", "time for which it lasts", 1e-9, 1e6)

_DRAWN = ("onset", "duration", "magnitude")
_Bounds = tuple[float, float]  # least and most, which are equal if nothing is drawn


@dataclasses.dataclass(frozen=True)
class _Uniform:
    """Mapping in place of a number that is drawn."""

    uniform: tuple[Cursor, Cursor] = key(list_of(here, 2, 2))


def _bounds(quantity: Quantity) -> Callable[[Cursor], _Bounds]:
    """Return the reader of a number, or of two bounds between which it is drawn."""

    def read_bounds(cursor: Cursor) -> _Bounds:
        if not isinstance(cursor.value, Mapping):
            number = float(cursor.check(quantity))
            return number, number
        least, most = (float(each.check(quantity)) for each in read(cursor, _Uniform).uniform)
        if not least <= most:
            raise cursor.wrong("has its least above its most")
        return least, most

    return read_bounds


@dataclasses.dataclass(frozen=True)
class _FaultEntry:
    """Fault of a scenario file."""

    kind: str = key(as_it_is)
    onset: _Bounds = key(_bounds(ONSET))
    channel: str = key(as_it_is, "")
    duration: _Bounds | None = key(_bounds(DURATION), None)
    magnitude: Cursor | None = key(here, None)  # its unit and range belong to kind and channel

    def scheduled(self, number: int, seed: int, place: str) -> ScheduledFault:
        """Return the fault with its values drawn, by its number in the file, from 1 on."""

        def drawn(name: str, bounds: _Bounds) -> float:
            # A stream of its own for each number: changing one entry changes no other.
            least, most = bounds
            stream = np.random.SeedSequence(seed, spawn_key=(number, _DRAWN.index(name)))
            return float(least + (most - least) * float(np.random.default_rng(stream).random()))

        Fault(self.kind, self.channel)  # checks the names before the number
        magnitude = math.nan if self.magnitude is None else self.magnitude.value
        quantity = KINDS[self.kind].quantity_on(self.channel)
        if (
            self.magnitude
            and quantity
            and not (isinstance(magnitude, float) and magnitude != magnitude)
        ):
            magnitude = drawn("magnitude", _bounds(quantity)(self.magnitude))
        onset = round(drawn("onset", self.onset) * SECOND)
        clear = None
        if self.duration:
            clear = onset + round(drawn("duration", self.duration) * SECOND)
        return ScheduledFault(onset, clear, Fault(self.kind, self.channel, magnitude), place)


def _drive(cursor: Cursor) -> DriveChange:
    keys = {"enabled": Flag(""), "voltage": as_it_is, "frequency": as_it_is}
    change = DriveChange(**{"enabled": True, **read(cursor, keys)})
    change.on(Drive(True, 1.0, 1e4))  # checks the numbers
    return change


def _feed(cursor: Cursor) -> Feed:
    return Feed(*one_of({"rate": as_it_is, "position": as_it_is})(cursor))


@dataclasses.dataclass(frozen=True)
class _CommandEntry:
    """Commands at one time of a command file."""

    time: float = key(ONSET)
    weight_on_bit: WeightOnBit | None = key(lambda cursor: WeightOnBit(cursor.value), None)
    drive: DriveChange | None = key(_drive, None)
    feed: Feed | None = key(_feed, None)

    @property
    def planned(self) -> list[Planned]:
        delay = round(self.time * SECOND)
        found = [each for each in (self.weight_on_bit, self.drive, self.feed) if each]
        return [Planned(delay, change) for change in found]

    def __post_init__(self) -> None:
        if not self.planned:
            raise ParameterError("a command has a weight_on_bit, drive or feed beside its time")


def parse_commands(listed: Cursor) -> tuple[Planned, ...]:
    """Return the commands of a list in YAML, in the order of their times."""
    entries = list_of(_CommandEntry)(listed)
    return in_order(each for entry in entries for each in entry.planned)


@dataclasses.dataclass(frozen=True)
class _ScenarioFile:
    faults: tuple[Cursor, ...] = key(list_of(here))
    seed: int = key(SEED, 0)


@dataclasses.dataclass(frozen=True)
class _CommandFile(_ScenarioFile):
    faults: tuple[Cursor, ...] = key(list_of(here), ())
    commands: tuple[Planned, ...] | None = key(parse_commands, None)


def scenario_of(settings: Settings, seed: int | None = None) -> Scenario | None:
    """Read the scenario of settings; a seed, theirs if it is zero, takes the place of its own."""
    if not settings.scenario:
        return None
    return read_scenario(settings.scenario, seed or settings.seed or None)


def read_scenario(path: str | Path, seed: int | None = None) -> Scenario:
    """Read a scenario file; a seed, zero or more, takes the place of the file's."""
    return scenario_at(open_yaml(path, error=FaultError), seed)


def parse_scenario(content: Any, name: str) -> Scenario:
    return scenario_at(cursor_at(content, name, FaultError))


def scenario_at(top: Cursor, seed: int | None = None) -> Scenario:
    """Return the scenario that a cursor is at the top of."""
    file = read(top, _ScenarioFile)
    if seed is not None:
        seed = dataclasses.replace(top.get("seed"), value=seed).check(SEED)
    return _scenario(file.faults, file.seed if seed is None else seed)


def _scenario(entries: Sequence[Cursor], seed: int) -> Scenario:
    found = []
    for number, cursor in enumerate(entries, 1):
        entry = read(cursor, _FaultEntry)
        with cursor.errors():
            found.append((number, cursor, entry.scheduled(number, seed, cursor.prefix)))
    found.sort(key=lambda item: item[2].onset)
    latest: dict[tuple[str, str], tuple[int, int | None]] = {}
    for number, cursor, scheduled in found:
        fault = scheduled.fault
        other, clear = latest.get((fault.kind, fault.channel), (0, 0))
        if clear is None or scheduled.onset < clear:
            raise cursor.error(f"{fault} begins while that of entry {other} lasts")
        latest[fault.kind, fault.channel] = (number, scheduled.clear)
    return Scenario(seed, tuple(scheduled for _, _, scheduled in found))


def parse_injections(texts: Sequence[str]) -> Changes:
    """Return the faults of ``--inject``: kinds with commas and keys of a scenario's entry.

    A text is such as ``noise,channel=wrench,magnitude=0.5``; without ``onset`` a fault begins at
    the instant of the fork.
    """
    entries = []
    for text in texts:
        kind, *rest = text.split(",")
        keys = [("kind", kind), *map(parse_assignment, rest)]
        if len(dict(keys)) < len(keys):
            raise ParameterError(f"--inject {shown(text)} gives a key twice")
        entries.append({"onset": 0.0, **dict(keys)})
    return Changes(planned=_injections(scenario_at(cursor_at({"faults": entries}, "--inject"))))


def read_commands(path: str | Path) -> Changes:
    """Return the changes of a command file: a scenario that may hold commands as well.

    Times count from the instant of the fork.
    """
    file = read(open_yaml(path), _CommandFile)
    planned = (*(file.commands or ()), *_injections(_scenario(file.faults, file.seed)))
    return Changes(planned=in_order(planned), replaces_commands=file.commands is not None)


def _injections(scenario: Scenario) -> tuple[Planned, ...]:
    return tuple(
        Planned(scheduled.onset, Injection(scheduled.fault, scheduled.duration))
        for scheduled in scenario.faults
    )
