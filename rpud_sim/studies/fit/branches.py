"""Branches of a fit: one for each combination of choices, narrowed round by round."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.studies.fit.design import Region, sobol_points, values_at
from rpud_sim.studies.fit.folder import FitFolder
from rpud_sim.studies.fit.identifiability import cut_off
from rpud_sim.studies.fit.posterior import Likelihood, Posterior, sample
from rpud_sim.studies.fit.specification import Specification
from rpud_sim.studies.fit.surrogate import Surrogate, SurrogateError, fit_surrogate

PARTICLES = 4096
_LEAST_PROBABILITY = 1e-4  # of a combination of choices that is followed further
_PADDING = 0.25  # of the posterior's width, added to the next region on both sides
_LEAST_WIDTH = 0.01  # of a region
_TAIL = 0.002
_SEEN = 0.01  # probability of a combination of choices that an interval depends on

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


def start_branches(specification: Specification) -> list[Branch]:
    """Return a branch between all bounds for each combination of choices."""
    count = len(specification.unknowns)
    empty = np.empty((0, specification.repeat, len(specification.targets)))
    return [
        Branch(number, choices, Region.whole(count), np.empty((0, count)), empty)
        for number, choices in enumerate(specification.combinations)
    ]


def explore(folder: FitFolder, specification: Specification, drill: str = "") -> list[Branch]:
    """Return the probable branches after all rounds.

    Args:
        drill: prefix of the later rounds' files; the first round does not depend on the targets.
    """
    branches = start_branches(specification)
    for number in range(specification.rounds):
        if number:
            for branch in branches:
                branch.region = next_region(branch)
        for branch in branches:
            add_design(folder, specification, branch, number, drill if number else "")
            update(specification, branch, number)
        branches = weigh(branches)
    return branches


def add_design(
    folder: FitFolder, specification: Specification, branch: Branch, number: int, drill: str = ""
) -> None:
    """Simulate the design of a round in a branch's region."""
    seed = specification.seed
    shares = sobol_points(
        branch.region, specification.points, (seed, DESIGN, number, branch.number)
    )
    figures = folder.simulate(
        f"{drill}round_{number + 1:02}_{branch.number:02}",
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
    """Return the branches that are probable enough, with their probabilities."""
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


def unfinished(specification: Specification, branches: list[Branch]) -> list[str]:
    """Return the unknowns whose posterior the region of the last round cuts off."""
    found: dict[str, None] = {}
    for branch in branches:
        if branch.posterior is None or branch.probability < _SEEN:
            continue
        region = branch.region
        low, high = cut_off(branch.posterior.shares, region.low, region.high)
        inner = low & (region.low > 0.0) | high & (region.high < 1.0)
        found |= {n: None for n, cut in zip(specification.unknowns, inner, strict=True) if cut}
    return list(found)


def pool(branches: list[Branch], random: np.random.Generator) -> np.ndarray:
    """Return points of all branches' posteriors, each as often as its branch is probable."""
    numbers = random.multinomial(PARTICLES, [branch.probability for branch in branches])
    chosen = [
        branch.posterior.shares[random.permutation(len(branch.posterior.shares))[:number]]
        for branch, number in zip(branches, numbers, strict=True)
        if branch.posterior is not None
    ]
    return np.concatenate(chosen)
