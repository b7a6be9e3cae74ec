"""Fit: the best point, the targets beside it, and intervals if the model reaches the targets."""

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
    explore,
    named_points,
    pool,
    unfinished,
)
from rpud_sim.studies.fit.design import Region, values_at
from rpud_sim.studies.fit.folder import FitFolder, Report
from rpud_sim.studies.fit.identifiability import Identifiability, identify, interval_shares
from rpud_sim.studies.fit.specification import Specification, Target

CANDIDATES = 16  # for the best point
CANDIDATE_RUNS = 32
BEST_RUNS = 64
_FAR = 3.0  # deviation from which on the model does not reach a target
_DIGITS = 4  # of the best point, unless its interval is narrower


@dataclasses.dataclass(frozen=True)
class Comparison:
    """Target beside the model at the best point."""

    target: Target  # of the fit
    mean: float  # of the model's runs
    standard_error: float  # of the mean
    spread: float  # standard deviation of single runs

    @property
    def ratio(self) -> float:
        """Model over target."""
        return self.mean / self.target.value if self.target.value else math.nan

    @property
    def deviation(self) -> float:
        """Difference in standard deviations of tolerance, chance and the mean's own error."""
        total = math.hypot(self.target.error(self.spread), self.standard_error)
        return (self.mean - self.target.value) / total

    @property
    def reached(self) -> bool:
        """Whether the model is within three standard deviations of the target."""
        return abs(self.deviation) <= _FAR

    @property
    def miss(self) -> str:
        """By how much the model misses the target, in words."""
        difference = self.mean - self.target.value
        amount = f"{abs(difference):.4g} {self.target.measure.unit}".rstrip()
        side = "high" if difference > 0.0 else "low"
        far = f"{abs(self.deviation):.3g} standard deviations"
        return f"{self.target.title}: {amount} too {side}, {far}"

    def __str__(self) -> str:
        value = f"{self.target.value:.4g} {self.target.measure.unit}".rstrip()
        held = " (held out)" if self.target.hold_out else ""
        return f"{self.target.title}: {value}, model {self.mean:.4g}, ratio {self.ratio:.3f}{held}"


