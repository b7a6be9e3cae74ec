"""Scenario files, command files and the faults of ``--inject``."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.options import SEED
from rpud_sim.foundation.quantities import Flag, ParameterError, Quantity, short_repr
from rpud_sim.foundation.schema import key, list_of, node_reader, one_of, raw_reader, read
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.foundation.yaml_files import YamlNode, open_yaml, yaml_node
from rpud_sim.simulation.changes import Change, Inject, PlannedChanges, in_order
from rpud_sim.simulation.commands import Drive, DriveChange, Feed, MountMotion, WeightOnBit
from rpud_sim.simulation.configuration import parse_assignment
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault

ONSET = Quantity("s", "simulation time at which a fault begins", 0.0, 1e6)
DURATION = Quantity("s", "time for which it lasts", 1e-9, 1e6)

_DRAWN = ("onset", "duration", "magnitude")
_Bounds = tuple[float, float]  # least and most, which are equal if nothing is drawn


@dataclasses.dataclass(frozen=True)
class _Uniform:
    """Mapping instead of a number that is drawn."""

    bounds: tuple[YamlNode, YamlNode] = key(list_of(node_reader, 2, 2), name="uniform")


def _bounds(quantity: Quantity) -> Callable[[YamlNode], _Bounds]:
    """Return the reader of a number, or of two bounds between which it is drawn."""

    def read_bounds(node: YamlNode) -> _Bounds:
        if not isinstance(node.value, Mapping):
            number = float(node.check(quantity))
            return number, number
        least, most = (float(each.check(quantity)) for each in read(node, _Uniform).bounds)
        if not least <= most:
            raise node.wrong("has its least above its most")
        return least, most

    return read_bounds


@dataclasses.dataclass(frozen=True)
class _FaultEntry:
    """Fault of a scenario file."""

    kind: str = key(raw_reader)
    onset: _Bounds = key(_bounds(ONSET))
    channel: str = key(raw_reader, "")
    duration: _Bounds | None = key(_bounds(DURATION), None)
    magnitude: YamlNode | None = key(
        node_reader, None
    )  # its unit and range belong to kind and channel

    def drawn(self, number: int, seed: int) -> tuple[int, Inject]:
        """Return onset [ns] and fault with values drawn, by its number in the file, from 1 on."""

        def drawn(name: str, bounds: _Bounds) -> float:
            # A separate stream for each number: changing one entry changes no other.
            least, most = bounds
            stream = np.random.SeedSequence(seed, spawn_key=(number, _DRAWN.index(name)))
            return float(least + (most - least) * float(np.random.default_rng(stream).random()))

        Fault(self.kind, self.channel)  # checks the names before the number
        magnitude = math.nan if self.magnitude is None else self.magnitude.value
        quantity = KINDS[self.kind].quantity_on(self.channel)
        left_open = isinstance(magnitude, float) and math.isnan(magnitude)
        if self.magnitude and quantity and not left_open:
            magnitude = drawn("magnitude", _bounds(quantity)(self.magnitude))
        onset = round(drawn("onset", self.onset) * SECOND)
        duration = round(drawn("duration", self.duration) * SECOND) if self.duration else 0
        return onset, Inject(Fault(self.kind, self.channel, magnitude), duration)


def _drive(node: YamlNode) -> DriveChange:
    keys = {"enabled": Flag(""), "voltage": raw_reader, "frequency": raw_reader}
    change = DriveChange(**{"enabled": True, **read(node, keys)})
    change.on(Drive(True, 1.0, 1e4))  # checks the numbers
    return change


def _feed(node: YamlNode) -> Feed:
    return Feed(*one_of({"rate": raw_reader, "position": raw_reader})(node))


@dataclasses.dataclass(frozen=True)
class _MountEntry:
    position: float = key(raw_reader)
    velocity: float = key(raw_reader, 0.0)


def _mount(node: YamlNode) -> MountMotion:
    return MountMotion(**vars(read(node, _MountEntry)))


@dataclasses.dataclass(frozen=True)
class _CommandEntry:
    """Commands at one time of a command file."""

    time: float = key(ONSET)
    weight_on_bit: WeightOnBit | None = key(lambda node: WeightOnBit(node.value), None)
    drive: DriveChange | None = key(_drive, None)
    feed: Feed | None = key(_feed, None)
    mount: MountMotion | None = key(_mount, None)

    @property
    def planned(self) -> list[Change]:
        time = round(self.time * SECOND)
        found = [each for each in (self.weight_on_bit, self.drive, self.feed, self.mount) if each]
        return [Change(time, command) for command in found]

    def __post_init__(self) -> None:
        if not self.planned:
            raise ParameterError(
                "a command has a weight_on_bit, drive, feed or mount beside its time"
            )


def parse_commands(listed: YamlNode) -> tuple[Change, ...]:
    """Return the commands of a list in YAML, in the order of their times."""
    entries = list_of(_CommandEntry)(listed)
    return in_order(each for entry in entries for each in entry.planned)


@dataclasses.dataclass(frozen=True)
class _ScenarioFile:
    faults: tuple[YamlNode, ...] = key(list_of(node_reader))
    seed: int = key(SEED, 0)


@dataclasses.dataclass(frozen=True)
class _CommandFile(_ScenarioFile):
    faults: tuple[YamlNode, ...] = key(list_of(node_reader), ())
    commands: tuple[Change, ...] | None = key(parse_commands, None)


def read_scenario(path: str | Path, seed: int | None = None) -> tuple[Change, ...]:
    """Return the faults of a scenario file; a seed, zero or more, replaces the file's."""
    return scenario_at(open_yaml(path), seed)


def parse_scenario(content: Any, name: str) -> tuple[Change, ...]:
    return scenario_at(yaml_node(content, name))


def scenario_at(top: YamlNode, seed: int | None = None) -> tuple[Change, ...]:
    """Return the faults of a scenario from its top YAML node, with all values drawn.

    They are in the order of their onsets; faults of one kind on one channel do not overlap.
    """
    file = read(top, _ScenarioFile)
    if seed is not None:
        seed = dataclasses.replace(top.get("seed"), value=seed).check(SEED)
    return _faults(file.faults, file.seed if seed is None else seed)


def _faults(entries: Sequence[YamlNode], seed: int) -> tuple[Change, ...]:
    found = []
    for number, node in enumerate(entries, 1):
        entry = read(node, _FaultEntry)
        with node.errors():
            found.append((*entry.drawn(number, seed), number, node))
    found.sort(key=lambda item: item[0])
    latest: dict[tuple[str, str], tuple[int, int]] = {}
    for onset, action, number, node in found:
        fault = action.fault
        other, clear = latest.get((fault.kind, fault.channel), (0, 0))
        if onset < clear:
            raise node.error(f"{fault} begins while entry {other} is active")
        end = onset + action.duration if action.duration else NEVER
        latest[fault.kind, fault.channel] = (number, end)
    return tuple(Change(onset, action, node.prefix) for onset, action, _, node in found)


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
            raise ParameterError(f"--inject {short_repr(text)} gives a key twice")
        entries.append({"onset": 0.0, **dict(keys)})
    return PlannedChanges(scenario_at(yaml_node({"faults": entries}, "--inject")))


def read_commands(path: str | Path) -> PlannedChanges:
    """Return the changes of a command file: a scenario that may hold commands as well.

    Times count from the instant of the fork.
    """
    file = read(open_yaml(path), _CommandFile)
    planned = (*(file.commands or ()), *_faults(file.faults, file.seed))
    return PlannedChanges(in_order(planned), replaces_commands=file.commands is not None)
