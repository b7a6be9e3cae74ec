"""Scenario files, command files and the faults of ``--inject``."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError, Quantity, shown
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.foundation.yaml_files import Cursor, cursor_at, open_yaml
from rpud_sim.simulation.changes import Action, Change, Inject, PlannedChanges, in_order
from rpud_sim.simulation.commands import Drive, DriveChange, Feed, WeightOnBit
from rpud_sim.simulation.configuration import Settings, parse_assignment
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError

SEED = Quantity("", "seed of the values that are drawn", 0.0, 2.0**63, below=True, whole=True)
ONSET = Quantity("s", "simulation time at which a fault begins", 0.0, 1e6)
DURATION = Quantity("s", "time for which it lasts", 1e-9, 1e6)

_DRAWN = ("onset", "duration", "magnitude")
_KEYS = ("kind", "channel", *_DRAWN)


_COMMAND_KEYS = ("time", "weight_on_bit", "drive", "feed")
_DRIVE_KEYS = ("enabled", "voltage", "frequency")


def scenario_of(settings: Settings, seed: int | None = None) -> tuple[Change, ...]:
    """Read the scenario of settings; a seed, theirs if it is zero, takes the place of its own."""
    if not settings.scenario:
        return ()
    return read_scenario(settings.scenario, seed or settings.seed or None)


def read_scenario(path: str | Path, seed: int | None = None) -> tuple[Change, ...]:
    """Return the faults of a scenario file; a seed, zero or more, takes the place of the file's."""
    # Without truth values: in a scenario, off is a kind of fault.
    return scenario_at(open_yaml(path, truth_values=False, error=FaultError), seed)


def parse_scenario(content: Any, name: str) -> tuple[Change, ...]:
    return scenario_at(cursor_at(content, name, FaultError))


def scenario_at(top: Cursor, seed: int | None = None) -> tuple[Change, ...]:
    """Return the faults of the scenario that a cursor is at the top of, with all values drawn.

    They are in the order of their onsets; those of one kind on one channel do not overlap.
    """
    top.file_mapping("a scenario")
    top.mapping(("seed", "faults"))
    written = top.get("seed", 0).check(SEED)
    seed = written if seed is None else replace(top.get("seed"), value=seed).check(SEED)
    found = []
    for number, entry in enumerate(top.get("faults").sequence(), 1):
        with entry.errors():
            found.append((number, *_fault(entry, number, seed)))
    found.sort(key=lambda item: item[1].time)
    latest: dict[tuple[str, str], tuple[int, int]] = {}
    for number, change, fault, duration in found:
        other, clear = latest.get((fault.kind, fault.channel), (0, 0))
        if change.time < clear:
            raise FaultError(f"{change.place}{fault} begins while that of entry {other} lasts")
        latest[fault.kind, fault.channel] = (number, change.time + duration if duration else NEVER)
    return tuple(change for _, change, *_ in found)


def _fault(entry: Cursor, number: int, seed: int) -> tuple[Change, Fault, int]:
    entry.mapping(_KEYS, needed=("kind", "onset"))
    values = entry.value
    kind, channel = values["kind"], values.get("channel", "")
    known = Fault(kind, channel)  # checks the names before the numbers

    def drawn(key: str, quantity: Quantity, name: str = "") -> float:
        """Return the number of a key, or one drawn between its two bounds."""
        name, value = name or key, values[key]
        if not isinstance(value, Mapping):
            return float(quantity.check(name, value))
        bounds = value.get("uniform")
        if set(value) != {"uniform"} or not (isinstance(bounds, list) and len(bounds) == 2):
            raise FaultError(
                f"{name} = {shown(value)} is neither a number nor uniform: [least, most]"
            )
        least, most = (quantity.check(f"{name}, uniform,", bound) for bound in bounds)
        if not least <= most:
            raise FaultError(
                f"{name} = uniform: [{least:g}, {most:g}] has its least above its most"
            )
        # A stream of its own for each number: changing one entry changes no other.
        stream = np.random.SeedSequence(seed, spawn_key=(number, _DRAWN.index(key)))
        return float(least + (most - least) * float(np.random.default_rng(stream).random()))

    onset = round(drawn("onset", ONSET) * SECOND)
    duration = round(drawn("duration", DURATION) * SECOND) if "duration" in values else 0
    magnitude = values.get("magnitude", math.nan)
    quantity = KINDS[kind].quantity_on(channel)
    if not (quantity is None or (isinstance(magnitude, float) and math.isnan(magnitude))):
        magnitude = drawn("magnitude", quantity, f"magnitude of {known}")
    fault = Fault(kind, channel, magnitude)
    return Change(onset, Inject(fault, duration), entry.prefix), fault, duration


def parse_injections(texts: Sequence[str]) -> PlannedChanges:
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
    return PlannedChanges(scenario_at(cursor_at({"faults": entries}, "--inject")))


def read_commands(path: str | Path) -> PlannedChanges:
    """Return the changes of a command file: a scenario that may hold commands as well.

    Times count from the instant of the fork.
    """
    top = open_yaml(path, truth_values=False)
    entries = top.file_mapping("a scenario")
    content = {key: entry.value for key, entry in entries.items() if key != "commands"}
    if "commands" not in entries:
        return PlannedChanges(scenario_at(top))
    content = {"faults": [], **content}
    faults = PlannedChanges(scenario_at(dataclasses.replace(top, value=content)))
    return PlannedChanges(parse_commands(entries["commands"]), replaces_commands=True) + faults


def parse_commands(listed: Cursor) -> tuple[Change, ...]:
    """Return the commands of a list in YAML, in the order of their times."""
    planned: list[Change] = []
    for entry in listed.sequence():
        with entry.errors():
            planned += _commands(entry)
    return in_order(planned)


def _commands(entry: Cursor) -> list[Change]:
    given = entry.mapping(_COMMAND_KEYS)
    if "time" not in given or len(given) == 1:
        raise entry.refusal("it needs a time, and weight_on_bit, drive or feed")
    time = round(given["time"].check(ONSET) * SECOND)
    makers: Mapping[str, Callable[[Cursor], Action]] = {
        "weight_on_bit": lambda weight: WeightOnBit(weight.value),
        "drive": _drive,
        "feed": _feed,
    }
    return [Change(time, make(given[key])) for key, make in makers.items() if key in given]


def _feed(entry: Cursor) -> Feed:
    if not (isinstance(entry.value, Mapping) and len(entry.value) == 1):
        raise entry.refusal("feed = {shown} is neither {{rate: m/s}} nor {{position: m}}")
    [(mode, value)] = entry.value.items()
    return Feed(mode, value)


def _drive(entry: Cursor) -> DriveChange:
    values = entry.mapping(
        _DRIVE_KEYS,
        other="drive = {shown} is not a mapping",
        unknown="drive: {shown} is not one of {names}",
    )
    # The file is read without truth values, for off is a kind of fault.
    enabled = entry.get("enabled", "true")
    if enabled.value not in ("true", "false"):
        raise enabled.refusal("drive enabled = {shown} is not true or false")
    numbers = {key: each.value for key, each in values.items() if key != "enabled"}
    change = DriveChange(enabled.value == "true", **numbers)
    change.on(Drive(True, 1.0, 1e4))  # checks the numbers
    return change
