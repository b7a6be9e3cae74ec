"""Scenarios: YAML files of faults that begin by themselves, some of their values drawn."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError, Quantity, shown
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.simulation.faults import KINDS, Fault, FaultError, number_of

GREATEST_SEED = 2**63 - 1  # what a ROS parameter holds

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


@dataclasses.dataclass(frozen=True)
class Scenario:
    """Faults of a scenario file, with all values drawn."""

    seed: int  # with which it was drawn
    # in the order of their onsets; those of one kind on one channel do not overlap. If one
    # ends at the instant at which another begins, it ends first.
    faults: tuple[ScheduledFault, ...]


def read_scenario(path: str | Path, seed: int | None = None) -> Scenario:
    """Read a scenario file.

    Args:
        seed: in place of the file's, zero or more.
    """
    try:
        # Without truth values: in a scenario, off is a kind of fault.
        parsed = read_yaml(path, truth_values=False)
    except ParameterError as error:
        raise FaultError(str(error)) from None
    return parse_scenario(parsed, str(path), seed)


def parse_scenario(content: Any, name: str, seed: int | None = None) -> Scenario:
    """Return the scenario of a file's content.

    Raises:
        FaultError: if the content is no scenario; one line with name and number of the entry.
    """
    if not isinstance(content, Mapping):
        raise FaultError(f"{name} is not a scenario: it holds no mapping")
    for key in content:
        if key not in ("seed", "faults"):
            raise FaultError(f"{name}: {shown(key)} is not one of seed, faults")
    written = _checked_seed(content.get("seed", 0), name)
    seed = written if seed is None else _checked_seed(seed, name)
    entries = content.get("faults")
    if not isinstance(entries, list):
        raise FaultError(f"{name}: faults = {shown(entries)} is not a list")
    found: list[tuple[int, ScheduledFault]] = []
    for number, entry in enumerate(entries, 1):
        place = f"{name}: entry {number}: "
        try:
            scheduled = _scheduled(entry, number, seed)
        except ParameterError as error:
            raise FaultError(f"{place}{error}") from None
        found.append((number, dataclasses.replace(scheduled, place=place)))
    found.sort(key=lambda item: item[1].onset)
    _check_overlaps(found, name)
    return Scenario(seed, tuple(scheduled for _, scheduled in found))


def _checked_seed(seed: Any, name: str) -> int:
    if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed <= GREATEST_SEED:
        raise FaultError(
            f"{name}: seed = {shown(seed)} is not a whole number in its range [0, {GREATEST_SEED}]"
        )
    return seed


def _scheduled(entry: Any, number: int, seed: int) -> ScheduledFault:
    if not isinstance(entry, Mapping):
        raise FaultError(f"{shown(entry)} is not a mapping")
    for key in entry:
        if key not in _KEYS:
            raise FaultError(f"{shown(key)} is not one of {', '.join(_KEYS)}")
    for key in ("kind", "onset"):
        if key not in entry:
            raise FaultError(f"{key} is missing")
    kind, channel = entry["kind"], entry.get("channel", "")
    known = Fault(kind, channel)  # checks the names before the numbers
    # A stream of its own for each number: changing one entry changes no other.
    streams = {
        key: np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(number, index)))
        for index, key in enumerate(_DRAWN)
    }
    onset = _drawn("onset", entry["onset"], ONSET, streams["onset"])
    start = round(onset * SECOND)
    clear = None
    if "duration" in entry:
        duration = _drawn("duration", entry["duration"], DURATION, streams["duration"])
        clear = start + round(duration * SECOND)
    magnitude = entry.get("magnitude", math.nan)
    quantity = KINDS[kind].quantity_on(channel)
    if not (quantity is None or _is_nan(magnitude)):
        magnitude = _drawn(f"magnitude of {known}", magnitude, quantity, streams["magnitude"])
    return ScheduledFault(start, clear, Fault(kind, channel, magnitude))


def _is_nan(value: Any) -> bool:
    return isinstance(value, float) and math.isnan(value)


def _drawn(name: str, value: Any, quantity: Quantity, random: np.random.Generator) -> float:
    """Return the number of an entry, or one drawn between its two bounds."""
    if not isinstance(value, Mapping):
        return quantity.check(name, _finite(name, value))
    bounds = value.get("uniform")
    if set(value) != {"uniform"} or not (isinstance(bounds, list) and len(bounds) == 2):
        raise FaultError(f"{name} = {shown(value)} is neither a number nor uniform: [least, most]")
    least, most = (quantity.check(f"{name}, uniform,", _finite(name, bound)) for bound in bounds)
    if not least <= most:
        raise FaultError(f"{name} = uniform: [{least:g}, {most:g}] has its least above its most")
    return least + (most - least) * float(random.random())


def _finite(name: str, value: Any) -> float:
    number = number_of(value)
    if number is None or math.isnan(number):
        raise FaultError(f"{name} = {shown(value)} is not a number")
    return number


def _check_overlaps(found: list[tuple[int, ScheduledFault]], name: str) -> None:
    latest: dict[tuple[str, str], tuple[int, int | None]] = {}
    for number, scheduled in found:
        fault = scheduled.fault
        key = (fault.kind, fault.channel)
        other, clear = latest.get(key, (0, 0))
        if clear is None or scheduled.onset < clear:
            raise FaultError(
                f"{name}: entry {number}: {fault} begins while that of entry {other} lasts"
            )
        latest[key] = (number, scheduled.clear)
