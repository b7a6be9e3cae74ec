"""Values of one run, read from its bag in one pass: impacts, motion, powers, timing and faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.bag import BagReader
from rpud_sim.bag.columns import Kind, usable
from rpud_sim.bag.tables import Batch
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.compare.quantities import (
    COUNTERS,
    IMPACTS,
    QUANTITIES,
    STATUS,
    TIMING,
    TYPES,
)
from rpud_sim.inspection.output import Damages
from rpud_sim.inspection.recorded_drill import RecordedDrill

FAULTS = "faults"
_FAULTS_TYPE = "rpud_msgs/msg/Faults"

Arrays = dict[str, np.ndarray]


@dataclass(frozen=True)
class RecordedFault:
    """Fault of a run, from its ground truth."""

    number: int  # of the fault
    text: str  # kind, channel and magnitude
    onset: float  # simulation time at which it began [s]
    clear: float | None  # simulation time at which it ended [s]; None while it lasts


@dataclass
class RecordedValues:
    """Values of a run."""

    drill: RecordedDrill  # the run
    # arrays of each topic by its relative name: ``time`` is simulation time [s]; the others
    # are columns, with NaN where a value is not usable
    topics: dict[str, Arrays] = field(default_factory=dict)
    # by their numbers; None if the bag has no topic of faults
    faults: dict[int, RecordedFault] | None = None
    # amount and reason of the damaged parts that were skipped, by topic or record
    damaged: dict[str, str] = field(default_factory=dict)

    @property
    def begin(self) -> float:
        """Simulation time of the first value of any topic [s]; NaN if there are none."""
        return min((float(a["time"][0]) for a in self._filled()), default=math.nan)

    @property
    def end(self) -> float:
        """Simulation time of the last value of any topic [s]; NaN if there are none."""
        return max((float(a["time"][-1]) for a in self._filled()), default=math.nan)

    @property
    def missing_impacts(self) -> int:
        """Number of impacts that the bag lacks, by their sequence."""
        arrays = self.topics.get(IMPACTS)
        if arrays is None or not len(arrays["sequence"]):
            return 0
        numbers = np.unique(arrays["sequence"])  # damaged bags repeat and mix them
        return int(numbers[-1]) - int(numbers[0]) + 1 - len(numbers)

    def _filled(self) -> list[Arrays]:
        # A latched status may be older than the run's other messages.
        found = [a for name, a in self.topics.items() if len(a["time"]) and name != STATUS]
        return found or [a for a in self.topics.values() if len(a["time"])]


def read_values(
    bag: BagReader,
    drill: RecordedDrill,
    damages: Damages,
    report: Callable[[int], object] = lambda messages: None,
) -> RecordedValues:
    """Read the values of a run."""
    wanted = _wanted(bag, drill)
    parts: dict[str, list[Arrays]] = {name: [] for name in wanted.values()}
    faults: dict[int, RecordedFault] | None = None
    for batch in bag.batches([*wanted], leave_out=damages.add):
        name = wanted[batch.topic]
        if name == FAULTS:
            faults = {**(faults or {}), **_faults(batch, drill)}
        else:
            parts[name].append(_rows(batch, drill, name))
        report(batch.message_count)
    topics = {
        name: {key: np.concatenate([part[key] for part in found]) for key in found[0]}
        for name, found in parts.items()
        if found
    }
    return RecordedValues(drill, topics, faults, damages.texts)


def _wanted(bag: BagReader, drill: RecordedDrill) -> dict[str, str]:
    types = {**TYPES, FAULTS: _FAULTS_TYPE}
    found = {}
    for summary in bag.readable_topics:
        full = summary.topic.name
        name = full.removeprefix(f"{drill.namespace}/")
        if full == drill.topic(name) and types.get(name) == summary.topic.type:
            if full in bag.left_out:
                continue
            held = {column.name for column in bag.columns(full) if column.kind is Kind.NUMBER}
            times = {column.name for column in bag.columns(full) if column.kind is Kind.TIME}
            if "header.stamp" in times and (name != IMPACTS or "sequence" in held):
                found[full] = name
    return found


def _rows(batch: Batch, drill: RecordedDrill, name: str) -> Arrays:
    columns = batch.columns
    published = columns["publish_time"]
    first, last = drill.bounds
    own = (published >= first) & (published <= last)
    times = drill.clock.elapsed(columns["header.stamp"], published)
    own &= times >= 0
    wanted = [q.column for q in QUANTITIES if q.topic == name and q.column in columns]
    if name == STATUS:
        wanted += [key for key, *_ in (*TIMING, *COUNTERS) if key in columns]
    found: Arrays = {"time": times[own]}
    if name == IMPACTS:
        found["sequence"] = columns["sequence"][own].astype(np.int64)
    for key in wanted:
        values = columns[key][own].astype(float)
        found[key] = np.where(usable(values), values, np.nan)
    return found


def _faults(batch: Batch, drill: RecordedDrill) -> dict[int, RecordedFault]:
    found = {}
    columns = batch.columns
    first, last = drill.bounds
    for published, states in zip(columns["publish_time"], columns["faults"], strict=True):
        if not first <= published <= last:
            continue
        for state in states:
            try:
                fault = _fault(state, int(published), drill)
            except (KeyError, TypeError, ValueError):  # another type of the same name
                continue
            found[fault.number] = fault
    return found


def _fault(state: Mapping[str, Any], published: int, drill: RecordedDrill) -> RecordedFault:
    def since(moment: Mapping[str, int]) -> float:
        stamp = join_seconds(moment["sec"], moment["nanosec"])
        return (stamp - drill.clock.offset(published)) / SECOND

    magnitude = float(state["magnitude"])
    words = [str(state["kind"])[:40]]
    if state["channel"]:
        words.append(f"of {state['channel']!s:.80}")
    if math.isfinite(magnitude):
        words.append(f"magnitude {magnitude:g}")
    return RecordedFault(
        int(state["number"]),
        " ".join(words),
        since(state["onset"]),
        None if state["active"] else since(state["clear"]),
    )


def series_of(values: RecordedValues, name: str, begin: float, end: float) -> np.ndarray | None:
    """Return the values of a quantity between two simulation times [s], in order; None without."""
    quantity = next(q for q in QUANTITIES if q.name == name)
    arrays = values.topics.get(quantity.topic)
    if arrays is None:
        return None
    first, last = np.searchsorted(arrays["time"], [begin, end])
    if name == "impact_rate":
        return _rates(arrays, begin, end, None)
    if name == "impact_power":
        return _rates(arrays, begin, end, "energy") if "energy" in arrays else None
    if name == "impact_interval":
        steps = np.diff(arrays["time"][first:last])
        return steps[np.diff(arrays["sequence"][first:last]) == 1]
    if quantity.column not in arrays:
        return None
    # A report of powers is the mean of the second before it.
    if quantity.topic == STATUS:
        first, last = np.searchsorted(arrays["time"], [begin + 1.0 - 1e-9, end + 1e-9])
        first = max(first, _first_change(arrays["time"]))
    found = arrays[quantity.column][first:last]
    found = found[np.isfinite(found)]
    return found if len(found) else None


def _first_change(times: np.ndarray) -> int:
    """Return the row after which a status is of a drill that moves: its time goes on."""
    return int(np.searchsorted(times, times[0], side="right")) if len(times) else 0


def _rates(arrays: Arrays, begin: float, end: float, column: str | None) -> np.ndarray | None:
    times = arrays["time"]
    first, last = np.searchsorted(times, [begin, end])
    count = int(last - first)
    if not end > begin or not len(times):
        return None
    edges = np.linspace(begin, end, int(min(max(count // 4, 4), 2000)) + 1)
    width = (end - begin) / (len(edges) - 1)
    places = np.searchsorted(times, edges)
    if column is not None:
        sums = np.append(0.0, np.cumsum(np.nan_to_num(arrays[column])))
        return np.diff(sums[places]) / width
    # Numbers also count impacts that the bag lacks.
    numbers = np.append(arrays["sequence"], arrays["sequence"][-1] + 1)
    return np.diff(numbers[places]) / width
