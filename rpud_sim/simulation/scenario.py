"""Scenarios: YAML files of faults that begin by themselves, some of their values drawn."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import Quantity, shown
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import Cursor, cursor_at, open_yaml
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault, FaultError

SEED = Quantity("", "seed of the values that are drawn", 0.0, 2.0**63, below=True, whole=True)
ONSET = Quantity("s", "simulation time at which a fault begins", 0.0, 1e6)
DURATION = Quantity("s", "time for which it lasts", 1e-9, 1e6)

_DRAWN = ("onset", "duration", "magnitude")
_KEYS = ("kind", "channel", *_DRAWN)


@dataclasses.dataclass(frozen=True)
class ScheduledFault:
    """Fault with its onset and its end."""

    onset: int  # simulation time at which it begins [ns]
    clear: int | None  # simulation time at which it ends, None if it does not end by itself [ns]
    fault: Fault  # that begins
    # file and entry, with a colon; an error message begins with it
    place: str = dataclasses.field(default="", compare=False)

    @property
    def duration(self) -> int:
        """Time for which it lasts [ns]; 0 if it does not end by itself."""
        return 0 if self.clear is None else self.clear - self.onset


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Faults of a scenario file, with all values drawn."""

    seed: int  # with which it was drawn
    # in the order of their onsets; those of one kind on one channel do not overlap. If one
    # ends at the instant at which another begins, it ends first.
    faults: tuple[ScheduledFault, ...]


def scenario_of(settings: Settings, seed: int | None = None) -> Scenario | None:
    """Read the scenario of settings; a seed, theirs if it is zero, takes the place of its own."""
    if not settings.scenario:
        return None
    return read_scenario(settings.scenario, seed or settings.seed or None)


def read_scenario(path: str | Path, seed: int | None = None) -> Scenario:
    """Read a scenario file; a seed, zero or more, takes the place of the file's."""
    # Without truth values: in a scenario, off is a kind of fault.
    return _scenario(open_yaml(path, truth_values=False, error=FaultError), seed)


def parse_scenario(content: Any, name: str, seed: int | None = None) -> Scenario:
    return _scenario(cursor_at(content, name, FaultError), seed)


def _scenario(top: Cursor, seed: int | None) -> Scenario:
    top.file_mapping("a scenario")
    top.mapping(("seed", "faults"))
    written = top.get("seed", 0).check(SEED)
    seed = written if seed is None else replace(top.get("seed"), value=seed).check(SEED)
    found = []
    for number, entry in enumerate(top.get("faults").sequence("entry {number}"), 1):
        with entry.errors():
            found.append((number, _scheduled(entry, number, seed)))
    found.sort(key=lambda item: item[1].onset)
    latest: dict[tuple[str, str], tuple[int, int | None]] = {}
    for number, scheduled in found:
        fault = scheduled.fault
        other, clear = latest.get((fault.kind, fault.channel), (0, 0))
        if clear is None or scheduled.onset < clear:
            raise FaultError(f"{scheduled.place}{fault} begins while that of entry {other} lasts")
        latest[fault.kind, fault.channel] = (number, scheduled.clear)
    return Scenario(seed, tuple(scheduled for _, scheduled in found))


def _scheduled(entry: Cursor, number: int, seed: int) -> ScheduledFault:
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
    clear = None
    if "duration" in values:
        clear = onset + round(drawn("duration", DURATION) * SECOND)
    magnitude = values.get("magnitude", math.nan)
    quantity = KINDS[kind].quantity_on(channel)
    if not (quantity is None or (isinstance(magnitude, float) and math.isnan(magnitude))):
        magnitude = drawn("magnitude", quantity, f"magnitude of {known}")
    return ScheduledFault(onset, clear, Fault(kind, channel, magnitude), entry.prefix)
