"""Quantities that runs are compared by, and their values in one run of a bag."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagReader
from rpud_sim.bag.columns import Kind, usable
from rpud_sim.bag.tables import Tables
from rpud_sim.foundation.shown_quantities import QUANTITIES as SHOWN
from rpud_sim.foundation.shown_quantities import ShownQuantity
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.recorded.output import Damages
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.recorded.streams import TopicStream, TopicStreams
from rpud_sim.simulation.fault_kinds import fault_text
from rpud_sim.simulation.topics import TOPICS

MEAN, MEDIAN, P95 = "mean", "median", "p95"  # figures of a distribution
FIGURES = {MEAN: "mean", MEDIAN: "median", P95: "95 % quantile"}  # as people read them

# Relative names of the topics that are read.
IMPACTS, STATUS, FAULTS = "contact_force", "status", "faults"
_POWER, _TIMING = "power", "timing"
_REPORTS = (STATUS, _POWER, _TIMING)
_READ = (IMPACTS, FAULTS, "nodal_plane", "reacting_force", *_REPORTS)


class ComparedQuantity(NamedTuple):
    """Quantity of a run."""

    name: str  # of the quantity, and of its key in JSON
    topic: str  # relative name of its topic
    column: str = ""  # of the topic's table; empty if it is computed from impacts
    # figures that are compared; others would only repeat them
    tested: tuple[str, ...] = (MEAN, MEDIAN, P95)
    fewest: int = 40  # number of values below which nothing is decided
    resolution: float = 0.0  # size of the rounding of its values; smaller differences mean nothing

    @property
    def unit(self) -> str:
        """SI unit."""
        return shown(self.name).si

    @property
    def averaged(self) -> bool:
        """Whether its values are means over parts of the time, so that only their mean counts."""
        return self.tested == (MEAN,)


def _mean(name: str, topic: str = _POWER, resolution: float = 1e-9) -> ComparedQuantity:
    return ComparedQuantity(name, topic, name, (MEAN,), 16, resolution)


QUANTITIES = (
    # The mean of the intervals is one over the rate, so it is not tested again.
    ComparedQuantity("impact_rate", IMPACTS, tested=(MEAN,)),
    ComparedQuantity("impact_interval", IMPACTS, tested=(MEDIAN, P95)),
    ComparedQuantity("peak_force", IMPACTS, "peak_force"),
    ComparedQuantity("impact_velocity", IMPACTS, "impact_velocity"),
    ComparedQuantity("energy", IMPACTS, "energy"),
    ComparedQuantity("contact_duration", IMPACTS, "contact_duration"),
    ComparedQuantity("impact_power", IMPACTS, tested=(MEAN,)),
    ComparedQuantity("reacting_force", "reacting_force", "force"),
    ComparedQuantity("nodal_plane_position", "nodal_plane", "position"),
    _mean("penetration_rate", STATUS, 1e-12),
    _mean("electrical_power", STATUS),
    _mean("actuator_power"),
    _mean("weight_power"),
    _mean("load_damper_power"),
    _mean("collision_power"),
    _mean("absorbed_power"),
)


def shown(quantity: str) -> ShownQuantity:
    """Return how people read a quantity, by its name."""
    names = {"energy": "impact_energy", "nodal_plane_position": "nodal_plane"}
    return SHOWN[names.get(quantity, quantity)]


# Fields about timing, which belong to the machine and are never tested.
TIMING = ("lateness_max", "lag", "real_time_factor")
# Fields that count since the start.
COUNTERS = ("deadlines_missed", "messages_dropped", "commands_rejected")

Arrays = dict[str, np.ndarray]


class RecordedFault(NamedTuple):
    """Fault of a run, from its ground truth."""

    onset: float  # simulation time at which it began [s]
    number: int  # of the fault
    text: str  # kind, channel and magnitude
    clear: float | None  # simulation time at which it ended [s]; None while it lasts


@dataclass
class RecordedValues:
    """Values of a run."""

    drill: RecordedRun  # the run
    # arrays of each topic by its relative name: ``time`` is simulation time [s]; the others
    # are columns, with NaN where a value is not usable
    topics: dict[str, Arrays] = field(default_factory=dict)
    faults: dict[int, RecordedFault] = field(default_factory=dict)  # by their numbers
    # amount and reason of the damaged parts that were skipped, by topic or record
    damaged: dict[str, str] = field(default_factory=dict)

    @property
    def span(self) -> str:
        """Begin and end as people read them; empty if no message shows its time."""
        return f"{self.begin:.6g} to {self.end:.6g} s" if np.isfinite(self.begin) else ""

    @property
    def begin(self) -> float:
        """Simulation time of the first value of any topic [s]; NaN if there are none."""
        return min((float(times[0]) for times in self._times()), default=math.nan)

    @property
    def end(self) -> float:
        """Simulation time of the last value of any topic [s]; NaN if there are none."""
        return max((float(times[-1]) for times in self._times()), default=math.nan)

    @property
    def missing_impacts(self) -> int:
        """Number of impacts that the bag lacks, by their sequence."""
        numbers = np.unique(self.topics.get(IMPACTS, {}).get("sequence", np.empty(0)))
        # Damaged bags repeat and mix them.
        return int(numbers[-1]) - int(numbers[0]) + 1 - len(numbers) if len(numbers) else 0

    @property
    def timing(self) -> dict[str, Any]:
        """``runs[].timing`` of the JSON: of the machine, not of the drill."""
        held = {
            name: self.holding(name, _TIMING).get(name, np.empty(0))
            for name in (*TIMING, *COUNTERS)
        }
        known = {name: values[np.isfinite(values)] for name, values in held.items()}
        return {
            **{
                word: {n: figure(known[n]) if len(known[n]) else math.nan for n in TIMING}
                for word, figure in (("greatest", np.max), ("median", np.median))
            },
            **{name: int(known[name][-1]) if len(known[name]) else None for name in COUNTERS},
        }

    def holding(self, column: str, topic: str) -> Arrays:
        """Return the arrays of a topic with a column; before 0.3 the status had all of reports."""
        own = self.topics.get(topic, {})
        return own if column in own else self.topics.get(STATUS, {})

    def _times(self) -> list[np.ndarray]:
        held = {name: a["time"] for name, a in self.topics.items() if len(a["time"])}
        # A latched report may be older than the run's other messages.
        return [times for name, times in held.items() if name not in _REPORTS] or [*held.values()]


class OpenRun(NamedTuple):
    """Run of a bag that is read."""

    bag: BagReader
    drill: RecordedRun
    damages: Damages
    recorded: TopicStreams  # for all readers of the bag


def value_readers(
    run: OpenRun, values: RecordedValues, report: Callable[[int], object]
) -> Iterator[tuple[Iterator[object], Sequence[TopicStream]]]:
    """Yield a reader for each topic, for ``read_together``."""
    tables = Tables(run.bag.path, run.bag.readable_topics, {})
    for name in _READ:
        full = run.drill.topic(name)
        if _usable_topic(run.bag, full):
            stream = run.recorded.stream(full)
            yield _read(run, name, tables, stream, values, report), (stream,)


def _read(
    run: OpenRun,
    name: str,
    tables: Tables,
    stream: TopicStream,
    values: RecordedValues,
    report: Callable[[int], object],
) -> Iterator[None]:
    """Read a topic into the values."""
    full = run.drill.topic(name)
    chosen = tables.choose([full])
    parts = []
    for batches in stream:
        report(sum(map(len, batches)))
        for batch in tables.batches(chosen, batches, run.damages.add):
            published = batch.columns["publish_time"]
            times = (batch.columns["header.stamp"] - run.drill.origins(published)) / SECOND
            own = run.drill.holds(published)
            if name == FAULTS:
                values.faults |= {f.number: f for f in _faults(batch.columns, own, run.drill)}
            else:
                parts.append(_rows(batch.columns, own & (times >= 0), times, name))
        yield
    if parts:
        values.topics[name] = {
            key: np.concatenate([part.pop(key) for part in parts]) for key in [*parts[0]]
        }


def _usable_topic(bag: BagReader, full: str) -> bool:
    """Whether a bag has messages of a topic with stamps, and of impacts with their numbers."""
    name = full.rpartition("/")[2]
    held = {s.topic.name: s.topic.type for s in bag.readable_topics if s.message_count}
    if held.get(full) != TOPICS[name].type or full in bag.left_out:
        return False
    kinds = {column.name: column.kind for column in bag.columns(full)}
    numbered = name != IMPACTS or kinds.get("sequence") is Kind.NUMBER
    return kinds.get("header.stamp") is Kind.TIME and numbered


def _rows(
    columns: Mapping[str, np.ndarray], own: np.ndarray, times: np.ndarray, name: str
) -> Arrays:
    wanted = [q.column for q in QUANTITIES if q.topic == name or {q.topic, name} <= {*_REPORTS}]
    found = {"time": times[own]}
    if name == IMPACTS:
        found["sequence"] = columns["sequence"][own].astype(np.int64)
    for key in (*wanted, *((*TIMING, *COUNTERS) if name in _REPORTS else ())):
        if key in columns:
            values = columns[key][own].astype(float)
            found[key] = np.where(usable(values), values, np.nan)
    return found


def _faults(
    columns: Mapping[str, np.ndarray], own: np.ndarray, drill: RecordedRun
) -> Iterator[RecordedFault]:
    for published, states in zip(columns["publish_time"][own], columns["faults"][own], strict=True):
        for state in states:
            try:
                [origin] = drill.origins(np.array([published]))
                yield _fault(state, int(origin))
            except (KeyError, TypeError, ValueError):  # another type of the same name
                continue


def _fault(state: Mapping[str, Any], origin: int) -> RecordedFault:
    def since(moment: Mapping[str, int]) -> float:
        return (join_seconds(moment["sec"], moment["nanosec"]) - origin) / SECOND

    magnitude = float(state["magnitude"])
    text = fault_text(str(state["kind"])[:40], str(state["channel"])[:80])
    text += f" magnitude {magnitude:g}" if math.isfinite(magnitude) else ""
    clear = None if state["active"] else since(state["clear"])
    return RecordedFault(since(state["onset"]), int(state["number"]), text, clear)


def series_of(
    values: RecordedValues, quantity: ComparedQuantity, begin: float, end: float
) -> np.ndarray | None:
    """Return the values of a quantity between two simulation times [s], in order; None without."""
    arrays = values.topics.get(quantity.topic)
    if quantity.topic in _REPORTS:
        arrays = values.holding(quantity.column, quantity.topic)
    if not arrays:
        return None
    times = arrays["time"]
    first, last = np.searchsorted(times, [begin, end])
    if quantity.name == "impact_interval":
        steps = np.diff(times[first:last])
        return np.asarray(steps[np.diff(arrays["sequence"][first:last]) == 1])
    if quantity.name in ("impact_rate", "impact_power"):
        return _rates(arrays, begin, end, quantity.name == "impact_power")
    if quantity.column not in arrays:
        return None
    # A report of powers is the mean of the second before it.
    if quantity.topic in _REPORTS:
        first, last = np.searchsorted(times, [begin + 1.0 - 1e-9, end + 1e-9])
        # The drill does not move as long as the time of its status stays.
        first = max(first, int(np.searchsorted(times, times[:1].sum(), side="right")))
    found = arrays[quantity.column][first:last]
    found = found[np.isfinite(found)]
    return found if len(found) else None


def _rates(arrays: Arrays, begin: float, end: float, power: bool) -> np.ndarray | None:
    """Return impacts or their energy per time in equal parts of a window."""
    times = arrays["time"]
    if not end > begin or not len(times) or (power and "energy" not in arrays):
        return None
    count = int(np.diff(np.searchsorted(times, [begin, end]))[0])
    edges = np.linspace(begin, end, int(min(max(count // 4, 4), 2000)) + 1)
    # Numbers also count impacts that the bag lacks.
    sums = np.append(arrays["sequence"], arrays["sequence"][-1] + 1)
    if power:
        sums = np.append(0.0, np.cumsum(np.nan_to_num(arrays["energy"])))
    return np.diff(sums[np.searchsorted(times, edges)]) / ((end - begin) / (len(edges) - 1))
