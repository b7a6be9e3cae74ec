"""Fit: rounds of simulations, surrogates and posteriors, and the best point they lead to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.studies.fit.branches import (
    CANDIDATE,
    FINAL,
    SAMPLING,
    Branch,
    Round,
    add_design,
    named_points,
    next_region,
    pool,
    to_round,
    update,
    weigh,
)
from rpud_sim.studies.fit.design import Region, values_at
from rpud_sim.studies.fit.folder import FitFolder, Report
from rpud_sim.studies.fit.identifiability import Identifiability, identify
from rpud_sim.studies.fit.posterior import Likelihood, maximum
from rpud_sim.studies.fit.specification import Specification, Target

CANDIDATES = 16  # for the best point
CANDIDATE_RUNS = 32
BEST_RUNS = 64
_FAR = 3.0  # deviation from which on the model does not reach a target
_DIGITS = 4  # of the best point


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Target beside the model at the best point."""

    target: Target  # of the fit
    mean: float  # of the model's runs
    standard_error: float  # of the mean
    spread: float  # standard deviation of single runs
    low: float  # 5 % quantile of what the posterior predicts for the target
    high: float  # 95 % quantile

    @property
    def ratio(self) -> float:
        """Model over target."""
        return self.mean / self.target.value if self.target.value else math.nan

    @property
    def deviation(self) -> float:
        """Difference in standard deviations of tolerance, chance and the mean's own error."""
        chance = self.spread / math.sqrt(self.target.runs)
        total = math.sqrt(self.target.tolerance**2 + chance**2 + self.standard_error**2)
        return (self.mean - self.target.value) / total


@dataclasses.dataclass(frozen=True)
class Fit:
    """Result of a fit."""

    specification: Specification  # of the fit
    best: Mapping[str, Any]  # values of all unknowns at the best point, by name
    shares: np.ndarray  # equally probable points of the posterior over all choices
    samples: Mapping[str, np.ndarray]  # the same in SI units, by unknown
    identifiability: Identifiability  # what the targets determine
    probabilities: tuple[tuple[Mapping[str, Any], float], ...]  # of the combinations of choices
    comparisons: tuple[Comparison, ...]  # by target
    rounds: tuple[Round, ...]  # accounts of the rounds
    simulations: int  # runs of this call
    kept: int  # runs of earlier calls

    @property
    def reached(self) -> bool:
        """Whether every target that the fit used is within three standard deviations."""
        used = (c for c in self.comparisons if not c.target.hold_out)
        return all(abs(c.deviation) <= _FAR for c in used)

    def misfit(self, hold_out: bool) -> float | None:
        """Return the root mean square of the deviations; None without such targets."""
        found = [c.deviation for c in self.comparisons if c.target.hold_out == hold_out]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None


def most_simulations(specification: Specification) -> int:
    """Return the greatest number of runs of a fit."""
    rounds = len(specification.combinations) * specification.rounds
    designs = rounds * specification.points * specification.repeat
    return designs + CANDIDATES * CANDIDATE_RUNS + BEST_RUNS


def run_fit(
    specification: Specification, out: Path, workers: int, report: Report = lambda runs: None
) -> Fit:
    """Fit the drill, with the simulations that are in the folder already.

    Args:
        out: its folder; new, or left by an earlier call of the same fit.
        report: called with the number of runs that finished since its last call.

    Raises:
        ParameterError: if the folder holds anything else.
        FitError: if no point gives all figures, or none explains the targets.
        WorkerError: if the workers fail.
        OSError: if a file cannot be written.
    """
    folder = FitFolder(out, specification, workers, report)
    with folder.held():
        return fit_in(folder, specification)


