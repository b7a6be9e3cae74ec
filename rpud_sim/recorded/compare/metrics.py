"""Metrics of a recorded run, and their differences between two runs with intervals.

Impacts that follow each other depend on each other, so the spread of single values is too small
of the error of their mean. Metrics of equal parts of the time hardly depend on each other: the
error of a metric comes from their spread (batch means; for quantiles, sectioning).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import BagReader
from rpud_sim.foundation.extras import import_extra
from rpud_sim.foundation.shown_quantities import QUANTITIES as SHOWN
from rpud_sim.foundation.shown_quantities import ShownQuantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.columns import Kind, usable
from rpud_sim.recorded.output import SkippedParts
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.simulation.topics import TOPICS

LEVEL = 0.95  # probability that all intervals of a comparison hold together
_BATCHES = 16  # parts of the time whose metrics are independent
_FEWEST = 40  # impacts or samples below which there is no interval
_AVERAGED = 1.0  # a report of a power is the mean of this time before it [s]
_ROUNDING = 1e-9  # relative; smaller differences come from the rounding of numbers

_IMPACTS, _REPORTS = "contact_force", ("status", "power")
_RATE, _POWER, _MEAN, _P95 = "rate", "power", "mean", "95 % quantile"

# Results of a metric.
DIFFERS, SAME, NONE_FOUND, UNDECIDED, TOO_FEW = (
    *("differs", "within tolerance", "no difference found", "undecided", "too few values"),
)


class ComparedMetric(NamedTuple):
    """Metric that runs are compared by."""

    quantity: str  # its name, also in JSON
    statistic: str  # of the quantity
    topic: str  # relative name of the topic that has it
    column: str

    @property
    def shown(self) -> ShownQuantity:
        """How people read the quantity."""
        names = {"energy": "impact_energy", "nodal_plane_position": "nodal_plane"}
        return SHOWN[names.get(self.quantity, self.quantity)]


_SAMPLED = (
    *((name, _IMPACTS, name) for name in ("peak_force", "impact_velocity", "energy")),
    ("contact_duration", _IMPACTS, "contact_duration"),
    ("reacting_force", "reacting_force", "force"),
    ("nodal_plane_position", "nodal_plane", "position"),
)
_POWERS = ("actuator", "weight", "load_damper", "collision", "absorbed")
METRICS = (
    ComparedMetric("impact_rate", _RATE, _IMPACTS, "sequence"),
    ComparedMetric("impact_power", _POWER, _IMPACTS, "energy"),
    *(ComparedMetric(name, each, *at) for name, *at in _SAMPLED for each in (_MEAN, _P95)),
    *(ComparedMetric(n, _MEAN, "status", n) for n in ("penetration_rate", "electrical_power")),
    *(ComparedMetric(f"{n}_power", _MEAN, "power", f"{n}_power") for n in _POWERS),
)
COMPARED_QUANTITIES = tuple(dict.fromkeys(metric.quantity for metric in METRICS))


@dataclass
class RecordedValues:
    """Values of a run: columns of each topic by its relative name, ``time`` in simulation time."""

    drill: RecordedRun
    topics: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)

    @property
    def begin(self) -> float:
        """Simulation time of the first value [s]; NaN if there are none."""
        return min((float(times[0]) for times in self._times()), default=math.nan)

    @property
    def end(self) -> float:
        """Simulation time of the last value [s]; NaN if there are none."""
        return max((float(times[-1]) for times in self._times()), default=math.nan)

    @property
    def span(self) -> str:
        """Begin and end as people read them; empty if no message shows its time."""
        return f"{self.begin:.6g} to {self.end:.6g} s" if math.isfinite(self.begin) else ""

    @property
    def missing_impacts(self) -> int:
        """Number of impacts that the bag lacks, by their sequence."""
        numbers = np.unique(self.topics.get(_IMPACTS, {}).get("sequence", np.empty(0)))
        return int(numbers[-1] - numbers[0]) + 1 - len(numbers) if len(numbers) else 0

    def _times(self) -> list[np.ndarray]:
        held = {name: found["time"] for name, found in self.topics.items() if len(found["time"])}
        # A latched report may be older than the run's other messages.
        return [times for name, times in held.items() if name not in _REPORTS] or [*held.values()]


def read_values(
    bag: BagReader, drill: RecordedRun, damages: SkippedParts, report: Callable[[int], object]
) -> RecordedValues:
    """Return the values of a run in a bag."""
    wanted = {drill.topic(metric.topic): metric.topic for metric in METRICS}
    chosen = [full for full, name in wanted.items() if _has_times(bag, full, name)]
    parts: dict[str, list[dict[str, np.ndarray]]] = {}
    for batch in bag.tables(chosen, leave_out=damages.add) if chosen else ():
        report(batch.message_count)
        published, name = batch.columns["publish_time"], wanted[batch.topic]
        times = (batch.columns["header.stamp"] - drill.origins(published)) / SECOND
        own = drill.holds(published) & (times >= 0.0)
        found = {"time": times[own]}
        for column in {m.column for m in METRICS if m.topic == name} & {*batch.columns}:
            values = batch.columns[column][own].astype(float)
            found[column] = np.where(usable(values), values, np.nan)
        parts.setdefault(name, []).append(found)
    topics = {}
    for name, held in parts.items():
        joined = {key: np.concatenate([part[key] for part in held]) for key in held[0]}
        order = np.argsort(joined["time"], kind="stable")  # a damaged bag may mix them
        topics[name] = {key: values[order] for key, values in joined.items()}
    return RecordedValues(drill, topics)


def _has_times(bag: BagReader, full: str, name: str) -> bool:
    """Whether a bag has messages of a topic of the drill with stamps, and impacts with numbers."""
    held = {s.topic.name: s.topic.type for s in bag.readable_topics if s.message_count}
    if held.get(full) != TOPICS[name].type or full in bag.left_out:
        return False
    kinds = {column.name: column.kind for column in bag.columns(full)}
    numbered = name != _IMPACTS or kinds.get("sequence") is Kind.NUMBER
    return kinds.get("header.stamp") is Kind.TIME and numbered


class Estimate(NamedTuple):
    """Metric of a run, in the unit of its quantity."""

    value: float
    error: float = math.nan  # standard error; NaN if it is unknown


def estimate(
    values: RecordedValues, metric: ComparedMetric, begin: float, end: float
) -> Estimate | None:
    """Return a metric between two simulation times [s]; None if the run does not have it."""
    columns = values.topics.get(metric.topic, {})
    if metric.column not in columns:
        return None
    times, held = columns["time"], columns[metric.column]
    numbers = columns.get("sequence", held)
    reports = metric.topic in _REPORTS
    if reports:
        times, end = times - _AVERAGED, end - _AVERAGED
    good = np.isfinite(held)
    times, held, numbers = times[good], held[good], numbers[good]
    edges = np.linspace(begin, end, _BATCHES + 1)
    places = np.searchsorted(times, edges)

    def of(first: int, last: int, length: float) -> float:
        # Numbers also count impacts that the bag lacks.
        ends = numbers[np.minimum([first, last], len(numbers) - 1)]
        rate = float(ends[1] - ends[0]) / length
        if metric.statistic == _RATE:
            return rate
        if metric.statistic == _P95:
            return float(np.quantile(held[first:last], 0.95))
        if metric.statistic == _POWER and first == last:
            return 0.0
        return float(held[first:last].mean()) * (rate if metric.statistic == _POWER else 1.0)

    count = int(places[-1] - places[0])
    if not count or not end > begin:
        return None
    whole = of(int(places[0]), int(places[-1]), end - begin)
    length = (end - begin) / _BATCHES
    enough = length >= _AVERAGED if reports else count >= _FEWEST
    if not enough or (metric.statistic in (_MEAN, _P95) and (np.diff(places) == 0).any()):
        return Estimate(whole)
    parts = np.array([of(first, last, length) for first, last in pairwise(places.tolist())])
    floor = max(metric.shown.floor, _ROUNDING * abs(whole))
    return Estimate(whole, math.hypot(float(parts.std(ddof=1)) / math.sqrt(_BATCHES), floor))


class MetricDifference(NamedTuple):
    """Difference of a metric between a run and the reference; NaN for what is unknown."""

    quantity: str
    metric: str  # statistic of the quantity
    unit: str  # SI unit of the four values that follow
    reference: float
    other: float
    low: float = math.nan  # low, high: interval of other minus reference
    high: float = math.nan
    # relative_low, relative_high: interval of the difference over the reference; NaN where the
    # reference may be zero.
    relative_low: float = math.nan
    relative_high: float = math.nan
    result: str = (
        TOO_FEW  # differs, no difference found, within tolerance, undecided, too few values
    )


def differences(
    runs: Sequence[RecordedValues],
    begin: float,
    end: float,
    quantities: Sequence[str] = COMPARED_QUANTITIES,
    tolerance: float = 0.0,
) -> tuple[MetricDifference, ...]:
    """Return the differences of the second run from the first one between two times [s].

    ``tolerance`` is the relative difference that does not matter; 0 for none. All intervals
    together hold with a probability of 95 % (Bonferroni): so runs of one kind seldom differ.
    """
    metrics = [metric for metric in METRICS if metric.quantity in quantities]
    pairs = []
    for metric in metrics:
        one, other = (estimate(run, metric, begin, end) for run in runs)
        if one and other:
            pairs.append((metric, one, other))
    known = sum(math.isfinite(one.error + other.error) for _, one, other in pairs)
    chance = 0.5 * (1.0 - LEVEL) / max(known, 1)
    return tuple(_difference(*pair, chance, tolerance) for pair in pairs)


def _difference(
    metric: ComparedMetric, one: Estimate, other: Estimate, chance: float, tolerance: float
) -> MetricDifference:
    """``chance`` is the probability of a value beyond each end of the interval."""
    unit = metric.shown.si
    found = MetricDifference(metric.quantity, metric.statistic, unit, one.value, other.value)
    error = math.hypot(one.error, other.error)
    if not math.isfinite(error):
        return found
    special = import_extra("scipy.special", "a comparison", "'rpud_sim[web]'")
    # Degrees of freedom by Welch and Satterthwaite.
    freedom = (_BATCHES - 1) / sum((each.error / error) ** 4 for each in (one, other))
    reach = float(special.stdtrit(freedom, 1.0 - chance))
    value = other.value - one.value
    found = found._replace(low=value - reach * error, high=value + reach * error)
    low, high, edge = found.low, found.high, 0.0
    square = one.value**2 - (reach * one.error) ** 2
    if square > 0.0:
        # By Fieller's theorem, so that this interval leaves out zero if the one above does.
        ratio = one.value * other.value / square
        half = math.sqrt(
            max(ratio**2 - (other.value**2 - (reach * other.error) ** 2) / square, 0.0)
        )
        low, high, edge = ratio - 1.0 - half, ratio - 1.0 + half, tolerance
        found = found._replace(relative_low=low, relative_high=high)
    result = NONE_FOUND if not edge else UNDECIDED
    if low > edge or high < -edge:
        result = DIFFERS
    elif edge and -edge <= low and high <= edge:
        result = SAME
    return found._replace(result=result)
