"""Posterior distribution of the unknowns, sampled with a surrogate by sequential Monte Carlo.

Particles begin evenly between the bounds. The likelihood is switched on in steps; after each step
the particles are drawn again by their weights and moved by a Metropolis random walk. The method
follows ridges and separate peaks, and gives the evidence for each combination of choices.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy.stats import qmc

from rpud_sim.studies.fit.specification import Target
from rpud_sim.studies.fit.surrogate import Surrogate

_MOVES = 6  # of the random walk after each step
_KEPT = 0.5  # effective share of the particles that a step leaves
_MOST_STEPS = 100


class Likelihood:
    """Logarithm of the likelihood of the targets, from a surrogate.

    The error of a figure has three parts: the tolerance of its target, the chance of the runs whose
    mean the target is, and the surrogate's own error. The parts of data show its chance as well, so
    the greater of both counts. Chance is correlated as between the figures of a run.

    Args:
        targets: of the fit, one for each figure.
    """

    def __init__(self, surrogate: Surrogate, targets: tuple[Target, ...]) -> None:
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


def sample(likelihood: Likelihood, particles: int, random: np.random.Generator) -> Posterior:
    """Return the posterior distribution for even prior probability between the bounds.

    Args:
        particles: number of points; a power of two.
        random: source of everything that is drawn.
    """
    region = likelihood.surrogate.region
    unknowns = len(region.low)
    sequence = qmc.Sobol(unknowns, seed=random)
    shares = region.from_unit(sequence.random_base2(particles.bit_length() - 1))
    logs = likelihood(shares)
    evidence = region.log_volume
    if not np.isfinite(logs).any():
        return Posterior(shares, logs, -math.inf)
    power = 0.0
    scale = 2.38 / math.sqrt(unknowns)
    for _ in range(_MOST_STEPS):
        step = _step(logs, power)
        weights = _weights(logs, step)
        evidence += _log_mean(logs, step)
        power += step
        chosen = _systematic(weights, random)
        deviation = shares - weights @ shares
        covariance = (weights[:, None] * deviation).T @ deviation
        shares, logs = shares[chosen], logs[chosen]
        lower = _root(covariance, region.high - region.low)
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
        weights = _weights(logs, step)
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


def _weights(logs: np.ndarray, step: float) -> np.ndarray:
    weights = np.exp(step * (logs - logs.max()))
    return weights / weights.sum()


def _log_mean(logs: np.ndarray, step: float) -> float:
    greatest = logs.max()
    return float(step * greatest + math.log(np.exp(step * (logs - greatest)).mean()))


def _systematic(weights: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Return the numbers of the particles that are drawn, by systematic resampling."""
    places = (np.arange(len(weights)) + random.random()) / len(weights)
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


def _root(covariance: np.ndarray, widths: np.ndarray) -> np.ndarray:
    """Return a lower triangular root; flat directions keep a small width."""
    return np.linalg.cholesky(covariance + np.diag((1e-6 * widths) ** 2))