def fit_in(folder: FitFolder, specification: Specification) -> Fit:
    """Fit the drill in a folder that is held; see ``run_fit``."""
    count = len(specification.unknowns)
    empty = np.empty((0, specification.repeat, len(specification.targets)))
    branches = [
        Branch(number, choices, Region.whole(count), np.empty((0, count)), empty)
        for number, choices in enumerate(specification.combinations)
    ]
    rounds: list[Round] = []
    for number in range(specification.rounds):
        for branch in branches:
            add_design(folder, specification, branch, number)
            update(specification, branch, number)
        branches = weigh(branches)
        rounds += [to_round(branch, number + 1) for branch in branches]
        if number + 1 < specification.rounds:
            for branch in branches:
                branch.region = next_region(branch)
    best, comparisons = _best(folder, specification, branches)
    shares = pool(branches, np.random.default_rng([specification.seed, SAMPLING, 1 << 20]))
    samples = values_at(specification, shares)
    return Fit(
        specification,
        best,
        shares,
        samples,
        identify(shares, samples),
        tuple((branch.choices, branch.probability) for branch in branches),
        comparisons,
        tuple(rounds),
        folder.simulated,
        folder.kept,
    )


def _best(
    folder: FitFolder, specification: Specification, branches: list[Branch]
) -> tuple[dict[str, Any], tuple[Comparison, ...]]:
    """Return the best point, chosen among candidates by simulation, and the targets beside it."""
    branch = max(branches, key=lambda branch: branch.probability)
    assert branch.surrogate is not None
    assert branch.posterior is not None
    likelihood = Likelihood(branch.surrogate, specification.targets)
    order = np.argsort(-branch.posterior.log_likelihood)
    places = np.unique(np.geomspace(1, len(order) // 2, CANDIDATES - 1).astype(int) - 1)
    places = np.concatenate([places, np.arange(len(order))])[: CANDIDATES - 1]
    shares = np.concatenate(
        [[maximum(likelihood, branch.posterior)], branch.posterior.shares[order[places]]]
    )
    points = [
        {name: _rounded(specification, name, value) for name, value in point.items()}
        for point in named_points(specification, shares, branch.choices)
    ]
    seed = specification.seed
    runs = folder.simulate("candidates", points, CANDIDATE_RUNS, (seed, CANDIDATE))
    loss = [_loss(specification, figures) for figures in runs]
    best = points[int(np.argmin(loss))]
    runs = folder.simulate("best", [best], BEST_RUNS, (seed, FINAL))[0]
    mean, covariance = likelihood.expected(branch.posterior.shares)
    random = np.random.default_rng([seed, FINAL, 1])
    own = np.array([np.diag(likelihood.tolerance)])
    spread = np.sqrt(np.maximum(np.diagonal(covariance, axis1=1, axis2=2) - own, 0.0))
    drawn = branch.surrogate.restore(mean + spread * random.standard_normal(mean.shape))
    low, high = np.quantile(drawn, (0.05, 0.95), axis=0)
    comparisons = tuple(
        Comparison(
            target,
            float(np.nanmean(runs[:, i])),
            float(np.nanstd(runs[:, i], ddof=1) / math.sqrt(len(runs))),
            float(np.nanstd(runs[:, i], ddof=1)),
            float(low[i]),
            float(high[i]),
        )
        for i, target in enumerate(specification.targets)
    )
    return best, comparisons


def _rounded(specification: Specification, name: str, value: Any) -> Any:
    """Return a value with as many digits as a parameter file shall have, inside its bounds."""
    if name not in specification.unknowns:
        return value
    bounds = specification.unknowns[name]
    return min(max(float(f"{value:.{_DIGITS}g}"), bounds.minimum), bounds.maximum)


def _loss(specification: Specification, figures: np.ndarray) -> float:
    """Return the sum of squared deviations of the targets, from runs at one point."""
    total = 0.0
    for i, target in enumerate(specification.targets):
        if not target.hold_out:
            runs = figures[:, i]
            if not np.isfinite(runs).all():
                return math.inf
            chance = runs.var(ddof=1) * (1.0 / target.runs + 1.0 / len(runs))
            total += (runs.mean() - target.value) ** 2 / (target.tolerance**2 + chance)
    return float(total)
