"""Plan of a data set: each run with its rock, fault, times and seed."""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Mapping

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.faults import KINDS, Fault
from rpud_sim.simulation.run import Beginning
from rpud_sim.simulation.scenario import Scenario, ScheduledFault
from rpud_sim.studies.dataset.specification import HEALTHY, Specification


@dataclasses.dataclass(frozen=True)
class PlannedRun:
    """Run of a data set, with its labels. Times are simulation time [ns]."""

    number: int  # of the run, from 0
    name: str  # of its folder, unique in the data set
    split: str  # of its rock
    rock: str  # its name
    fault: Fault | None  # that begins, None in a healthy run
    severity: int  # from 1, zero in a healthy run
    onset: int | None  # time at which the fault begins, None in a healthy run
    clear: int | None  # time at which it ends, None if it lasts to the end of the run
    seed: int  # of the signals' random numbers
    initial_phase: float  # of the vibration [cycles]
    values: Mapping[str, float]  # of the varied parameters

    @property
    def kind(self) -> str:
        """Kind of the fault, or ``healthy``."""
        return self.fault.kind if self.fault else HEALTHY

    @property
    def channel(self) -> str:
        """Channel of a signal fault, otherwise empty."""
        return self.fault.channel if self.fault else ""

    @property
    def magnitude(self) -> float:
        """Magnitude in the unit of the kind; zero in a healthy run."""
        return self.fault.magnitude if self.fault else 0.0

    @property
    def unit(self) -> str:
        """Unit of the magnitude; empty for a pure number."""
        if self.fault is None:
            return ""
        quantity = KINDS[self.kind].quantity_on(self.channel)
        return quantity.unit if quantity else ""

    def lasts_at(self, times: np.ndarray) -> np.ndarray:
        """Return whether the fault lasts at times [ns]: from its onset on, before its end."""
        if self.onset is None:
            return np.zeros(len(times), bool)
        before_end = True if self.clear is None else times < self.clear
        return np.asarray((times >= self.onset) & before_end)

    def beginning(self, specification: Specification) -> Beginning:
        """Return the beginning of the run."""
        planned = (
            (ScheduledFault(self.onset, self.clear, self.fault),)
            if self.fault is not None and self.onset is not None
            else ()
        )
        return Beginning(
            specification.settings(self.rock, self.values),
            self.initial_phase,
            self.seed,
            Scenario(self.seed, planned),
        )


def plan_runs(specification: Specification) -> tuple[PlannedRun, ...]:
    """Return the runs of a data set, rock by rock: the healthy ones, then each fault's."""
    runs: list[PlannedRun] = []
    for rock in specification.rocks:
        for member in range(specification.healthy):
            runs.append(_run(specification, len(runs), rock, None, 0, member))
        for series in specification.faults:
            for severity in range(1, len(series.magnitudes) + 1):
                fault = series.fault(severity)
                for member in range(specification.seeds):
                    runs.append(_run(specification, len(runs), rock, fault, severity, member))
    return tuple(runs)


def _run(
    specification: Specification,
    number: int,
    rock: str,
    fault: Fault | None,
    severity: int,
    member: int,
) -> PlannedRun:
    words = [fault.kind, fault.channel, str(severity)] if fault else [HEALTHY]
    name = "-".join([rock, *filter(None, words), str(member)])

    def share(drawn: str) -> float:
        # A stream of its own for each number of each run: another rock or fault changes no other.
        digest = hashlib.sha256(f"{name}/{drawn}".encode()).digest()
        entropy = [specification.seed, *np.frombuffer(digest, np.dtype("<u4")).tolist()]
        return float(np.random.default_rng(np.random.SeedSequence(entropy)).random())

    onset = clear = None
    if fault:
        onset = round(specification.onset.at(share("onset")) * SECOND)
        if specification.lasting:
            clear = onset + round(specification.lasting.at(share("lasting")) * SECOND)
    return PlannedRun(
        number,
        name,
        specification.rocks[rock].split,
        rock,
        fault,
        severity,
        onset,
        clear,
        int(share("seed") * 2**32),
        share("initial_phase"),
        {drawn: interval.at(share(drawn)) for drawn, interval in specification.varied.items()},
    )
