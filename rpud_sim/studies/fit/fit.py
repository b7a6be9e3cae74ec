"""Fit: designs in a shrinking region, the best point, the targets beside it, and intervals.

There is one branch for each combination of choices. The intervals are proved by fits to synthetic
drills with known parameters.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.foundation.whole_folder import whole_file, write_whole
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.fit.measures import measure
from rpud_sim.studies.fit.posterior import (
    IMPOSSIBLE,
    LEVEL,
    Emulator,
    EmulatorError,
    Likelihood,
    Posterior,
    Region,
    cut_off,
    identify,
    interval_shares,
    sample,
)
from rpud_sim.studies.fit.result import BEST_RUNS, Fit, TargetComparison, fit_versions
from rpud_sim.studies.fit.target_file import FitSpecification, FitTarget
from rpud_sim.studies.store import Report, StudyStore
from rpud_sim.studies.workers import check_versions

POOLED = 4096  # points of the posterior over all choices
_DIGITS = 4  # of the best point, unless its interval is narrower
_CHUNK = 100.0  # simulated time in a chunk [s]: a fraction of a second of work
_MOST_POINTS = 64  # of a chunk
_LEAST_PROBABILITY = 1e-4  # of a combination of choices that is followed further
_PADDING = 0.25  # of the posterior's width, added to the next region on both sides
_LEAST_WIDTH = 0.01  # of a region
_TAIL = 0.002
_SEEN = 0.01  # probability of a combination of choices that an interval depends on
_MOST_RUNS = 8  # that are averaged for a synthetic target
_CONFIDENCE = 0.99  # of the interval, by Clopper and Pearson, of a covered share

# What is drawn, as the second number of a seed.
_DESIGN, _PHASES, _SAMPLING, _FINAL, _PROOF = range(5)


class FitError(ExpectedError, RuntimeError):
    """Fit that has no result; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class FitChunk:
    """Points of a design with the same choices."""

    job: str  # name of the design
    number: int  # of the chunk in it
    specification: FitSpecification  # of the fit
    points: Sequence[Mapping[str, Any]]  # values of all unknowns at each point
    phases: np.ndarray  # initial phases [cycles], shape (points, repeat, conditions)
    versions: Mapping[str, str]  # of everything that determines the results

    @property
    def shape(self) -> tuple[int, int, int]:
        """Numbers of points, runs at each, and targets."""
        return *self.phases.shape[:2], len(self.specification.targets)

    @property
    def count(self) -> int:
        return math.prod(self.shape[:2])


def simulate(chunk: FitChunk) -> np.ndarray:
    """Return the targets' measures of all runs, of the chunk's shape; NaN if missing."""
    check_versions(chunk.versions)
    specification = chunk.specification
    found = np.full(chunk.shape, np.nan)
    for number, condition in enumerate(specification.conditions):
        places = np.flatnonzero(specification.condition_numbers == number)
        measures = [specification.targets[i].measure for i in places]
        for point, values in enumerate(chunk.points):
            try:
                configuration = specification.configuration(values, condition)
                for member, phase in enumerate(chunk.phases[point, :, number].tolist()):
                    found[point, member, places] = measure(configuration, phase, measures)
            except (EngineError, ParameterError):
                continue  # NaN: the emulator leaves such points out
    return found


class FitFolder(StudyStore[FitChunk, np.ndarray]):
    """Folder of a fit, and the simulations in it."""

    def __init__(
        self, path: Path, specification: FitSpecification, workers: int, report: Report
    ) -> None:
        content = {"specification": dataclasses.asdict(specification), "versions": fit_versions()}
        super().__init__(path, content, "fit", report)
        self._specification = specification
        self._workers = workers

    def simulate(
        self, job: str, points: Sequence[Mapping[str, Any]], repeat: int, seed: Sequence[int]
    ) -> np.ndarray:
        """Return the measures at points, shape (points, repeat, targets).

        Those that an earlier call has simulated for the job of this name are read.
        """
        specification = self._specification
        spread = specification.phase_spread
        shape = (len(points), repeat, len(specification.conditions))
        phases = np.mod(np.random.default_rng(seed).uniform(-spread, spread, shape), 1.0)
        longest = max(target.measure.end for target in specification.targets)
        runs = repeat * len(specification.conditions)
        size = min(max(1, round(_CHUNK / max(longest * runs, 1e-3))), _MOST_POINTS)
        versions = engine_versions()
        chunks = [
            FitChunk(
                job, number, specification, points[i : i + size], phases[i : i + size], versions
            )
            for number, i in enumerate(range(0, len(points), size))
        ]

        def prepare() -> None:
            drill = specification.configuration(points[0], specification.conditions[0])
            compile_kernels(drill)

        self.finish(chunks, simulate, prepare, self._workers)
        return np.concatenate([np.load(self._path(chunk)) for chunk in chunks])

    def has(self, chunk: FitChunk) -> bool:
        try:
            return np.load(self._path(chunk), allow_pickle=False).shape == chunk.shape
        except (OSError, ValueError, EOFError):
            return False

    def add(self, chunk: FitChunk, outcome: np.ndarray) -> None:
        path = self._path(chunk)
        path.parent.mkdir(exist_ok=True)
        with whole_file(path) as unfinished, unfinished.open("wb") as file:
            np.save(file, outcome, allow_pickle=False)

    def _path(self, chunk: FitChunk) -> Path:
        return self.path / "simulations" / f"{chunk.job}_{chunk.number:05}.npy"


