"""Posterior distribution of the unknowns, and what it determines: intervals and ridges.

It is sampled with a surrogate by sequential Monte Carlo.

Particles begin evenly between the bounds. The likelihood is switched on in steps; after each step
the particles are drawn again by their weights and moved by a Metropolis random walk. The method
follows ridges and separate peaks, and gives the evidence for each combination of choices.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np
from scipy import special, stats
from scipy.stats import qmc

from rpud_sim.studies.fit.surrogate import Surrogate
from rpud_sim.studies.fit.target_file import FitTarget
from rpud_sim.studies.sweep.specification import Range

LEVEL = 0.95  # of the intervals
PERCENT = f"{100.0 * LEVEL:g} %"
_TAIL = 0.5 * (1.0 - LEVEL)
# Distance of the interval from a side, over its width, below which the side cuts the posterior off:
# a normal distribution has a third of its peak there.
_CUT_OFF = 0.05
_WIDE, _NARROW = 0.8, 0.4  # width of an interval over that between the bounds
_RIDGE = 0.6  # rank correlation from which on two unknowns form a ridge
_MOVES = 6  # of the random walk after each step
_KEPT = 0.5  # effective share of the particles that a step leaves
_MOST_STEPS = 100


class Likelihood:
    """Logarithm of the likelihood of the targets, from a surrogate.

    The error of a figure has three parts: the tolerance of its target, the chance of the runs whose
    mean the target is, and the surrogate's own error. The parts of data show its chance as well, so
    the greater of both counts. Chance is correlated as between the figures of a run.
    """

    def __init__(self, surrogate: Surrogate, targets: tuple[FitTarget, ...]) -> None:
        self.surrogate = surrogate
        values = np.array([target.value for target in targets])
        self._used = np.array([not target.hold_out for target in targets])
        self._runs = np.array([float(target.runs) for target in targets])
        # standard deviations of the targets' errors, as the figures are fitted
        safe = np.where((values == 0.0) | ~surrogate.logarithmic, 1.0, np.abs(values))
        self._tolerance = np.array([target.tolerance for target in targets]) / safe
        self._sampling = np.array([target.sampling or 0.0 for target in targets]) / safe
        self._values = surrogate.transform(values)

    def expected(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and covariance of the targets, as they are fitted, by point.

        The logarithm of a mean over runs is above the mean of their logarithms.
        """
        mean, spread = self.surrogate.predict(shares)
        raised = 0.5 * spread**2 * (1.0 - 1.0 / self._runs)
        mean = mean + np.where(self.surrogate.logarithmic, np.minimum(raised, 0.5), 0.0)
        chance = np.maximum(spread / np.sqrt(self._runs), self._sampling)
        covariance = (
            chance[:, :, None] * chance[:, None, :] * self.surrogate.correlation
            + self.surrogate.error
            + np.diag(self._tolerance**2)
        )
        return mean, covariance

    def __call__(self, shares: np.ndarray) -> np.ndarray:
        """Return the logarithm at each point, minus infinity where the surrogate is not valid."""
        result = np.full(len(shares), -np.inf)
        inside = self.surrogate.supports(shares)
        # A figure that is positive everywhere cannot have a target that is not.
        if not (np.isfinite(self._values[self._used]).all() and inside.any()):
            return result
        mean, covariance = self.expected(shares[inside])
        used = self._used
        difference = (self._values - mean)[:, used]
        lower = np.linalg.cholesky(covariance[:, used][:, :, used])
        whitened = np.linalg.solve(lower, difference[:, :, None])[:, :, 0]
        diagonal = np.diagonal(lower, axis1=1, axis2=2)
        constant = 0.5 * used.sum() * math.log(2.0 * math.pi)
        result[inside] = -0.5 * (whitened**2).sum(axis=1) - np.log(diagonal).sum(axis=1) - constant
        return result


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Sampled posterior distribution for one combination of choices."""

    shares: np.ndarray  # equally probable points, shape (particles, unknowns)
    log_likelihood: np.ndarray  # at each
    log_evidence: float  # logarithm of the mean likelihood between all bounds


IMPOSSIBLE = Posterior(np.empty((0, 0)), np.empty(0), -math.inf)
"""Posterior of choices that cannot be."""


def sample(likelihood: Likelihood, particles: int, random: np.random.Generator) -> Posterior:
    """Return the posterior for even prior probability; ``particles`` is a power of two."""
    region = likelihood.surrogate.region
    unknowns = len(region.low)
    sequence = qmc.Sobol(unknowns, seed=random)
    shares = region.from_unit(sequence.random_base2(particles.bit_length() - 1))
    logs = likelihood(shares)
    evidence = float(np.log(region.high - region.low).sum())
    if not np.isfinite(logs).any():
        return Posterior(shares, logs, -math.inf)
    power = 0.0
    scale = 2.38 / math.sqrt(unknowns)
    for _ in range(_MOST_STEPS):
        step = _step(logs, power)
        weights = special.softmax(step * logs)
        evidence += float(special.logsumexp(step * logs)) - math.log(len(logs))
        power += step
        chosen = _systematic(weights, random)
        deviation = shares - weights @ shares
        covariance = (weights[:, None] * deviation).T @ deviation
        shares, logs = shares[chosen], logs[chosen]
        # Flat directions keep a small width.
        flat = np.diag((1e-6 * (region.high - region.low)) ** 2)
        lower = np.linalg.cholesky(covariance + flat)
        for _ in range(_MOVES):
            moved = shares + scale * random.standard_normal(shares.shape) @ lower.T
            new = likelihood(moved)
            ratio = power * (np.where(np.isfinite(new), new, -1e300) - logs)
            accepted = np.log(random.random(len(shares))) < ratio
            shares[accepted], logs[accepted] = moved[accepted], new[accepted]
            rate = float(accepted.mean())
            scale = float(np.clip(scale * math.exp(rate - 0.3), 0.02, 3.0))
        if power >= 1.0:
            break
    return Posterior(shares, logs, evidence)


def _step(logs: np.ndarray, power: float) -> float:
    """Return the step of the power that leaves the wanted effective share of the particles."""
    rest = 1.0 - power
    usable = np.isfinite(logs).mean()

    def effective(step: float) -> float:
        weights = special.softmax(step * logs)
        return float(1.0 / (weights**2).sum() / len(weights) / usable)

    if effective(rest) >= _KEPT:
        return rest
    low, high = 0.0, rest
    for _ in range(60):
        middle = 0.5 * (low + high)
        if effective(middle) >= _KEPT:
            low = middle
        else:
            high = middle
    return max(low, 1e-12)


def _systematic(weights: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return the numbers of the particles that are drawn, by systematic resampling."""
    places = (np.arange(len(weights)) + random.random()) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


