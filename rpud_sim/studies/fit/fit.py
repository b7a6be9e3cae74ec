"""Fit: rounds of simulations, surrogates and posteriors, and the best point they lead to."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.studies.fit.design import Region, sobol_points, values_at
from rpud_sim.studies.fit.folder import FitFolder, Report
from rpud_sim.studies.fit.identifiability import Identifiability, identify
from rpud_sim.studies.fit.posterior import Likelihood, Posterior, maximum, sample
from rpud_sim.studies.fit.specification import Specification, Target
from rpud_sim.studies.fit.surrogate import Surrogate, SurrogateError, fit_surrogate

PARTICLES = 4096
CANDIDATES = 16  # for the best point
CANDIDATE_RUNS = 32
BEST_RUNS = 64
_LEAST_PROBABILITY = 1e-4  # of a combination of choices that is followed further
_PADDING = 0.25  # of the posterior's width, added to the next region on both sides
_LEAST_WIDTH = 0.01  # of a region
_TAIL = 0.002
_FAR = 3.0  # deviation from which on the model does not reach a target
_DIGITS = 4  # of the best point

# What is drawn, as the second number of a seed.
_DESIGN, _PHASES, _SAMPLING, _CANDIDATES, _BEST = range(5)


class FitError(RuntimeError):
    """Fit that has no result; the text gives the reason in one line."""


@dataclasses.dataclass
class Branch:
    """Progress for one combination of choices.

    Args:
        number: of the combination.
        choices: their values, by name.
        region: of the present round.
        shares: simulated points in it, shape (points, unknowns).
        figures: of their runs, shape (points, repeat, targets).
        surrogate: of the figures; None if too few points have them.
        posterior: of the unknowns.
        probability: of the combination.
    """

    number: int
    choices: dict[str, Any]
    region: Region
    shares: np.ndarray
    figures: np.ndarray
    surrogate: Surrogate | None = None
    posterior: Posterior | None = None
    probability: float = 0.0


@dataclasses.dataclass(frozen=True)
class Round:
    """Account of a round for one combination of choices.

    Args:
        number: of the round, from 1.
        choices: the combination.
        volume: of the region, as a share of that between all bounds.
        points: that the surrogate was fitted to.
        degrees: of its polynomials, by target.
        errors: of the surrogate, standard deviations as they are fitted, by target.
        probability: of the combination.
    """

    number: int
    choices: Mapping[str, Any]
    volume: float
    points: int
    degrees: tuple[int, ...]
    errors: tuple[float, ...]
    probability: float


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Target beside the model at the best point.

    Args:
        target: of the fit.
        mean: of the model's runs.
        standard_error: of the mean.
        spread: standard deviation of single runs.
        low: 5 % quantile of what the posterior predicts for the target.
        high: 95 % quantile.
    """

    target: Target
    mean: float
    standard_error: float
    spread: float
    low: float
    high: float

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
    """Result of a fit.

    Args:
        specification: of the fit.
        best: values of all unknowns at the best point, by name.
        shares: equally probable points of the posterior over all choices.
        samples: the same in SI units, by unknown.
        identifiability: what the targets determine.
        probabilities: of the combinations of choices.
        comparisons: by target.
        rounds: accounts of the rounds.
        simulations: runs of this call.
        kept: runs of earlier calls.
    """

    specification: Specification
    best: Mapping[str, Any]
    shares: np.ndarray
    samples: Mapping[str, np.ndarray]
    identifiability: Identifiability
    probabilities: tuple[tuple[Mapping[str, Any], float], ...]
    comparisons: tuple[Comparison, ...]
    rounds: tuple[Round, ...]
    simulations: int
    kept: int

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
        specification: of the fit.
        out: its folder; new, or left by an earlier call of the same fit.
        workers: number of processes.
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
            _update(specification, branch, number)
        branches = weigh(branches)
        rounds += [_account(branch, number + 1) for branch in branches]
        if number + 1 < specification.rounds:
            for branch in branches:
                branch.region = _next_region(branch)
    best, comparisons = _best(folder, specification, branches)
    shares = pool(branches, np.random.default_rng([specification.seed, _SAMPLING, 1 << 20]))
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


def add_design(
    folder: FitFolder, specification: Specification, branch: Branch, number: int
) -> None:
    """Simulate the design of a round in a branch's region."""
    seed = specification.seed
    shares = sobol_points(
        branch.region, specification.points, (seed, _DESIGN, number, branch.number)
    )
    figures = folder.simulate(
        f"round_{number + 1:02}_{branch.number:02}",
        named_points(specification, shares, branch.choices),
        specification.repeat,
        (seed, _PHASES, number, branch.number),
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


def _update(specification: Specification, branch: Branch, number: int) -> None:
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
    random = np.random.default_rng([specification.seed, _SAMPLING, number, branch.number])
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


def _next_region(branch: Branch) -> Region:
    """Return a box around the posterior; it may also grow where the posterior meets its side."""
    assert branch.posterior is not None
    low, high = np.quantile(branch.posterior.shares, (_TAIL, 1.0 - _TAIL), axis=0)
    pad = _PADDING * (high - low) + 0.5 * np.maximum(_LEAST_WIDTH - (high - low), 0.0)
    return Region(np.maximum(low - pad, 0.0), np.minimum(high + pad, 1.0))


def _account(branch: Branch, number: int) -> Round:
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
    runs = folder.simulate("candidates", points, CANDIDATE_RUNS, (seed, _CANDIDATES))
    loss = [_loss(specification, figures) for figures in runs]
    best = points[int(np.argmin(loss))]
    runs = folder.simulate("best", [best], BEST_RUNS, (seed, _BEST))[0]
    mean, covariance = likelihood.expected(branch.posterior.shares)
    random = np.random.default_rng([seed, _BEST, 1])
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
