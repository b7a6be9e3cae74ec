"""Specification of a sweep: its design, its parameters, its faults, and what it keeps."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.model.elementary import power
from rpud_sim.simulation.changes import Planned
from rpud_sim.simulation.configuration import Configuration, Settings, to_configuration, to_settings
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.simulation.topics import TOPICS

DESIGNS = ("grid", "latin_hypercube", "sobol", "saltelli")
SCALES = ("linear", "log")
HEALTHY = "healthy"  # name of the drill without a fault
# Names and units of the figures that a sweep can have; those of the rock need one.
SWEEP_FIGURES = MappingProxyType({**FIGURES, "depth": "m", "penetration_rate": "m/s"})
# Without them a bag can be neither proved nor read by people.
_ALWAYS_IN_BAGS = ("faults", "journal", "status")


class SweepError(ValueError):
    """Sweep that is not possible as specified; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Range:
    """Interval of values, spread evenly or evenly in their logarithms."""

    minimum: float  # least value, SI units
    maximum: float  # greatest value
    scale: str = "linear"  # of ``SCALES``
    points: int | None = None  # number of values in a grid; None in other designs
    source: str = ""  # where the interval comes from

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the values at shares of the way from minimum to maximum, in the same shape."""
        if self.scale == "log":
            ratio = self.maximum / self.minimum
            growth = [power(ratio, share) for share in np.ravel(shares).tolist()]
            values = self.minimum * np.reshape(growth, np.shape(shares))
        else:
            values = self.minimum + shares * (self.maximum - self.minimum)
        values = np.where(shares == 1.0, self.maximum, values)
        return np.clip(values, self.minimum, self.maximum)

    def levels(self) -> np.ndarray:
        """Return the values in a grid, shape (points,)."""
        return self.at(np.linspace(0.0, 1.0, self.points or 0))


@dataclasses.dataclass(frozen=True)
class Values:
    """List of values: numbers in SI units, or choices."""

    values: tuple[float, ...] | tuple[str, ...]

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the value at each share in [0, 1); all values have equal parts of it."""
        return self.levels()[(shares * len(self.values)).astype(int)]

    def levels(self) -> np.ndarray:
        """Return the values in a grid."""
        return np.array(self.values)


@dataclasses.dataclass(frozen=True)
class Interval:
    """Interval from which a time is drawn evenly."""

    minimum: float  # [s]
    maximum: float  # [s]

    def at(self, share: float) -> float:
        """Return the time at a share of the way, from 0 to 1."""
        return min(self.minimum + share * (self.maximum - self.minimum), self.maximum)


@dataclasses.dataclass(frozen=True)
class Case:
    """Parameters and commands that belong together, such as those of a rock."""

    parameters: Mapping[str, Any]  # by name
    commands: tuple[Planned, ...] = ()  # in the order of their times


@dataclasses.dataclass(frozen=True)
class SweepSpecification:
    """Sweep over the drill's parameters, and over cases and faults."""

    design: str  # of ``DESIGNS``
    points: int | None  # number of points; None in a grid, whose ranges have their own
    seed: int  # of the design and of all draws
    repeat: int  # simulations at each point, with different initial phases
    duration: float  # of each simulation [s]
    # parameters that differ from the regime's preset at all points
    fixed: Mapping[str, Any]
    swept: Mapping[str, Range | Values]  # range or values of each swept parameter, by name
    figures: tuple[str, ...] = tuple(FIGURES)  # of ``SWEEP_FIGURES``
    # by name; the design is repeated in each
    cases: Mapping[str, Case] = dataclasses.field(default_factory=dict)
    # by name; the design is repeated with each, and without any
    faults: Mapping[str, Fault] = dataclasses.field(default_factory=dict)
    onset: Interval | None = None  # of the faults; None without faults
    lasting: Interval | None = None  # of the faults; None for to the end of the simulation
    commands: tuple[Planned, ...] = ()  # in every simulation, in the order of their times
    bags: tuple[str, ...] = ()  # topics of the bag of each simulation; none for no bags

    @property
    def axes(self) -> dict[str, Range | Values]:
        """Everything that changes from point to point, by the name of its column."""
        found: dict[str, Range | Values] = {}
        if self.cases:
            found["case"] = Values(tuple(self.cases))
        if self.faults:
            found["fault"] = Values((HEALTHY, *self.faults))
        return {**found, **self.swept}

    @property
    def design_count(self) -> int:
        """Number of points for each case and fault."""
        if self.design == "saltelli":  # two matrices, one for each parameter, and one more
            return (self.points or 0) * (len(self.swept) + 3)
        if self.points is not None:
            return self.points
        return math.prod(_level_count(item) for item in self.swept.values())

    @property
    def point_count(self) -> int:
        """Number of points."""
        return self.design_count * max(len(self.cases), 1) * (len(self.faults) + 1)

    @property
    def simulations(self) -> int:
        """Number of simulations."""
        return self.point_count * self.repeat

    @property
    def bag_topics(self) -> tuple[str, ...]:
        """Topics of the bags, in the order of the table of topics."""
        return tuple(name for name in TOPICS if name in (*self.bags, *_ALWAYS_IN_BAGS))

    def configuration(self, point: Mapping[str, Any]) -> Configuration:
        """Return the drill at a point, given by the values of the axes.

        Raises:
            ParameterError: if a value is outside its range.
        """
        return to_configuration(self._values(point))

    def settings(self, point: Mapping[str, Any]) -> Settings:
        """Return the settings of a run at a point; see ``configuration``."""
        return to_settings(self._values(point))

    def planned(self, point: Mapping[str, Any]) -> tuple[Planned, ...]:
        """Return the commands at a point, in the order of their times."""
        case = self.cases.get(point.get("case", ""))
        commands = (*self.commands, *(case.commands if case else ()))
        return tuple(sorted(commands, key=lambda each: each.delay))

    def content(self) -> dict[str, Any]:
        """Return the specification as JSON reads it back; equal sweeps give equal values."""
        content: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(self)))
        return content

    def _values(self, point: Mapping[str, Any]) -> dict[str, Any]:
        case = self.cases.get(point.get("case", ""))
        swept = {name: value for name, value in point.items() if name in self.swept}
        return {**self.fixed, **(case.parameters if case else {}), **swept}


def _level_count(item: Range | Values) -> int:
    return len(item.values) if isinstance(item, Values) else item.points or 0