@dataclasses.dataclass
class Branch:
    """Progress for one combination of choices."""

    number: int  # of the combination
    choices: dict[str, Any]  # their values, by name
    region: Region  # of the present round
    shares: np.ndarray  # simulated points in it, shape (points, unknowns)
    figures: np.ndarray  # of their runs, shape (points, repeat, targets)
    posterior: Posterior = IMPOSSIBLE  # of the unknowns; that if too few points have the figures
    probability: float = 0.0  # of the combination


def explore(folder: FitFolder, specification: FitSpecification, drill: str = "") -> list[Branch]:
    """Return the probable branches after all rounds.

    ``drill`` is a prefix of the later rounds' files; the first one does not depend on the targets.
    """
    count, seed = len(specification.unknowns), specification.seed
    empty = np.empty((0, specification.repeat, len(specification.targets)))
    branches = [
        Branch(number, choices, Region.whole(count), np.empty((0, count)), empty)
        for number, choices in enumerate(specification.combinations)
    ]
    for number in range(specification.rounds):
        for branch in branches:
            if number:
                branch.region = next_region(branch)
            own = number, branch.number
            random = np.random.default_rng([seed, _DESIGN, *own])
            shares = branch.region.points(specification.points, random)
            figures = folder.simulate(
                f"{drill if number else ''}round_{number + 1:02}_{branch.number:02}",
                _named_points(specification, shares, branch.choices),
                specification.repeat,
                (seed, _PHASES, *own),
            )
            inside = branch.region.holds(branch.shares)
            branch.shares = np.concatenate([branch.shares[inside], shares])
            branch.figures = np.concatenate([branch.figures[inside], figures])
            branch.posterior = _posterior(specification, branch, own)
        branches = _weigh(branches)
    return branches


def _named_points(
    specification: FitSpecification, shares: np.ndarray, choices: Mapping[str, Any]
) -> list[dict[str, Any]]:
    values = specification.values_at(shares)
    return [
        {**{name: column[i].item() for name, column in values.items()}, **choices}
        for i in range(len(shares))
    ]


def _posterior(specification: FitSpecification, branch: Branch, seed: tuple[int, int]) -> Posterior:
    groups = specification.condition_numbers
    try:
        emulator = Emulator(branch.region, branch.shares, branch.figures, groups)
    except EmulatorError as error:
        if len(specification.combinations) == 1:
            raise FitError(str(error)) from None
        return IMPOSSIBLE
    random = np.random.default_rng([specification.seed, _SAMPLING, *seed])
    return sample(Likelihood(emulator, specification.targets), random)


def _weigh(branches: list[Branch]) -> list[Branch]:
    """Return the branches that are probable enough, with their probabilities."""
    found = [branch for branch in branches if math.isfinite(branch.posterior.log_evidence)]
    if not found:
        raise FitError(
            "no point between the bounds gives these figures; move the bounds of the unknowns"
        )
    logs = np.array([branch.posterior.log_evidence for branch in found])
    weights = np.exp(logs - logs.max())
    weights *= weights / weights.sum() >= _LEAST_PROBABILITY
    for branch, weight in zip(found, weights / weights.sum(), strict=True):
        branch.probability = float(weight)
    return [branch for branch in found if branch.probability]


def next_region(branch: Branch) -> Region:
    """Return a box around the posterior; it may also grow where the posterior meets its side."""
    low, high = np.quantile(branch.posterior.shares, (_TAIL, 1.0 - _TAIL), axis=0)
    pad = _PADDING * (high - low) + 0.5 * np.maximum(_LEAST_WIDTH - (high - low), 0.0)
    return Region(np.maximum(low - pad, 0.0), np.minimum(high + pad, 1.0))


def unfinished(specification: FitSpecification, branches: list[Branch]) -> list[str]:
    """Return the unknowns whose posterior the region of the last round cuts off."""
    found: dict[str, None] = {}
    for branch in branches:
        if branch.probability < _SEEN:
            continue
        region = branch.region
        low, high = cut_off(branch.posterior.shares, region.low, region.high)
        inner = low & (region.low > 0.0) | high & (region.high < 1.0)
        found |= {n: None for n, cut in zip(specification.unknowns, inner, strict=True) if cut}
    return list(found)