@dataclasses.dataclass(frozen=True)
class Interval:
    """Posterior of one unknown."""

    low: float  # end of the interval of ``LEVEL``, in SI units
    median: float  # of the posterior
    high: float  # other end
    width: float  # of the interval over that between the bounds, on the prior's scale
    at_bound: tuple[str, ...]  # ends that a bound cuts off, ``low`` and ``high``

    @property
    def identified(self) -> str:
        """Whether the targets determine the unknown: ``yes``, ``weakly`` or ``no``."""
        if self.width > _WIDE:
            return "no"
        return "weakly" if self.width > _NARROW else "yes"

    @property
    def digits(self) -> int:
        """Digits that tell both ends from the values between them."""
        width, size = self.high - self.low, max(abs(self.low), abs(self.high))
        return max(4, 2 + math.ceil(math.log10(size / width))) if width > 0.0 else 17

    def __str__(self) -> str:
        return f"{self.low:.{self.digits}g} to {self.high:.{self.digits}g}"

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader of the interval has to know, in words."""
        cut = [f"the {end} end is the bound: the true value may be beyond" for end in self.at_bound]
        return (*cut, *([] if self.identified == "yes" else [f"identified: {self.identified}"]))


@dataclasses.dataclass(frozen=True)
class Ridge:
    """Two unknowns of which the targets determine a combination better than each."""

    names: tuple[str, str]  # of the two
    # rank correlation in the posterior; if negative, one falls as the other rises
    correlation: float

    def __str__(self) -> str:
        first, second = self.names
        moves = "rises" if self.correlation > 0.0 else "falls"
        return f"{first} {moves} as {second} rises (rank correlation {self.correlation:.2f})"


def cut_off(
    shares: np.ndarray, low: np.ndarray | float = 0.0, high: np.ndarray | float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return for each column whether the low and the high side cut the distribution off."""
    first, last = np.quantile(shares, (_TAIL, 1.0 - _TAIL), axis=0)
    reach = _CUT_OFF * (last - first)
    return first - low < reach, high - last < reach


def interval_shares(shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return both ends of the interval of equally probable points, by column.

    It is the central one. Where a bound cuts the posterior off, the interval begins at the bound:
    the most probable value may be there.
    """
    at_low, at_high = cut_off(shares)
    central = np.quantile(shares, (_TAIL, 1.0 - _TAIL), axis=0)
    least, most = np.quantile(shares, (1.0 - LEVEL, LEVEL), axis=0)
    low = np.where(at_low, 0.0, np.where(at_high, least, central[0]))
    high = np.where(at_high, 1.0, np.where(at_low, most, central[1]))
    return low, high


def identify(
    shares: np.ndarray, unknowns: Mapping[str, Range]
) -> tuple[dict[str, Interval], tuple[Ridge, ...]]:
    """Return what equally probable points determine: intervals, and ridges, the strongest first.

    The unknowns are in the columns' order.
    """
    names = list(unknowns)
    ends = np.stack([*interval_shares(shares), np.median(shares, axis=0)])
    at_bound = np.stack(cut_off(shares))
    intervals = {}
    for i, (name, bounds) in enumerate(unknowns.items()):
        low, high, median = bounds.at(ends[:, i]).tolist()
        width = min(float(ends[1, i] - ends[0, i]) / LEVEL, 1.0)
        cut = tuple(
            end for end, is_cut in zip(("low", "high"), at_bound[:, i], strict=True) if is_cut
        )
        intervals[name] = Interval(low, median, high, width, cut)
    ranks = np.apply_along_axis(stats.rankdata, 0, shares)
    correlation = np.atleast_2d(np.corrcoef(ranks, rowvar=False))
    pairs = [
        Ridge((names[i], names[j]), float(correlation[i, j]))
        for i, j in itertools.combinations(range(len(names)), 2)
        if abs(correlation[i, j]) >= _RIDGE
    ]
    ridges = tuple(sorted(pairs, key=lambda ridge: -abs(ridge.correlation)))
    return intervals, ridges
