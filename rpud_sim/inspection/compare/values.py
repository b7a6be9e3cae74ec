"""Quantities that runs are compared by, and their values in one run of a bag."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.bag import BagReader
from rpud_sim.bag.columns import Kind, usable
from rpud_sim.bag.messages import MessageBlock
from rpud_sim.bag.tables import Batch
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.inspection.output import Damages
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.pages.quantities import QUANTITIES as SHOWN
from rpud_sim.pages.quantities import Quantity
from rpud_sim.simulation.topics import TOPICS

MEAN, MEDIAN, P95 = "mean", "median", "p95"  # figures of a distribution
FIGURES = {MEAN: "mean", MEDIAN: "median", P95: "95 % quantile"}  # as people read them


@dataclass(frozen=True)
class ComparedQuantity:
    """Quantity of a run."""

    name: str  # of the quantity, and of its key in JSON
    unit: str  # SI unit
    topic: str  # relative name of its topic
    column: str = ""  # of the topic's table; empty if it is computed from impacts
    # figures that are compared; others would only repeat them
    tested: tuple[str, ...] = (MEAN, MEDIAN, P95)
    fewest: int = 40  # number of values below which nothing is decided
    resolution: float = 0.0  # size of the rounding of its values; smaller differences mean nothing

    @property
    def averaged(self) -> bool:
        """Whether its values are means over parts of the time, so that only their mean counts."""
        return self.tested == (MEAN,)

    @property
    def shown(self) -> Quantity:
        """How people read it."""
        return SHOWN[_SHOWN_AS.get(self.name, self.name)]


# Names in the table of quantities, where they differ from those in JSON.
_SHOWN_AS = {"energy": "impact_energy", "nodal_plane_position": "nodal_plane"}

# Relative names of the topics that are read.
IMPACTS, STATUS, FAULTS = "contact_force", "status", "faults"
_READ = (IMPACTS, FAULTS, "nodal_plane", "reacting_force", STATUS)

QUANTITIES = (
    # The mean of the intervals is one over the rate, so it is not tested again.
    ComparedQuantity("impact_rate", "1/s", IMPACTS, tested=(MEAN,)),
    ComparedQuantity("impact_interval", "s", IMPACTS, tested=(MEDIAN, P95)),
    ComparedQuantity("peak_force", "N", IMPACTS, "peak_force"),
    ComparedQuantity("impact_velocity", "m/s", IMPACTS, "impact_velocity"),
    ComparedQuantity("energy", "J", IMPACTS, "energy"),
    ComparedQuantity("contact_duration", "s", IMPACTS, "contact_duration"),
    ComparedQuantity("impact_power", "W", IMPACTS, tested=(MEAN,)),
    ComparedQuantity("reacting_force", "N", "reacting_force", "force"),
    ComparedQuantity("nodal_plane_position", "m", "nodal_plane", "position"),
    *(
        ComparedQuantity(name, unit, STATUS, name, (MEAN,), fewest=16, resolution=resolution)
        for name, unit, resolution in (
            ("penetration_rate", "m/s", 1e-12),
            ("electrical_power", "W", 1e-9),
            ("actuator_power", "W", 1e-9),
            ("weight_power", "W", 1e-9),
            ("load_damper_power", "W", 1e-9),
            ("collision_power", "W", 1e-9),
            ("absorbed_power", "W", 1e-9),
        )
    ),
)

# Fields of a status about timing, which belong to the machine and are never tested.
TIMING = (
    ("lateness_max", "latest block", "s"),
    ("lag", "lag behind the schedule", "s"),
    ("real_time_factor", "real-time factor", ""),
)

# Fields of a status that count since the start.
COUNTERS = (
    ("deadlines_missed", "deadlines missed"),
    ("messages_dropped", "messages dropped"),
    ("commands_rejected", "commands refused"),
)

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


class ValueReader:
    """Reader of the values of one run from the blocks of its bag."""

    def __init__(self, bag: BagReader, drill: RecordedDrill, damages: Damages) -> None:
        self._bag = bag
        self._drill = drill
        self._damages = damages
        self._names = dict(_wanted(bag, drill))  # relative names of topics
        self._tables = bag.tables.choose(self._names)
        self._parts: dict[str, list[Arrays]] = {}
        self._faults: dict[int, RecordedFault] | None = None

    @property
    def topics(self) -> set[str]:
        return {*self._names}

    def add(self, block: MessageBlock) -> None:
        if block.topic not in self._names:
            return
        name, tables = self._names[block.topic], {block.topic: self._tables[block.topic]}
        for batch in self._bag.tables.batches(tables, [block], self._damages.add):
            if name == FAULTS:
                self._faults = {**(self._faults or {}), **_faults(batch, self._drill)}
            else:
                self._parts.setdefault(name, []).append(_rows(batch, self._drill, name))

    def values(self) -> RecordedValues:
        """Return the values of all blocks that were added."""
        topics = {
            name: {key: np.concatenate([part[key] for part in found]) for key in found[0]}
            for name, found in self._parts.items()
        }
        return RecordedValues(self._drill, topics, self._faults, self._damages.texts)


def _wanted(bag: BagReader, drill: RecordedDrill) -> Iterator[tuple[str, str]]:
    """Yield the topics of a drill with usable values: names in the bag, and relative ones."""
    types = {drill.topic(name): TOPICS[name].type for name in _READ}
    for summary in bag.readable_topics:
        full = summary.topic.name
        if types.get(full) != summary.topic.type or full in bag.left_out:
            continue
        kinds = {column.name: column.kind for column in bag.columns(full)}
        name = full.removeprefix(drill.prefix)
        if kinds.get("header.stamp") is Kind.TIME and (
            name != IMPACTS or kinds.get("sequence") is Kind.NUMBER
        ):
            yield full, name


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
    first, last = drill.bounds
    columns = batch.columns
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


def series_of(
    values: RecordedValues, quantity: ComparedQuantity, begin: float, end: float
) -> np.ndarray | None:
    """Return the values of a quantity between two simulation times [s], in order; None without."""
    name = quantity.name
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
        return np.asarray(steps[np.diff(arrays["sequence"][first:last]) == 1])
    if quantity.column not in arrays:
        return None
    # A report of powers is the mean of the second before it.
    if quantity.topic == STATUS:
        times = arrays["time"]
        first, last = np.searchsorted(times, [begin + 1.0 - 1e-9, end + 1e-9])
        # The drill does not move as long as the time of its status stays.
        first = max(first, int(np.searchsorted(times, times[:1].sum(), side="right")))
    found = arrays[quantity.column][first:last]
    found = found[np.isfinite(found)]
    return found if len(found) else None


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
