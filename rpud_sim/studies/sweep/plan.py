"""Plan of a sweep: each simulation with its name, and the random numbers of this name."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping
from typing import Any

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.fault_kinds import KINDS
from rpud_sim.simulation.faults import Fault
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.studies.sweep.specification import HEALTHY, SweepSpecification


def draw(seed: int, name: str) -> float:
    """Return a random number in [0, 1).

    Each name has its own: another case or fault changes no other number.
    """
    digest = hashlib.sha256(f"{seed}/{name}".encode()).digest()
    return float((int.from_bytes(digest[:8], "little") >> 11) / 2**53)


def point_name(specification: SweepSpecification, number: int, point: Mapping[str, Any]) -> str:
    """Return the name of a point: case, fault, and number in the design.

    Args:
        number: of the point in the sweep.
        point: its values by axis.
    """
    words = [str(point[axis]) for axis in ("case", "fault") if axis in point]
    return "-".join([*words, str(number % specification.design_count)])


def point_seed(specification: SweepSpecification, number: int, point: Mapping[str, Any]) -> int:
    """Return the seed of the initial phases at a point."""
    return int(draw(specification.seed, f"{point_name(specification, number, point)}/seed") * 2**32)


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """Simulation of a point, with its ground truth."""

    name: str  # of its bag, unique in the sweep
    seed: int  # of the signals' random numbers
    fault: Fault | None = None  # that begins, None without one
    onset: int | None = None  # simulation time at which it begins [ns]
    clear: int | None = None  # at which it ends [ns]; None for not before the end

    @property
    def scenario(self) -> Scenario | None:
        """Scenario of the fault."""
        if self.fault is None or self.onset is None:
            return None
        return Scenario(self.seed, (ScheduledFault(self.onset, self.clear, self.fault),))

    def labels(self) -> dict[str, Any]:
        """Return the ground truth by the names of the table's columns; None without a fault."""
        if self.fault is None or self.onset is None:
            return dict.fromkeys(("kind", "channel", "magnitude", "unit", "onset", "clear"))
        quantity = KINDS[self.fault.kind].quantity_on(self.fault.channel)
        return {
            "kind": self.fault.kind,
            "channel": self.fault.channel,
            "magnitude": self.fault.magnitude,
            "unit": quantity.unit if quantity else "",
            "onset": self.onset / SECOND,
            "clear": None if self.clear is None else self.clear / SECOND,
        }


def plan_run(
    specification: SweepSpecification, number: int, point: Mapping[str, Any], member: int
) -> PlannedRun:
    """Return a member of the ensemble at a point; see ``point_name`` for the arguments."""
    name = f"{point_name(specification, number, point)}-{member}"
    seed = int(draw(specification.seed, f"{name}/seed") * 2**32)
    label = point.get("fault", HEALTHY)
    if label == HEALTHY or specification.onset is None:
        return PlannedRun(name, seed)
    onset = round(specification.onset.at(draw(specification.seed, f"{name}/onset")) * SECOND)
    clear = None
    if specification.lasting:
        share = draw(specification.seed, f"{name}/lasting")
        clear = onset + round(specification.lasting.at(share) * SECOND)
    return PlannedRun(name, seed, specification.faults[label], onset, clear)
