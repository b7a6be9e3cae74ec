"""Proof of a fit's intervals: synthetic drills with known parameters, and how many are covered."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.studies.fit.branches import (
    FitError,
    explore,
    named_points,
    pool,
    unfinished,
)
from rpud_sim.studies.fit.folder import FitFolder
from rpud_sim.studies.fit.identifiability import LEVEL, interval_shares
from rpud_sim.studies.fit.specification import Specification, Target

_MOST_RUNS = 8  # whose mean a synthetic target is
_CONFIDENCE = 0.99  # of the interval of a covered share, which shall hold ``LEVEL``
_DRAWN = 7  # second number of the seeds here; those of a fit are smaller


@dataclasses.dataclass(frozen=True)
class Proof:
    """Result of fits to synthetic drills."""

    drills: int  # number of synthetic drills with intervals
    refused: int  # number of those that have none
    covered: Mapping[str, int]  # drills whose interval holds the true value, by unknown
    chosen: float  # mean posterior probability of the true combination of choices

    def ends(self, name: str) -> tuple[float, float]:
        """Return the interval of an unknown's covered share, after Clopper and Pearson."""
        test = stats.binomtest(self.covered[name], self.drills)
        low, high = test.proportion_ci(_CONFIDENCE)
        return float(low), float(high)

    @property
    def holds(self) -> bool:
        """Whether each unknown is covered as often as its interval says, up to chance."""
        ends = [self.ends(name) for name in self.covered]
        return all(low <= LEVEL <= high for low, high in ends)

    def content(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "drills": self.drills,
            "refused": self.refused,
            "level": LEVEL,
            "covered": {
                name: {"count": count, "share": count / self.drills, "interval": self.ends(name)}
                for name, count in self.covered.items()
            },
            "confidence": _CONFIDENCE,
            "holds": self.holds,
            "true_choice_probability": self.chosen,
        }


def proof_simulations(specification: Specification, drills: int) -> int:
    """Return the number of runs of a proof; each drill reads those of the first round again."""
    design = len(specification.combinations) * specification.points * specification.repeat
    return design * drills * specification.rounds + drills * _runs(specification)


def prove(
    folder: FitFolder,
    specification: Specification,
    drills: int,
    report: Callable[[int], None] = lambda drills: None,
) -> Proof:
    """Fit synthetic drills, drawn evenly between the bounds, in a folder that is held.

    All fits share the first round. The targets' values are those of the synthetic drill, with an
    error drawn from the tolerances.

    Args:
        specification: of the fit; the values of its targets give only the tolerances.
        report: called with the number of drills that were fitted since its last call.
    """
    runs = _runs(specification)
    random = np.random.default_rng([specification.seed, _DRAWN])
    shares = random.random((drills, len(specification.unknowns)))
    chosen = random.integers(len(specification.combinations), size=drills)
    points = [
        point
        for number, share in zip(chosen, shares, strict=True)
        for point in named_points(specification, share[None], specification.combinations[number])
    ]
    figures = folder.simulate(f"proof_{drills}", points, runs, (specification.seed, _DRAWN, 1))
    inside, probabilities, refused = [], [], 0
    for i, number in enumerate(chosen):
        report(1)
        if not np.isfinite(figures[i]).all():
            continue
        targets = _with_error(specification.targets, figures[i], random)
        own = dataclasses.replace(specification, targets=targets)
        try:
            branches = explore(folder, own, f"drill_{i:05}_")
        except FitError:
            refused += 1
            continue
        if unfinished(own, branches):
            refused += 1
            continue
        low, high = interval_shares(pool(branches, random))
        inside.append((shares[i] >= low) & (shares[i] <= high))
        probabilities.append(sum(b.probability for b in branches if b.number == number))
    if not inside:
        raise FitError("no synthetic drill has intervals")
    counts = np.sum(inside, axis=0).tolist()
    covered = dict(zip(specification.unknowns, counts, strict=True))
    return Proof(len(inside), refused, covered, float(np.mean(probabilities)))


def _with_error(
    targets: tuple[Target, ...], runs: np.ndarray, random: np.random.Generator
) -> tuple[Target, ...]:
    """Return the targets of a synthetic drill, with errors drawn from the tolerances.

    Data has its chance from the drill's runs. Tolerances keep their share of the value.
    """
    found = []
    for target, column in zip(targets, runs.T, strict=True):
        count = min(target.runs, len(runs))
        mean = float(column[:count].mean())
        scale = abs(mean / target.value) if target.value and mean else 1.0
        own: dict[str, Any] = {"tolerance": scale * target.tolerance, "runs": count}
        if target.sampling is not None:
            own["sampling"] = scale * target.sampling
        value = float(random.normal(mean, own["tolerance"]))
        found.append(dataclasses.replace(target, value=value, **own))
    return tuple(found)


def _runs(specification: Specification) -> int:
    return min(_MOST_RUNS, max(target.runs for target in specification.targets))