def _pool(branches: list[Branch], random: np.random.Generator) -> np.ndarray:
    """Return points of all branches' posteriors, each as often as its branch is probable."""
    numbers = random.multinomial(POOLED, [branch.probability for branch in branches])
    chosen = [
        random.choice(branch.posterior.shares, number, axis=0)
        for branch, number in zip(branches, numbers, strict=True)
    ]
    return np.concatenate(chosen)


def most_simulations(specification: FitSpecification) -> int:
    """Return the greatest number of runs of a fit."""
    rounds = len(specification.combinations) * specification.rounds
    return rounds * specification.points * specification.repeat + BEST_RUNS


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
    shares = _pool(branches, np.random.default_rng([specification.seed, _SAMPLING, 1 << 20]))
    branch = max(branches, key=lambda branch: branch.probability)
    box = Region(*interval_shares(shares))
    outside = not box.holds(branch.posterior.shares).any()
    best = _best(specification, branch, branch.region if outside else box)
    runs = folder.simulate("best", [best], BEST_RUNS, (specification.seed, _FINAL))[0]
    comparisons = _compared(specification, runs)
    used = [item for item in comparisons if not item.target.hold_out]
    cut = unfinished(specification, branches)
    refusal = ""
    if missed := sum(not item.reached for item in used):
        refusal = f"the model does not reach {missed} of {len(used)} targets"
    elif cut:
        names = ", ".join(cut)
        refusal = (
            f"the last round's region cuts off the probable values of {names}: use more rounds"
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


def _best(specification: FitSpecification, branch: Branch, box: Region) -> dict[str, Any]:
    """Return the most probable point of a box, with few digits."""
    posterior = branch.posterior
    inside = box.holds(posterior.shares)
    start = posterior.shares[inside][posterior.log_likelihood[inside].argmax()]
    assert posterior.likelihood is not None
    [best] = _named_points(
        specification, posterior.likelihood.best(start, box)[None], branch.choices
    )
    low, high = (specification.values_at(side[None]) for side in (box.low, box.high))
    return {
        name: _rounded(value, low[name].item(), high[name].item()) if name in low else value
        for name, value in best.items()
    }


def _rounded(value: float, low: float, high: float) -> float:
    """Return a value between two others with few digits, as a parameter file shall have it."""
    for digits in range(_DIGITS, 17):
        rounded = float(f"{value:.{digits}g}")
        if low <= rounded <= high:
            return rounded
    return min(max(value, low), high)


def _compared(specification: FitSpecification, runs: np.ndarray) -> tuple[TargetComparison, ...]:
    """Return the targets beside runs at one point, shape (runs, targets)."""
    spreads = runs.std(axis=0, ddof=1)
    columns = (runs.mean(axis=0), spreads / math.sqrt(len(runs)), spreads)
    rows = zip(specification.targets, *(each.tolist() for each in columns), strict=True)
    return tuple(TargetComparison(*row) for row in rows)


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
        write_whole(out / "proof.json", f"{json_text(proof, indent=1)}\n")
    return proof


def _prove(
    folder: FitFolder, specification: FitSpecification, drills: int, report: Report
) -> dict[str, Any]:
    random = np.random.default_rng([specification.seed, _PROOF])
    shares = random.random((drills, len(specification.unknowns)))
    chosen = random.integers(len(specification.combinations), size=drills)
    points = [
        _named_points(specification, share[None], specification.combinations[number])[0]
        for number, share in zip(chosen, shares, strict=True)
    ]
    seed = (specification.seed, _PROOF, 1)
    figures = folder.simulate(f"proof_{drills}", points, _runs(specification), seed)
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
        low, high = interval_shares(_pool(branches, random))
        inside.append((shares[i] >= low) & (shares[i] <= high))
        probabilities.append(sum(b.probability for b in branches if b.number == number))
    if not inside:
        raise FitError("no synthetic drill has intervals")
    covered = {}
    for name, count in zip(specification.unknowns, np.sum(inside, axis=0).tolist(), strict=True):
        ends = stats.binomtest(count, len(inside)).proportion_ci(_CONFIDENCE)
        share = count / len(inside)
        covered[name] = {"count": count, "share": share, "interval": [*map(float, ends)]}
    return {
        "drills": len(inside),
        "refused": refused,
        "level": LEVEL,
        "covered": covered,
        "confidence": _CONFIDENCE,
        # Each unknown is covered as often as its interval says, up to chance.
        "holds": all(
            low <= LEVEL <= high for low, high in (c["interval"] for c in covered.values())
        ),
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
