"""Proof of a fit's intervals: synthetic drills with known parameters, and how many are covered."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np

from rpud_sim.studies.fit.branches import (
    Branch,
    FitError,
    add_design,
    condition_numbers,
    pool,
    weigh,
)
from rpud_sim.studies.fit.design import Region, values_at
from rpud_sim.studies.fit.folder import FitFolder
from rpud_sim.studies.fit.identifiability import LEVEL, interval_shares
from rpud_sim.studies.fit.posterior import Likelihood, sample
from rpud_sim.studies.fit.specification import Specification
from rpud_sim.studies.fit.surrogate import Surrogate, SurrogateError, fit_surrogate

PARTICLES = 1024
MOST_RUNS = 8  # whose mean a synthetic target is
RANGE = (0.85, 0.95)  # in which the covered share shall be

_DRAWN = 7  # second number of the seeds here; those of a fit are smaller


@dataclasses.dataclass(frozen=True)
class Proof:
    """Result of fits to synthetic drills."""

    drills: int  # number of synthetic drills with all figures
    covered: dict[str, float]  # share of the drills whose interval holds the true value, by unknown
    # of the true values in their posteriors, from 0 to 1, shape (drills, unknowns)
    ranks: np.ndarray
    chosen: float  # mean posterior probability of the true combination of choices

    @property
    def mean(self) -> float:
        """Covered share over all unknowns."""
        return float(np.mean(list(self.covered.values())))

    @property
    def holds(self) -> bool:
        """Whether the covered share of all unknowns together is in ``RANGE``."""
        return RANGE[0] <= self.mean <= RANGE[1]

    def content(self) -> dict[str, Any]:
        """Return the result as plain values."""
        return {
            "drills": self.drills,
            "level": LEVEL,
            "covered": self.covered,
            "covered_mean": self.mean,
            "range": list(RANGE),
            "holds": self.holds,
            "true_choice_probability": self.chosen,
        }


def proof_simulations(specification: Specification, drills: int) -> int:
    """Return the number of runs of a proof."""
    designs = len(specification.combinations) * specification.points * specification.repeat
    return designs + drills * _runs(specification)


def prove(
    folder: FitFolder,
    specification: Specification,
    drills: int,
    report: Callable[[int], None] = lambda drills: None,
) -> Proof:
    """Fit synthetic drills, drawn evenly between the bounds, in a folder that is held.

    All fits share the design of the first round. The targets' values are those of the synthetic
    drill, with an error drawn from the tolerances.

    Args:
        specification: of the fit; the values of its targets give only the tolerances.
        report: called with the number of drills that were fitted since its last call.

    Raises:
        FitError: if no drill can be fitted.
    """
    runs = _runs(specification)
    targets = tuple(
        dataclasses.replace(target, runs=min(target.runs, runs)) for target in specification.targets
    )
    surrogates = _surrogates(folder, specification)
    random = np.random.default_rng([specification.seed, _DRAWN])
    shares = random.random((drills, len(specification.unknowns)))
    usable = [i for i, surrogate in enumerate(surrogates) if surrogate is not None]
    if not usable:
        raise FitError("no combination of choices has enough points with all figures")
    chosen = random.choice(usable, drills)
    columns = values_at(specification, shares)
    points = [
        {**{name: column[i].item() for name, column in columns.items()}, **combination}
        for i, combination in enumerate(specification.combinations[k] for k in chosen)
    ]
    figures = folder.simulate(f"proof_{drills}", points, runs, (specification.seed, _DRAWN, 1))
    ranks, inside, probabilities = [], [], []
    for i in range(drills):
        report(1)
        if not np.isfinite(figures[i]).all():
            continue
        own = surrogates[chosen[i]]
        assert own is not None
        values = _with_error(own, targets, figures[i], random)
        branches = []
        for number in usable:
            surrogate = surrogates[number]
            assert surrogate is not None
            branch = Branch(number, {}, surrogate.region, shares, figures, surrogate)
            branch.posterior = sample(
                Likelihood(surrogate, targets).with_values(values), PARTICLES, random
            )
            branches.append(branch)
        try:
            kept = weigh(branches)
        except FitError:
            inside.append(np.zeros(shares.shape[1], bool))  # an interval of nothing covers nothing
            continue
        found = pool(kept, random, PARTICLES)
        low, high = interval_shares(found)
        inside.append((shares[i] >= low) & (shares[i] <= high))
        ranks.append((found < shares[i]).mean(axis=0))
        own_number = chosen[i]
        probabilities.append(sum(b.probability for b in kept if b.number == own_number))
    if not ranks:
        raise FitError("no synthetic drill has all figures")
    covered = np.mean(inside, axis=0)
    return Proof(
        len(inside),
        {name: float(share) for name, share in zip(specification.unknowns, covered, strict=True)},
        np.array(ranks),
        float(np.mean(probabilities)),
    )


def _surrogates(folder: FitFolder, specification: Specification) -> list[Surrogate | None]:
    count = len(specification.unknowns)
    surrogates: list[Surrogate | None] = []
    for number, choices in enumerate(specification.combinations):
        empty = np.empty((0, specification.repeat, len(specification.targets)))
        branch = Branch(number, choices, Region.whole(count), np.empty((0, count)), empty)
        add_design(folder, specification, branch, 0)
        groups = condition_numbers(specification)
        try:
            surrogates.append(fit_surrogate(branch.region, branch.shares, branch.figures, groups))
        except SurrogateError:
            surrogates.append(None)
    return surrogates


def _with_error(
    surrogate: Surrogate, targets: Any, runs: np.ndarray, random: np.random.Generator
) -> np.ndarray:
    """Return the targets' values of a synthetic drill, with their errors."""
    means = np.array([runs[: target.runs, i].mean() for i, target in enumerate(targets)])
    fitted = surrogate.transform(means)
    if not np.isfinite(fitted).all():
        return means
    tolerance = Likelihood(surrogate, targets).tolerance
    return surrogate.restore(random.multivariate_normal(fitted, tolerance))


def _runs(specification: Specification) -> int:
    return min(MOST_RUNS, max(target.runs for target in specification.targets))
