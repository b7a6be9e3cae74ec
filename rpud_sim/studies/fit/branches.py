"""Branches of a fit: one for each combination of choices, narrowed round by round."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.studies.fit.design import Region, sobol_points, values_at
from rpud_sim.studies.fit.folder import FitFolder
from rpud_sim.studies.fit.posterior import Likelihood, Posterior, sample
from rpud_sim.studies.fit.specification import Specification
from rpud_sim.studies.fit.surrogate import Surrogate, SurrogateError, fit_surrogate

PARTICLES = 4096
_LEAST_PROBABILITY = 1e-4  # of a combination of choices that is followed further
_PADDING = 0.25  # of the posterior's width, added to the next region on both sides
_LEAST_WIDTH = 0.01  # of a region
_TAIL = 0.002

# What is drawn, as the second number of a seed.
DESIGN, PHASES, SAMPLING, CANDIDATE, FINAL = range(5)


class FitError(RuntimeError):
    """Fit that has no result; the text gives the reason in one line."""


@dataclasses.dataclass
class Branch:
    """Progress for one combination of choices."""

    number: int  # of the combination
    choices: dict[str, Any]  # their values, by name
    region: Region  # of the present round
    shares: np.ndarray  # simulated points in it, shape (points, unknowns)
    figures: np.ndarray  # of their runs, shape (points, repeat, targets)
    surrogate: Surrogate | None = None  # of the figures; None if too few points have them
    posterior: Posterior | None = None  # of the unknowns
    probability: float = 0.0  # of the combination


@dataclasses.dataclass(frozen=True)
class Round:
    """Account of a round for one combination of choices."""

    number: int  # of the round, from 1
    choices: Mapping[str, Any]  # the combination
    volume: float  # of the region, as a share of that between all bounds
    points: int  # that the surrogate was fitted to
    degrees: tuple[int, ...]  # of its polynomials, by target
    errors: tuple[float, ...]  # of the surrogate, standard deviations as they are fitted, by target
    probability: float  # of the combination


def add_design(
    folder: FitFolder, specification: Specification, branch: Branch, number: int
) -> None:
    """Simulate the design of a round in a branch's region."""
    seed = specification.seed
    shares = sobol_points(
        branch.region, specification.points, (seed, DESIGN, number, branch.number)
    )
    figures = folder.simulate(
        f"round_{number + 1:02}_{branch.number:02}",
        named_points(specification, shares, branch.choices),
        specification.repeat,
        (seed, PHASES, number, branch.number),
    )
    inside = branch.region.holds(branch.shares)
    branch.shares = np.concatenate([branch.shares[inside], shares])
    branch.figures = np.concatenate([branch.figures[inside], figures])


def named_points(
    specification: Specification, shares: np.ndarray, choices: Mapping[str, Any]
) -> list[dict[str, Any]]:
    """Return the values of all unknowns at points."""
    values = values_at(specification, shares)
    return [
        {**{name: column[i].item() for name, column in values.items()}, **choices}
        for i in range(len(shares))
    ]


def condition_numbers(specification: Specification) -> np.ndarray:
    """Return the number of each target's condition."""
    numbers = [specification.conditions.index(t.parameters) for t in specification.targets]
    return np.array(numbers)


def update(specification: Specification, branch: Branch, number: int) -> None:
    """Fit the surrogate of a branch and sample its posterior."""
    try:
        branch.surrogate = fit_surrogate(
            branch.region, branch.shares, branch.figures, condition_numbers(specification)
        )
    except SurrogateError as error:
        if len(specification.combinations) == 1:
            raise FitError(str(error)) from None
        branch.surrogate, branch.posterior = None, None
        return
    likelihood = Likelihood(branch.surrogate, specification.targets)
    random = np.random.default_rng([specification.seed, SAMPLING, number, branch.number])
    branch.posterior = sample(likelihood, PARTICLES, random)


def weigh(branches: list[Branch]) -> list[Branch]:
    """Return the branches that are probable enough, with their probabilities.

    Raises:
        FitError: if none explains the targets.
    """
    found = [b for b in branches if b.posterior and math.isfinite(b.posterior.log_evidence)]
    if not found:
        raise FitError(
            "no point between the bounds gives these figures; move the bounds of the unknowns"
        )
    logs = np.array([branch.posterior.log_evidence for branch in found if branch.posterior])
    weights = np.exp(logs - logs.max())
    for branch, weight in zip(found, weights / weights.sum(), strict=True):
        branch.probability = float(weight)
    kept = [branch for branch in found if branch.probability >= _LEAST_PROBABILITY]
    total = sum(branch.probability for branch in kept)
    for branch in kept:
        branch.probability /= total
    return kept


def next_region(branch: Branch) -> Region:
    """Return a box around the posterior; it may also grow where the posterior meets its side."""
    assert branch.posterior is not None
    low, high = np.quantile(branch.posterior.shares, (_TAIL, 1.0 - _TAIL), axis=0)
    pad = _PADDING * (high - low) + 0.5 * np.maximum(_LEAST_WIDTH - (high - low), 0.0)
    return Region(np.maximum(low - pad, 0.0), np.minimum(high + pad, 1.0))


def to_round(branch: Branch, number: int) -> Round:
    """Return the account of a branch after a round, numbered from 1."""
    assert branch.surrogate is not None
    return Round(
        number,
        branch.choices,
        math.exp(branch.region.log_volume),
        len(branch.shares),
        branch.surrogate.degrees,
        tuple(np.sqrt(np.diag(branch.surrogate.error)).tolist()),
        branch.probability,
    )


def pool(
    branches: list[Branch], random: np.random.Generator, particles: int = PARTICLES
) -> np.ndarray:
    """Return points of all branches' posteriors, each as often as its branch is probable."""
    numbers = random.multinomial(particles, [branch.probability for branch in branches])
    chosen = [
        branch.posterior.shares[random.permutation(len(branch.posterior.shares))[:number]]
        for branch, number in zip(branches, numbers, strict=True)
        if branch.posterior is not None
    ]
    return np.concatenate(chosen)
