"""Surrogate: polynomials in the unknowns that stand for the simulated figures in a region.

Figures that are positive everywhere are fitted by their logarithm. The degree of each polynomial
and its error come from leaving out one point at a time.
"""

from __future__ import annotations

import dataclasses
import itertools
import math

import numpy as np
from numpy.polynomial import legendre
from scipy.spatial import KDTree
from scipy.special import digamma

_MOST_DEGREE = 8
_MOST_TERMS = 0.4  # of the number of points
_SPREAD_DEGREE = 2  # of the polynomials for the spread of single runs
_LEAST_SPREAD = 1e-9  # of a figure without chance, relative


@dataclasses.dataclass(frozen=True)
class Region:
    """Box in the space of the unknowns, as shares of the way from low to high bounds."""

    low: np.ndarray  # shape (unknowns,)
    high: np.ndarray  # shape (unknowns,)

    @staticmethod
    def whole(count: int) -> Region:
        return Region(np.zeros(count), np.ones(count))

    def holds(self, shares: np.ndarray) -> np.ndarray:
        """Return which points are inside, shape (n,)."""
        return np.all((shares >= self.low) & (shares <= self.high), axis=1)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Return points of the unit cube, stretched to the region."""
        return self.low + unit * (self.high - self.low)

    def to_unit(self, shares: np.ndarray) -> np.ndarray:
        """Return points of the region, stretched to the unit cube."""
        return (shares - self.low) / (self.high - self.low)


class SurrogateError(ValueError):
    """Design that no surrogate can be made of; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Surrogate:
    """Figures over a region."""

    region: Region  # outside of it the surrogate is not valid
    logarithmic: np.ndarray  # whether a figure's logarithm is fitted, shape (figures,)
    mean_terms: tuple[np.ndarray, ...]  # exponents of the polynomials of each figure
    mean_factors: tuple[np.ndarray, ...]  # coefficients of each
    spread_terms: np.ndarray  # exponents of the polynomials for the spread
    spread_factors: np.ndarray  # coefficients for each figure, shape (terms, figures)
    correlation: np.ndarray  # of the figures of one run, shape (figures, figures)
    error: np.ndarray  # covariance of the surrogate's own errors, shape (figures, figures)
    valid: np.ndarray  # whether each point of the design had all figures
    points: KDTree | None  # nearest-neighbour index of the design, None if all are valid

    def transform(self, figures: np.ndarray) -> np.ndarray:
        """Return figures, the last axis, as they are fitted; NaN without a logarithm."""
        with np.errstate(invalid="ignore", divide="ignore"):
            logs = np.where(figures > 0.0, np.log(np.where(figures > 0.0, figures, 1.0)), np.nan)
        return np.where(self.logarithmic, logs, figures)

    def predict(self, shares: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return mean and spread of single runs, as they are fitted, each of shape (n, figures)."""
        unit = self.region.to_unit(shares)
        largest = max(self.mean_terms, key=len)  # the terms of all others begin it
        values = _basis(unit, largest)
        mean = np.empty((len(shares), len(self.mean_factors)))
        for i, factors in enumerate(self.mean_factors):
            mean[:, i] = values[:, : len(factors)] @ factors
        spread = np.exp(0.5 * (_basis(unit, self.spread_terms) @ self.spread_factors))
        return mean, spread

    def supports(self, shares: np.ndarray) -> np.ndarray:
        """Return at which points it is valid, shape (n,)."""
        inside = self.region.holds(shares)
        if self.points is not None and inside.any():
            _, nearest = self.points.query(self.region.to_unit(shares[inside]))
            inside[inside] = self.valid[nearest]
        return inside


def fit_surrogate(
    region: Region, shares: np.ndarray, figures: np.ndarray, groups: np.ndarray
) -> Surrogate:
    """Return the surrogate of a design in a region.

    Its points have shape (points, unknowns), the runs' figures (points, repeat, figures), NaN if
    missing. Groups are the conditions of the figures: runs of two conditions are independent.
    """
    valid = np.isfinite(figures).all(axis=(1, 2))
    fewest = 4 * (shares.shape[1] + 1)
    if np.count_nonzero(valid) < fewest:
        raise SurrogateError(
            f"{np.count_nonzero(valid)} of {len(valid)} points have all figures; at least {fewest} "
            "are needed: move the bounds of the unknowns, or use more points"
        )
    unit = region.to_unit(shares)
    tree = None if valid.all() else KDTree(unit)
    unit, figures = unit[valid], figures[valid]
    logarithmic = np.asarray((figures > 0.0).all(axis=(0, 1)))
    runs = np.where(logarithmic, np.log(np.where(logarithmic, figures, 1.0)), figures)
    repeat = runs.shape[1]
    means = runs.mean(axis=1)
    spread_terms, spread_factors = _fit_spread(unit, runs)
    spreads = np.exp(0.5 * (_basis(unit, spread_terms) @ spread_factors))
    fits = _fit_means(unit, means)
    residuals = np.column_stack([residual for *_, residual in fits])
    same = groups[:, None] == groups[None, :]
    correlation = _correlation((runs - means[:, None]) / spreads[:, None]) * same
    np.fill_diagonal(correlation, 1.0)
    # The residuals have the chance of the point that was left out as well.
    chance = (spreads**2).mean(axis=0) / repeat
    variance = np.maximum((residuals**2).mean(axis=0) - chance, 0.02 * chance + 1e-14)
    deviation = np.sqrt(variance)
    error = deviation[:, None] * deviation * _correlation(residuals[:, None])
    return Surrogate(
        region,
        logarithmic,
        tuple(terms for terms, *_ in fits),
        tuple(factors for _, factors, *_ in fits),
        spread_terms,
        spread_factors,
        correlation,
        error,
        valid,
        tree,
    )


def _terms(unknowns: int, degree: int) -> np.ndarray:
    """Return the exponents of all terms up to a total degree, lower degrees first."""
    rows = []
    for total in range(degree + 1):
        for places in itertools.combinations_with_replacement(range(unknowns), total):
            rows.append([places.count(i) for i in range(unknowns)])
    return np.array(rows)


def _basis(unit: np.ndarray, terms: np.ndarray) -> np.ndarray:
    """Return products of Legendre polynomials at points of the unit cube, shape (n, terms)."""
    values = np.ones((len(unit), len(terms)))
    for i in range(unit.shape[1]):
        powers = legendre.legvander(2.0 * unit[:, i] - 1.0, int(terms[:, i].max()))
        values *= powers[:, terms[:, i]]
    return values


def _fit_means(unit: np.ndarray, values: np.ndarray) -> list[tuple[np.ndarray, ...]]:
    """Return terms, coefficients and leave-one-out residuals of the best degree, by figure."""
    unknowns = unit.shape[1]
    best: list[tuple[np.ndarray, ...]] = []
    losses = np.full(values.shape[1], np.inf)
    for degree in range(1, _MOST_DEGREE + 1):
        if best and math.comb(unknowns + degree, degree) > _MOST_TERMS * len(unit):
            break
        terms = _terms(unknowns, degree)
        q, r = np.linalg.qr(_basis(unit, terms))
        factors = np.linalg.solve(r, q.T @ values)
        within = values - q @ (q.T @ values)
        residuals = within / np.maximum(1.0 - (q**2).sum(axis=1), 1e-6)[:, None]
        loss = (residuals**2).mean(axis=0)
        found = [(terms, factors[:, i], residuals[:, i]) for i in range(len(loss))]
        best = [
            new if new_loss < old_loss else old
            for new, old, new_loss, old_loss in zip(found, best or found, loss, losses, strict=True)
        ]
        losses = np.minimum(loss, losses)
    return best


def _fit_spread(unit: np.ndarray, runs: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return terms and coefficients for the logarithm of the variance of single runs."""
    freedom = runs.shape[1] - 1
    variance = runs.var(axis=1, ddof=1)
    scale = np.maximum(np.abs(runs).mean(axis=(0, 1)), 1e-300)
    floor = np.maximum((_LEAST_SPREAD * scale) ** 2, 1e-3 * np.median(variance, axis=0))
    # The logarithm of a sample's variance is less than that of the true variance, on average.
    bias = digamma(0.5 * freedom) - math.log(0.5 * freedom)
    values = np.log(np.maximum(variance, floor)) - np.where(variance.max(axis=0) > floor, bias, 0.0)
    degree = _SPREAD_DEGREE
    while degree and math.comb(unit.shape[1] + degree, degree) > 0.2 * len(unit):
        degree -= 1
    terms = _terms(unit.shape[1], degree)
    basis = _basis(unit, terms)
    factors, *_ = np.linalg.lstsq(basis, values, rcond=None)
    # Runs with heavy tails have a greater variance than their logarithms have on average.
    factors[0] += np.log(np.maximum((variance / np.exp(basis @ factors)).mean(axis=0), 1.0))
    return terms, factors


def _correlation(deviations: np.ndarray) -> np.ndarray:
    """Return the correlation of the last axis, of deviations from zero; drawn a little to zero."""
    flat = deviations.reshape(-1, deviations.shape[-1])
    products = flat.T @ flat
    scale = np.sqrt(np.maximum(np.diag(products), 1e-300))
    correlation = 0.98 * products / scale[:, None] / scale
    np.fill_diagonal(correlation, 1.0)
    return correlation
