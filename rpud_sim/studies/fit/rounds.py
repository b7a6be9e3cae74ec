"""Rounds of a fit: designs in a shrinking region, their simulations, and what these leave probable.

There is one branch for each combination of choices.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc

from rpud_sim.foundation.quantities import ExpectedError, ParameterError
from rpud_sim.foundation.whole_folder import whole_file
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.ensemble import compile_kernels, compile_members
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.fit.measures import measure
from rpud_sim.studies.fit.posterior import IMPOSSIBLE, Likelihood, Posterior, cut_off, sample
from rpud_sim.studies.fit.surrogate import Region, SurrogateError, fit_surrogate
from rpud_sim.studies.fit.target_file import FitSpecification
from rpud_sim.studies.store import Report, StudyStore
from rpud_sim.studies.workers import check_versions

PARTICLES = 4096
_CHUNK = 100.0  # simulated time in a chunk [s]: a fraction of a second of work
_MOST_POINTS = 64  # of a chunk
_LEAST_PROBABILITY = 1e-4  # of a combination of choices that is followed further
_PADDING = 0.25  # of the posterior's width, added to the next region on both sides
_LEAST_WIDTH = 0.01  # of a region
_TAIL = 0.002
_SEEN = 0.01  # probability of a combination of choices that an interval depends on

# What is drawn, as the second number of a seed.
DESIGN, PHASES, SAMPLING, CANDIDATE, FINAL = range(5)


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
        points, repeat, _ = self.phases.shape
        return points, repeat, len(self.specification.targets)

    @property
    def count(self) -> int:
        return self.shape[0] * self.shape[1]


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
                continue  # NaN: the surrogate leaves such points out
    return found


def fit_versions() -> dict[str, str]:
    """Return the versions of everything that a fit's results depend on."""
    return engine_versions() | {"scipy": version_of("scipy")}


class FitFolder(StudyStore[FitChunk, np.ndarray]):
    """Folder of a fit, and the simulations in it."""

    def __init__(
        self, path: Path, specification: FitSpecification, workers: int, report: Report
    ) -> None:
        content = {
            "specification": dataclasses.asdict(specification),
            "versions": fit_versions(),
        }
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
        ends: dict[Any, float] = {}
        for target in specification.targets:
            ends[target.parameters] = max(ends.get(target.parameters, 0.0), target.measure.end)
        size = max(1, round(_CHUNK / max(sum(ends.values()) * repeat, 1e-3)))
        size = min(size, _MOST_POINTS)
        versions = engine_versions()
        chunks = [
            FitChunk(
                job, number, specification, points[i : i + size], phases[i : i + size], versions
            )
            for number, i in enumerate(range(0, len(points), size))
        ]

        def prepare() -> None:
            drill = specification.configuration(points[0], specification.conditions[0])
            compile_members(drill)
            compile_kernels(drill)  # of figures that are sampled

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
        if number:
            for branch in branches:
                branch.region = next_region(branch)
        for branch in branches:
            shares = sobol_points(
                branch.region, specification.points, (seed, DESIGN, number, branch.number)
            )
            figures = folder.simulate(
                f"{drill if number else ''}round_{number + 1:02}_{branch.number:02}",
                named_points(specification, shares, branch.choices),
                specification.repeat,
                (seed, PHASES, number, branch.number),
            )
            inside = branch.region.holds(branch.shares)
            branch.shares = np.concatenate([branch.shares[inside], shares])
            branch.figures = np.concatenate([branch.figures[inside], figures])
            _update(specification, branch, number)
        branches = _weigh(branches)
    return branches


def sobol_points(region: Region, count: int, seed: Sequence[int]) -> np.ndarray:
    """Return a scrambled Sobol design in a region, shape (count, unknowns)."""
    sequence = qmc.Sobol(len(region.low), seed=np.random.default_rng(seed))
    return region.from_unit(sequence.random_base2(count.bit_length() - 1))


def named_points(
    specification: FitSpecification, shares: np.ndarray, choices: Mapping[str, Any]
) -> list[dict[str, Any]]:
    values = specification.values_at(shares)
    return [
        {**{name: column[i].item() for name, column in values.items()}, **choices}
        for i in range(len(shares))
    ]


def _update(specification: FitSpecification, branch: Branch, number: int) -> None:
    try:
        surrogate = fit_surrogate(
            branch.region, branch.shares, branch.figures, specification.condition_numbers
        )
    except SurrogateError as error:
        if len(specification.combinations) == 1:
            raise FitError(str(error)) from None
        branch.posterior = IMPOSSIBLE
        return
    likelihood = Likelihood(surrogate, specification.targets)
    random = np.random.default_rng([specification.seed, SAMPLING, number, branch.number])
    branch.posterior = sample(likelihood, PARTICLES, random)


def _weigh(branches: list[Branch]) -> list[Branch]:
    """Return the branches that are probable enough, with their probabilities."""
    found = [branch for branch in branches if math.isfinite(branch.posterior.log_evidence)]
    if not found:
        raise FitError(
            "no point between the bounds gives these figures; move the bounds of the unknowns"
        )
    logs = np.array([branch.posterior.log_evidence for branch in found])
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


def pool(branches: list[Branch], random: np.random.Generator) -> np.ndarray:
    """Return points of all branches' posteriors, each as often as its branch is probable."""
    numbers = random.multinomial(PARTICLES, [branch.probability for branch in branches])
    chosen = [
        branch.posterior.shares[random.permutation(len(branch.posterior.shares))[:number]]
        for branch, number in zip(branches, numbers, strict=True)
    ]
    return np.concatenate(chosen)
