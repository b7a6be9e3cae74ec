"""Posterior distribution of the unknowns, and what it determines: intervals and ridges.

Radial basis functions of SciPy stand for the simulated figures in a region, and emcee samples the
posterior with them, from a flat prior.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping

import emcee
import numpy as np
from scipy import optimize, special, stats
from scipy.interpolate import RBFInterpolator
from scipy.spatial import KDTree
from scipy.stats import qmc

from rpud_sim.studies.fit.target_file import FitTarget
from rpud_sim.studies.sweep.specification import Range

LEVEL = 0.95  # of the intervals
PERCENT = f"{100.0 * LEVEL:g} %"
WALKERS = 128  # of emcee
BURN_IN, STEPS, THIN = 400, 640, 20  # of each walker; every twentieth step is kept
_STARTS = 2**13  # points from which the best become walkers
_FOLDS = 5  # of the points, for the error of the emulator
_SMOOTHINGS = (1e-4, 1e-2, 1.0, 1e2, 1e4)  # of an emulator; the last is nearly its polynomial
_MOST_TERMS = 0.3  # of the emulator's polynomial, per point
_TAIL = 0.5 * (1.0 - LEVEL)
# Distance of the interval from a side, over its width, below which the side cuts the posterior off:
# a normal distribution has a third of its peak there.
_CUT_OFF = 0.05
_WIDE, _NARROW = 0.8, 0.4  # width of an interval over that between the bounds
_RIDGE = 0.6  # rank correlation from which on two unknowns form a ridge


@dataclasses.dataclass(frozen=True)
class Region:
    """Box in the space of the unknowns, as shares of the range from low to high bounds."""

    low: np.ndarray  # shape (unknowns,)
    high: np.ndarray  # shape (unknowns,)

    @staticmethod
    def whole(count: int) -> Region:
        return Region(np.zeros(count), np.ones(count))

    def holds(self, shares: np.ndarray) -> np.ndarray:
        """Return which points are inside, shape (n,)."""
        return np.all((shares >= self.low) & (shares <= self.high), axis=1)

    def points(self, count: int, random: np.random.Generator) -> np.ndarray:
        """Return a scrambled Sobol design in the region, shape of ``count``, a power of two."""
        sequence = qmc.Sobol(len(self.low), seed=random)
        unit = sequence.random_base2(count.bit_length() - 1)
        return self.low + unit * (self.high - self.low)

    def to_unit(self, shares: np.ndarray) -> np.ndarray:
        """Return points of the region, stretched to the unit cube."""
        return (shares - self.low) / (self.high - self.low)


class EmulatorError(ValueError):
    """Design that no emulator can be made of; the text gives the reason in one line."""


class Emulator:
    """Mean figures over a region; figures that are positive everywhere by their logarithm.

    The smoothing of each figure, and the error, come from leaving out a fifth of the points at a
    time. ``shares`` have shape (points, unknowns), the runs' ``figures`` (points, repeat, figures),
    NaN if missing. ``groups`` are the conditions of the figures: runs of two conditions are
    independent.
    """

    def __init__(
        self, region: Region, shares: np.ndarray, figures: np.ndarray, groups: np.ndarray
    ) -> None:
        self._valid = np.isfinite(figures).all(axis=(1, 2))
        fewest = 4 * (shares.shape[1] + 1)
        if np.count_nonzero(self._valid) < fewest:
            raise EmulatorError(
                f"{np.count_nonzero(self._valid)} of {len(self._valid)} points have all figures; "
                f"at least {fewest} are needed: move the bounds of the unknowns, or use more points"
            )
        self.region = region
        unit = region.to_unit(shares)
        self._points = KDTree(unit)
        unit, figures = unit[self._valid], figures[self._valid]
        self.logarithmic = np.asarray((figures > 0.0).all(axis=(0, 1)))
        runs = self.transform(figures)
        means = runs.mean(axis=1)
        repeat = runs.shape[1]
        apart = (runs - means[:, None]).reshape(-1, runs.shape[-1])
        same = groups[:, None] == groups
        # Covariance of the figures of one run, by chance.
        self.chance = same * (apart.T @ apart) / (len(means) * (repeat - 1))
        np.fill_diagonal(self.chance, np.maximum(np.diag(self.chance), 1e-30))
        residuals = np.array([self._left_out(unit, means, each) for each in _SMOOTHINGS])
        best = (residuals**2).mean(axis=1).argmin(axis=0)
        self._models = [
            (best == number, _interpolator(unit, means[:, best == number], smoothing))
            for number, smoothing in enumerate(_SMOOTHINGS)
            if (best == number).any()
        ]
        left = np.take_along_axis(residuals, best[None, None], axis=0)[0]
        # The points that were left out have the scatter between runs, too.
        own = np.diag(self.chance) / repeat
        deviation = np.sqrt(np.maximum((left**2).mean(axis=0) - own, 0.02 * own + 1e-14))
        correlation = 0.98 * np.atleast_2d(np.corrcoef(left + 1e-15, rowvar=False))
        np.fill_diagonal(correlation, 1.0)
        self.error = np.nan_to_num(correlation) * deviation * deviation[:, None]

    @staticmethod
    def _left_out(unit: np.ndarray, means: np.ndarray, smoothing: float) -> np.ndarray:
        """Return the errors at points that are left out, a part at a time, shape of the means."""
        residuals = np.empty_like(means)
        parts = np.arange(len(unit)) % _FOLDS
        for part in range(_FOLDS):
            out = parts == part
            model = _interpolator(unit[~out], means[~out], smoothing)
            residuals[out] = means[out] - model(unit[out])
        return residuals

    def transform(self, figures: np.ndarray) -> np.ndarray:
        """Return figures, the last axis, as they are emulated; NaN without a logarithm."""
        with np.errstate(invalid="ignore", divide="ignore"):
            logs = np.where(figures > 0.0, np.log(figures), np.nan)
        return np.where(self.logarithmic, logs, figures)

    def __call__(self, shares: np.ndarray) -> np.ndarray:
        """Return the mean figures at points, as they are emulated, shape (n, figures)."""
        unit, mean = self.region.to_unit(shares), np.empty((len(shares), len(self.logarithmic)))
        for columns, model in self._models:
            mean[:, columns] = model(unit)
        return mean

    def supports(self, shares: np.ndarray) -> np.ndarray:
        """Return at which points it is valid, shape (n,)."""
        inside = self.region.holds(shares)
        if not self._valid.all() and inside.any():
            nearest = self._points.query(self.region.to_unit(shares[inside]))[1]
            inside[inside] = self._valid[nearest]
        return inside


def _interpolator(unit: np.ndarray, values: np.ndarray, smoothing: float) -> RBFInterpolator:
    degree = 3
    while math.comb(unit.shape[1] + degree, degree) > _MOST_TERMS * len(unit):
        degree -= 1
    return RBFInterpolator(unit, values, smoothing=smoothing, kernel="cubic", degree=max(degree, 1))


class Likelihood:
    """Logarithm of the likelihood of the targets at points; minus infinity where it is unknown.

    The error of a figure has three parts: the tolerance of its target, the scatter between its
    averaged runs, and the error of the emulator. Parts of data also show a scatter; the greater of
    both counts.
    """

    def __init__(self, emulator: Emulator, targets: tuple[FitTarget, ...]) -> None:
        self.emulator = emulator
        self._used = np.array([not target.hold_out for target in targets])
        values = np.array([target.value for target in targets])
        runs = np.array([float(target.runs) for target in targets])
        logarithmic = emulator.logarithmic
        # Standard deviations of the targets' errors, as the figures are emulated.
        safe = np.where((values == 0.0) | ~logarithmic, 1.0, np.abs(values))
        tolerance = np.array([target.tolerance for target in targets]) / safe
        sampling = np.array([target.sampling or 0.0 for target in targets]) / safe
        spread = np.sqrt(np.diag(emulator.chance))
        chance = np.maximum(spread / np.sqrt(runs), sampling) / spread
        covariance = emulator.chance * chance * chance[:, None] + emulator.error
        covariance += np.diag(tolerance**2)
        # The logarithm of a mean over runs is above the mean of their logarithms.
        raised = np.minimum(0.5 * spread**2 * (1.0 - 1.0 / runs), 0.5)
        self._values = emulator.transform(values) - np.where(logarithmic, raised, 0.0)
        lower = np.linalg.cholesky(covariance[np.ix_(self._used, self._used)])
        self._whitening = np.linalg.inv(lower).T
        self._constant = float(np.log(math.sqrt(2.0 * math.pi) * np.diag(lower)).sum())

    def __call__(self, shares: np.ndarray) -> np.ndarray:
        result = np.full(len(shares), -np.inf)
        inside = self.emulator.supports(shares)
        # A figure that is positive everywhere cannot have a target that is not.
        if np.isfinite(self._values[self._used]).all() and inside.any():
            difference = (self._values - self.emulator(shares[inside]))[:, self._used]
            whitened = difference @ self._whitening
            result[inside] = -0.5 * (whitened**2).sum(axis=1) - self._constant
        return result

    def best(self, start: np.ndarray, box: Region) -> np.ndarray:
        """Return the point of the greatest likelihood in a box, near a start inside."""
        bounds = [*zip(box.low, box.high, strict=True)]
        found = optimize.minimize(
            lambda point: -min(max(float(self(point[None])[0]), -1e300), 1e300),
            start,
            method="Nelder-Mead",
            bounds=bounds,
        )
        return np.asarray(found.x)


@dataclasses.dataclass(frozen=True)
class Posterior:
    """Sampled posterior distribution for one combination of choices."""

    shares: np.ndarray  # samples, shape (samples, unknowns)
    log_likelihood: np.ndarray  # at each
    log_evidence: float = -math.inf  # logarithm of the mean likelihood between all bounds
    likelihood: Likelihood | None = None


IMPOSSIBLE = Posterior(np.empty((0, 0)), np.empty(0))
"""Posterior of choices that cannot be."""


def sample(likelihood: Likelihood, random: np.random.Generator) -> Posterior:
    """Return the posterior for even prior probability."""
    starts = likelihood.emulator.region.points(_STARTS, random)
    logs = likelihood(starts)
    if np.count_nonzero(np.isfinite(logs)) < WALKERS:
        return IMPOSSIBLE
    chosen = starts[np.argsort(-logs)[:WALKERS]]
    count = starts.shape[1]
    sampler = emcee.EnsembleSampler(WALKERS, count, likelihood, vectorize=True)
    state = np.random.RandomState(int(random.integers(2**32))).get_state()
    sampler.run_mcmc(emcee.State(chosen, random_state=state), BURN_IN + STEPS)
    shares = sampler.get_chain(discard=BURN_IN, thin=THIN, flat=True)
    found = sampler.get_log_prob(discard=BURN_IN, thin=THIN, flat=True)
    # Importance sampling from a smooth copy of the samples.
    kernel = stats.gaussian_kde(shares.T)
    drawn = kernel.resample(len(shares), seed=random)
    ratios = likelihood(drawn.T) - kernel.logpdf(drawn)
    evidence = float(special.logsumexp(ratios)) - math.log(len(ratios))
    return Posterior(shares, found, evidence, likelihood)


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
    """Return both ends of the interval of samples, by column.

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
    """Return what samples determine: intervals, and ridges, the strongest first.

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
