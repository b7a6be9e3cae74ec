"""Specification of a sweep: its design, parameters and faults, and the plan of each simulation."""

from __future__ import annotations

import dataclasses
import hashlib
import math
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import Quantity
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.elementary import power
from rpud_sim.simulation.changes import Change, Inject, in_order
from rpud_sim.simulation.configuration import (
    PARAMETERS,
    Configuration,
    Settings,
    to_configuration,
    to_settings,
)
from rpud_sim.simulation.fault_kinds import KINDS
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


def unit_of(name: str) -> str:
    """Return the SI unit of a parameter; empty for choices and other names."""
    allowed = PARAMETERS[name].allowed if name in PARAMETERS else None
    return allowed.unit if isinstance(allowed, Quantity) else ""


def error_name(figure: str) -> str:
    """Return the name of the column with the standard error of a figure's mean."""
    return f"{figure}_standard_error"


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

    @property
    def count(self) -> int:
        return self.points or 0

    def levels(self) -> np.ndarray:
        """Return the values in a grid, shape (points,)."""
        return self.at(np.linspace(0.0, 1.0, self.count))


@dataclasses.dataclass(frozen=True)
class Values:
    """List of values: numbers in SI units, or choices."""

    values: tuple[float, ...] | tuple[str, ...]

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the value at each share in [0, 1); all values have equal parts of it."""
        return self.levels()[(shares * len(self.values)).astype(int)]

    @property
    def count(self) -> int:
        return len(self.values)

    def levels(self) -> np.ndarray:
        """Return the values in a grid."""
        return np.array(self.values)


@dataclasses.dataclass(frozen=True)
class Case:
    """Parameters and commands that belong together, such as those of a rock."""

    parameters: Mapping[str, Any]  # by name
    commands: tuple[Change, ...] = ()  # in the order of their times


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """Simulation of a point, with its ground truth."""

    name: str  # of its bag, unique in the sweep
    seed: int  # of the signals' random numbers
    onset: int = 0  # of its fault [ns]
    injection: Inject | None = None  # None without a fault

    @property
    def faults(self) -> tuple[Change, ...]:
        return (Change(self.onset, self.injection),) if self.injection else ()

    def labels(self) -> dict[str, Any]:
        """Return the ground truth by the names of the table's columns; empty without a fault."""
        if self.injection is None:
            return {}
        fault, duration = self.injection.fault, self.injection.duration
        quantity = KINDS[fault.kind].quantity_on(fault.channel)
        return {
            **dataclasses.asdict(fault),
            "unit": quantity.unit if quantity else "",
            "onset": self.onset / SECOND,
            "clear": (self.onset + duration) / SECOND if duration else None,
        }

    @property
    def scenario_text(self) -> str:
        """Scenario as JSON, and so as YAML; empty without a fault."""
        if self.injection is None:
            return ""
        entry = {**dataclasses.asdict(self.injection.fault), "onset": self.onset / SECOND}
        if self.injection.duration:
            entry["duration"] = self.injection.duration / SECOND
        return json_text({"seed": self.seed, "faults": [entry]}) + "\n"


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
    onset: Range | None = None  # of the faults [s]; None without faults
    lasting: Range | None = None  # of the faults [s]; None for to the end of the simulation
    commands: tuple[Change, ...] = ()  # in every simulation, in the order of their times
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
        return math.prod(item.count for item in self.swept.values())

    @property
    def point_count(self) -> int:
        return self.design_count * max(len(self.cases), 1) * (len(self.faults) + 1)

    @property
    def simulations(self) -> int:
        return self.point_count * self.repeat

    @property
    def bag_topics(self) -> tuple[str, ...]:
        """Topics of the bags, in the order of the table of topics."""
        return tuple(name for name in TOPICS if name in (*self.bags, *_ALWAYS_IN_BAGS))

    def configuration(self, point: Mapping[str, Any]) -> Configuration:
        """Return the drill at a point, given by the values of the axes."""
        return to_configuration(self._values(point))

    def settings(self, point: Mapping[str, Any]) -> Settings:
        return to_settings(self._values(point))

    def planned(self, point: Mapping[str, Any]) -> tuple[Change, ...]:
        """Return the commands at a point, in the order of their times."""
        case = self.cases.get(point.get("case", ""))
        commands = (*self.commands, *(case.commands if case else ()))
        return in_order(commands)

    def point_seed(self, number: int, point: Mapping[str, Any]) -> int:
        """Return the seed of the initial phases at a point, from its number in the sweep."""
        return self._seed(self._point_name(number, point))

    def plan_run(self, number: int, point: Mapping[str, Any], member: int) -> PlannedRun:
        """Return a member of the ensemble at a point, from its number in the sweep."""
        name = f"{self._point_name(number, point)}-{member}"
        seed = self._seed(name)
        label = point.get("fault", HEALTHY)
        if label == HEALTHY or self.onset is None:
            return PlannedRun(name, seed)
        onset = self._draw_time(f"{name}/onset", self.onset)
        duration = self._draw_time(f"{name}/lasting", self.lasting) if self.lasting else 0
        return PlannedRun(name, seed, onset, Inject(self.faults[label], duration))

    def _point_name(self, number: int, point: Mapping[str, Any]) -> str:
        """Return the name of a point: case, fault, and number in the design."""
        words = [str(point[axis]) for axis in ("case", "fault") if axis in point]
        return "-".join([*words, str(number % self.design_count)])

    def _seed(self, name: str) -> int:
        return int(self._draw(f"{name}/seed") * 2**32)

    def _draw_time(self, name: str, interval: Range) -> int:
        return round(interval.at(np.array([self._draw(name)])).item() * SECOND)

    def _draw(self, name: str) -> float:
        """Return a random number in [0, 1).

        Each name has its own: another case or fault changes no other number.
        """
        digest = hashlib.sha256(f"{self.seed}/{name}".encode()).digest()
        return float((int.from_bytes(digest[:8], "little") >> 11) / 2**53)

    def _values(self, point: Mapping[str, Any]) -> dict[str, Any]:
        case = self.cases.get(point.get("case", ""))
        swept = {name: value for name, value in point.items() if name in self.swept}
        return {**self.fixed, **(case.parameters if case else {}), **swept}