@dataclasses.dataclass(frozen=True)
class Fit:
    """Result of a fit."""

    specification: Specification  # of the fit
    best: Mapping[str, Any]  # values of all unknowns at the best point, by name
    comparisons: tuple[Comparison, ...]  # by target
    refusal: str  # why there are no intervals; empty if there are
    shares: np.ndarray  # equally probable points of the posterior over all choices
    found: Identifiability | None  # what the targets determine; None without intervals
    probabilities: tuple[tuple[Mapping[str, Any], float], ...]  # of the combinations of choices
    simulations: int  # runs of this call
    kept: int  # runs of earlier calls

    @property
    def samples(self) -> Mapping[str, np.ndarray]:
        """The points of the posterior in SI units, by unknown."""
        return values_at(self.specification, self.shares)

    @property
    def missed(self) -> tuple[Comparison, ...]:
        """Targets that the fit used and the model does not reach."""
        used = (item for item in self.comparisons if not item.target.hold_out)
        return tuple(item for item in used if not item.reached)

    @property
    def reached(self) -> bool:
        """Whether the model reaches every target that the fit used."""
        return not self.missed

    @property
    def choices(self) -> tuple[tuple[str, float], ...]:
        """Combinations of choices in words, with their probabilities; empty without choices."""
        texts = [
            (", ".join(f"{name} {value}" for name, value in choices.items()), share)
            for choices, share in self.probabilities
        ]
        return tuple((text, share) for text, share in texts if text)

    def misfit(self, hold_out: bool) -> float | None:
        """Return the root mean square of the deviations; None without such targets."""
        found = [c.deviation for c in self.comparisons if c.target.hold_out == hold_out]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None

    @property
    def misfit_text(self) -> str:
        """Both misfits in words."""
        hold_out = self.misfit(True)
        more = "" if hold_out is None else f", held out {hold_out:.2f}"
        return f"{self.misfit(False):.2f} standard deviations{more}"


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
    """
    folder = FitFolder(out, specification, workers, report)
    with folder.held():
        return fit_in(folder, specification)


def fit_in(folder: FitFolder, specification: Specification) -> Fit:
    """Fit the drill in a folder that is held; see ``run_fit``."""
    branches = explore(folder, specification)
    shares = pool(branches, np.random.default_rng([specification.seed, SAMPLING, 1 << 20]))
    branch = max(branches, key=lambda branch: branch.probability)
    box = Region(*interval_shares(shares))
    assert branch.posterior is not None
    outside = not box.holds(branch.posterior.shares).any()
    best, runs = _best(folder, specification, branch, branch.region if outside else box)
    comparisons = tuple(
        Comparison(
            target,
            float(runs[:, i].mean()),
            float(runs[:, i].std(ddof=1) / math.sqrt(len(runs))),
            float(runs[:, i].std(ddof=1)),
        )
        for i, target in enumerate(specification.targets)
    )
    used = [item for item in comparisons if not item.target.hold_out]
    missed = sum(not item.reached for item in used)
    refusal = ""
    if missed:
        refusal = f"the model does not reach {missed} of {len(used)} targets"
    elif cut := unfinished(specification, branches):
        refusal = (
            f"the last round's region cuts off the probable values of {', '.join(cut)}: "
            "use more rounds"
        )
    elif outside:
        refusal = "the best point, of the most probable choices, is outside of them"
    return Fit(
        specification,
        best,
        comparisons,
        refusal,
        shares,
        None if refusal else identify(shares, specification.unknowns),
        tuple((branch.choices, branch.probability) for branch in branches),
        folder.simulated,
        folder.kept,
    )


def _best(
    folder: FitFolder, specification: Specification, branch: Branch, box: Region
) -> tuple[dict[str, Any], np.ndarray]:
    """Return the best point of a box, chosen among candidates by simulation, and its runs."""
    assert branch.posterior is not None
    probable = branch.posterior.shares[np.argsort(-branch.posterior.log_likelihood)]
    probable = probable[box.holds(probable)]
    # The most probable one, and others down to the middle of all, ever further apart.
    places = np.geomspace(1, max(len(probable) // 2, 1), CANDIDATES).astype(int) - 1
    shares = probable[np.unique(places)]
    low, high = (values_at(specification, side[None]) for side in (box.low, box.high))
    points = [
        {
            name: _rounded(value, low[name].item(), high[name].item()) if name in low else value
            for name, value in point.items()
        }
        for point in named_points(specification, shares, branch.choices)
    ]
    seed = specification.seed
    runs = folder.simulate("candidates", points, CANDIDATE_RUNS, (seed, CANDIDATE))
    best = points[int(np.argmin([_loss(specification, figures) for figures in runs]))]
    return best, folder.simulate("best", [best], BEST_RUNS, (seed, FINAL))[0]


def _rounded(value: float, low: float, high: float) -> float:
    """Return a value between two others with few digits, as a parameter file shall have it."""
    for digits in range(_DIGITS, 17):
        rounded = float(f"{value:.{digits}g}")
        if low <= rounded <= high:
            return rounded
    return min(max(value, low), high)


def _loss(specification: Specification, figures: np.ndarray) -> float:
    """Return the sum of squared deviations of the targets, from runs at one point."""
    total = 0.0
    for i, target in enumerate(specification.targets):
        if not target.hold_out:
            runs = figures[:, i]
            if not np.isfinite(runs).all():
                return math.inf
            spread = runs.std(ddof=1)
            error = math.hypot(target.error(spread), spread / math.sqrt(len(runs)))
            total += ((runs.mean() - target.value) / error) ** 2
    return float(total)
