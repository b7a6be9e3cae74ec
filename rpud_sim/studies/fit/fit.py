"""Fit: the best point, the targets beside it, and intervals if the model reaches the targets.

The intervals are proved by fits to synthetic drills with known parameters.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.foundation.whole_folder import write_whole
from rpud_sim.studies.fit.posterior import LEVEL, Interval, Ridge, identify, interval_shares
from rpud_sim.studies.fit.rounds import (
    CANDIDATE,
    FINAL,
    SAMPLING,
    Branch,
    FitError,
    FitFolder,
    explore,
    named_points,
    pool,
    unfinished,
)
from rpud_sim.studies.fit.surrogate import Region
from rpud_sim.studies.fit.target_file import FitSpecification, FitTarget
from rpud_sim.studies.store import Report

CANDIDATES = 16  # for the best point
CANDIDATE_RUNS = 32
BEST_RUNS = 64
_FAR = 3.0  # deviation from which on the model does not reach a target
_DIGITS = 4  # of the best point, unless its interval is narrower

# Of the proof.
_MOST_RUNS = 8  # whose mean a synthetic target is
_CONFIDENCE = 0.99  # of the interval, by Clopper and Pearson, of a covered share
_DRAWN = 7  # second number of the seeds here; those of a fit are smaller


@dataclasses.dataclass(frozen=True)
class TargetComparison:
    """Target beside the model at the best point."""

    target: FitTarget  # of the fit
    mean: float  # of the model's runs
    standard_error: float  # of the mean
    spread: float  # standard deviation of single runs

    @property
    def ratio(self) -> float:
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

    specification: FitSpecification  # of the fit
    best: Mapping[str, Any]  # values of all unknowns at the best point, by name
    comparisons: tuple[TargetComparison, ...]  # by target
    refusal: str  # why there are no intervals; empty if there are
    shares: np.ndarray  # equally probable points of the posterior over all choices
    intervals: Mapping[str, Interval]  # of the posterior, by unknown; none if refused
    ridges: tuple[Ridge, ...]  # pairs that the targets determine only together; none if refused
    probabilities: tuple[tuple[Mapping[str, Any], float], ...]  # of the combinations of choices
    simulations: int  # runs of this call
    kept: int  # runs of earlier calls

    @property
    def samples(self) -> Mapping[str, np.ndarray]:
        """The points of the posterior in SI units, by unknown."""
        return self.specification.values_at(self.shares)

    @property
    def missed(self) -> tuple[TargetComparison, ...]:
        """Targets that the fit used and the model does not reach."""
        used = (item for item in self.comparisons if not item.target.hold_out)
        return tuple(item for item in used if not item.reached)

    @property
    def reached(self) -> bool:
        """Whether the model reaches every target that the fit used."""
        return not self.missed

    @property
    def choices(self) -> list[tuple[str, str]]:
        """Combinations of choices with their probabilities, in words; empty without choices."""
        return [
            (", ".join(f"{name} {value}" for name, value in choices.items()), f"{share:.3f}")
            for choices, share in self.probabilities
            if choices
        ]

    def misfit(self, hold_out: bool) -> float | None:
        """Return the root mean square of the deviations; None without such targets."""
        found = [c.deviation for c in self.comparisons if c.target.hold_out == hold_out]
        return float(np.sqrt(np.mean(np.square(found)))) if found else None

    @property
    def misfit_text(self) -> str:
        hold_out = self.misfit(True)
        more = "" if hold_out is None else f", held out {hold_out:.2f}"
        return f"{self.misfit(False):.2f} standard deviations{more}"


def most_simulations(specification: FitSpecification) -> int:
    """Return the greatest number of runs of a fit."""
    rounds = len(specification.combinations) * specification.rounds
    designs = rounds * specification.points * specification.repeat
    return designs + CANDIDATES * CANDIDATE_RUNS + BEST_RUNS


def run_fit(
    specification: FitSpecification, out: Path, workers: int, report: Report = lambda runs: None
) -> Fit:
    """Fit the drill in a new folder, or one with simulations of an earlier call of the same fit."""
    folder = FitFolder(out, specification, workers, report)
    with folder.held():
        return fit_in(folder, specification)


def fit_in(folder: FitFolder, specification: FitSpecification) -> Fit:
    """Fit the drill in a folder that is held; see ``run_fit``."""
    branches = explore(folder, specification)
    shares = pool(branches, np.random.default_rng([specification.seed, SAMPLING, 1 << 20]))
    branch = max(branches, key=lambda branch: branch.probability)
    box = Region(*interval_shares(shares))
    outside = not box.holds(branch.posterior.shares).any()
    best, runs = _best(folder, specification, branch, branch.region if outside else box)
    comparisons = _compared(specification, runs)
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
        *(({}, ()) if refusal else identify(shares, specification.unknowns)),
        tuple((branch.choices, branch.probability) for branch in branches),
        folder.simulated,
        folder.kept,
    )


def _best(
    folder: FitFolder, specification: FitSpecification, branch: Branch, box: Region
) -> tuple[dict[str, Any], np.ndarray]:
    """Return the best point of a box, chosen among candidates by simulation, and its runs."""
    probable = branch.posterior.shares[np.argsort(-branch.posterior.log_likelihood)]
    probable = probable[box.holds(probable)]
    # The most probable one, and others down to the middle of all, ever further apart.
    places = np.geomspace(1, max(len(probable) // 2, 1), CANDIDATES).astype(int) - 1
    shares = probable[np.unique(places)]
    low, high = (specification.values_at(side[None]) for side in (box.low, box.high))
    points = [
        {
            name: _rounded(value, low[name].item(), high[name].item()) if name in low else value
            for name, value in point.items()
        }
        for point in named_points(specification, shares, branch.choices)
    ]
    seed = specification.seed
    runs = folder.simulate("candidates", points, CANDIDATE_RUNS, (seed, CANDIDATE))
    best = points[int(np.argmin([_loss(_compared(specification, figures)) for figures in runs]))]
    return best, folder.simulate("best", [best], BEST_RUNS, (seed, FINAL))[0]


def _rounded(value: float, low: float, high: float) -> float:
    """Return a value between two others with few digits, as a parameter file shall have it."""
    for digits in range(_DIGITS, 17):
        rounded = float(f"{value:.{digits}g}")
        if low <= rounded <= high:
            return rounded
    return min(max(value, low), high)


def _compared(specification: FitSpecification, runs: np.ndarray) -> tuple[TargetComparison, ...]:
    """Return the targets beside runs at one point, shape (runs, targets)."""
    found = []
    for target, column in zip(specification.targets, runs.T, strict=True):
        spread = float(column.std(ddof=1))
        error = spread / math.sqrt(len(column))
        found.append(TargetComparison(target, float(column.mean()), error, spread))
    return tuple(found)


def _loss(comparisons: tuple[TargetComparison, ...]) -> float:
    """Return the sum of squared deviations of the targets; infinite if a run lacks a figure."""
    total = math.fsum(item.deviation**2 for item in comparisons if not item.target.hold_out)
    return total if math.isfinite(total) else math.inf


def proof_simulations(specification: FitSpecification, drills: int) -> int:
    """Return the number of runs of a proof; each drill reads those of the first round again."""
    design = len(specification.combinations) * specification.points * specification.repeat
    return design * drills * specification.rounds + drills * _runs(specification)


def run_proof(
    specification: FitSpecification,
    out: Path,
    workers: int,
    drills: int,
    report: Report = lambda runs: None,
) -> dict[str, Any]:
    """Fit synthetic drills, drawn evenly between the bounds, in a folder as of ``run_fit``.

    All fits share the first round. The targets' values are those of the synthetic drill, with an
    error drawn from the tolerances. The result is plain values, also in ``proof.json``.
    """
    folder = FitFolder(out, specification, workers, report)
    with folder.held():
        proof = _prove(folder, specification, drills, report)
        write_whole(out / "proof.json", f"{json.dumps(proof, indent=1)}\n")
    return proof


def _prove(
    folder: FitFolder, specification: FitSpecification, drills: int, report: Report
) -> dict[str, Any]:
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
            branches = []
        if not branches or unfinished(own, branches):
            refused += 1
            continue
        low, high = interval_shares(pool(branches, random))
        inside.append((shares[i] >= low) & (shares[i] <= high))
        probabilities.append(sum(b.probability for b in branches if b.number == number))
    if not inside:
        raise FitError("no synthetic drill has intervals")
    covered = {}
    for name, count in zip(specification.unknowns, np.sum(inside, axis=0).tolist(), strict=True):
        ends = stats.binomtest(count, len(inside)).proportion_ci(_CONFIDENCE)
        interval = [float(end) for end in ends]
        covered[name] = {"count": count, "share": count / len(inside), "interval": interval}
    intervals = [each["interval"] for each in covered.values()]
    return {
        "drills": len(inside),
        "refused": refused,
        "level": LEVEL,
        "covered": covered,
        "confidence": _CONFIDENCE,
        # Each unknown is covered as often as its interval says, up to chance.
        "holds": all(low <= LEVEL <= high for low, high in intervals),
        "true_choice_probability": float(np.mean(probabilities)),
    }


def _with_error(
    targets: tuple[FitTarget, ...], runs: np.ndarray, random: np.random.Generator
) -> tuple[FitTarget, ...]:
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


def _runs(specification: FitSpecification) -> int:
    return min(_MOST_RUNS, max(target.runs for target in specification.targets))
