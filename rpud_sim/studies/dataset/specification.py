"""Specification of a data set: rocks with their splits, faults with severities, seeds, topics."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from rpud_sim.drilling.feed import RATE
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.simulation.changes import Planned
from rpud_sim.simulation.commands import Feed
from rpud_sim.simulation.configuration import Settings, to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.topics import TOPICS

SPLITS = ("train", "validation", "test")
HEALTHY = "healthy"
"""Label where no fault lasts."""

# They hold labels, or what no instrument measures: bags have them, tables do not.
NOT_IN_TABLES = ("faults", "journal", "trajectory", "waveform")
# Without them a bag can be neither proved nor read by people.
ALWAYS_IN_BAGS = ("faults", "journal", "status")
DEFAULT_TOPICS = ("actuator_state", "contact_force", "drill_tool", "reacting_force", "wrench")
MOST_RUNS = 100_000


class DatasetError(ValueError):
    """Data set that is not possible as specified; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Interval:
    """Interval from which a number is drawn evenly, SI units."""

    minimum: float
    maximum: float

    def at(self, share: float) -> float:
        """Return the number at a share of the way, from 0 to 1."""
        return min(self.minimum + share * (self.maximum - self.minimum), self.maximum)


@dataclasses.dataclass(frozen=True)
class Rock:
    """Rock with the split to which all of its runs belong."""

    split: str  # of ``SPLITS``
    parameters: Mapping[str, Any]  # by which the rock differs from the others, by name
    # that is commanded at time zero, positive toward the rock [m/s]; None for no command to
    # the feed
    feed_rate: float | None = None


@dataclasses.dataclass(frozen=True)
class FaultSeries:
    """Fault with its severities."""

    kind: str  # of the fault
    channel: str  # of a signal fault, empty for a physical one
    magnitudes: tuple[float, ...]  # of severity 1, 2 and so on, in the unit of the kind

    def fault(self, severity: int) -> Fault:
        """Return the fault of a severity, from 1."""
        return Fault(self.kind, self.channel, self.magnitudes[severity - 1])


@dataclasses.dataclass(frozen=True)
class Window:
    """Windows of the table of features."""

    length: float = 0.2  # of each [s]
    stride: float = 0.1  # from the beginning of one to that of the next [s]


LENGTH = Quantity("s", "length of a window", 1e-3, 1e3)
STRIDE = Quantity("s", "time from one window to the next", 1e-3, 1e3)
DURATION = Quantity("s", "duration of each run", 0.1, 1e5)
TIME = Quantity("s", "time in a run", 0.0, 1e5)
FEED_RATE = Quantity("m/s", "rate of the feed, positive toward the rock", -1.0, 1.0)
SEED = Quantity("", "seed", 0, 2**32 - 1, whole=True)
SEEDS = Quantity("", "runs with each rock, fault and severity", 0, 10_000, whole=True)
HEALTHY_RUNS = Quantity("", "runs without a fault with each rock", 0, 10_000, whole=True)


@dataclasses.dataclass(frozen=True)
class Specification:
    """Data set."""

    seed: int  # of all draws
    duration: float  # of each run [s]
    settling: float  # time before the first window: the drill starts from rest [s]
    onset: Interval  # times at which a fault may begin [s]
    lasting: Interval | None  # times for which it may last; None for to the end of the run [s]
    seeds: int  # runs with each rock, fault and severity
    healthy: int  # runs without a fault with each rock
    topics: tuple[str, ...]  # of bags and tables
    only_in_bags: tuple[str, ...]  # further topics of the bags
    window: Window  # of the table of features
    fixed: Mapping[str, Any]  # parameters that differ from their defaults in all runs
    varied: Mapping[str, Interval]  # parameters that are drawn for each run, with their intervals
    rocks: Mapping[str, Rock]  # by name
    faults: tuple[FaultSeries, ...]  # in the order of the file
    # to the drill, the same in all runs, in the order of their times
    commands: tuple[Planned, ...] = ()
    # kinds of fault that ``physical`` stands for and that no run can honour
    left_out: tuple[str, ...] = ()

    @property
    def run_count(self) -> int:
        """Number of runs."""
        faulty = self.seeds * sum(len(series.magnitudes) for series in self.faults)
        return len(self.rocks) * (faulty + self.healthy)

    @property
    def bag_topics(self) -> tuple[str, ...]:
        """Topics of the bags, in the order of the table of topics."""
        wanted = {*self.topics, *self.only_in_bags, *ALWAYS_IN_BAGS}
        return tuple(name for name in TOPICS if name in wanted)

    def settings(self, rock: str, values: Mapping[str, float]) -> Settings:
        """Return the settings of a run.

        Args:
            rock: its name.

        Raises:
            ParameterError: if a value cannot be used.
        """
        return to_settings({**self.fixed, **values, **self.rocks[rock].parameters})

    def feed(self, rock: str) -> Feed | None:
        """Return the command to the feed at time zero in a rock."""
        rate = self.rocks[rock].feed_rate
        return None if rate is None else Feed(RATE, rate)

    def planned(self, rock: str) -> tuple[Planned, ...]:
        """Return the commands of a run in a rock: first the feed of that rock."""
        feed = self.feed(rock)
        return self.commands if feed is None else (Planned(0, feed), *self.commands)

    def extremes(self) -> Sequence[Mapping[str, float]]:
        """Return the varied parameters at the ends of their intervals."""
        return [
            {name: getattr(interval, end) for name, interval in self.varied.items()}
            for end in ("minimum", "maximum")
        ]

    def content(self) -> dict[str, Any]:
        """Return the specification as JSON reads it back; equal data sets give equal values."""
        content: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return content


def window_starts(specification: Specification) -> np.ndarray:
    """Return the beginnings of the windows of a run [ns]."""
    first, length, stride, end = (
        round(seconds * 1e9)
        for seconds in (
            specification.settling,
            specification.window.length,
            specification.window.stride,
            specification.duration,
        )
    )
    return np.arange(first, end - length + 1, stride, dtype=np.int64)
