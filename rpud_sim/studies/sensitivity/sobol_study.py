"""Saltelli's design and the Sobol indices from its results, with bootstrap intervals."""

from __future__ import annotations

import dataclasses

import numpy as np
from scipy.stats import qmc, sobol_indices

CONFIDENCE = 0.95
RESAMPLES = 400


@dataclasses.dataclass(frozen=True)
class Indices:
    """Sobol indices of several figures; each array has the shape (figures, inputs)."""

    first: np.ndarray  # share of the variance that an input explains alone
    first_interval: np.ndarray  # lower and upper end of its confidence interval, shape (2, ...)
    total: np.ndarray  # share in which an input takes part, alone or with others
    total_interval: np.ndarray  # of the total


def design(dimensions: int, samples: int, seed: int) -> np.ndarray:
    """Return the points of Saltelli's design in the unit cube.

    Args:
        samples: of each matrix, a power of two.

    Returns:
        Shape (dimensions + 2, samples, dimensions): the matrices A and B, and for each input A with
        that input's column of B.
    """
    # Every version of SciPy accepts a generator by this name.
    sequence = qmc.Sobol(2 * dimensions, seed=np.random.default_rng(seed))
    both = sequence.random_base2(samples.bit_length() - 1)
    a, b = both[:, :dimensions], both[:, dimensions:]
    mixed = []
    for column in range(dimensions):
        one = a.copy()
        one[:, column] = b[:, column]
        mixed.append(one)
    return np.array([a, b, *mixed])


def find_indices(values: np.ndarray, seed: int) -> Indices:
    """Return the indices from the figures at the points of a design.

    Args:
        values: shape (inputs + 2, samples, figures), finite, in the order of ``design``.
    """
    a, b, mixed = values[0].T, values[1].T, np.swapaxes(values[2:], 1, 2)
    samples = a.shape[1]
    random = np.random.default_rng(seed)

    def estimate(chosen: np.ndarray) -> np.ndarray:
        # A figure that nothing changes has no variance to divide.
        with np.errstate(divide="ignore", invalid="ignore"):
            found = sobol_indices(
                func={"f_A": a[:, chosen], "f_B": b[:, chosen], "f_AB": mixed[..., chosen]},
                n=samples,
            )
        # SciPy drops the axis of the figures if there is only one.
        return np.array([found.first_order, found.total_order]).reshape(2, len(a), -1)

    first, total = estimate(np.arange(samples))
    resampled = np.array([estimate(random.integers(0, samples, samples)) for _ in range(RESAMPLES)])
    tail = 0.5 * (1.0 - CONFIDENCE)
    ends = np.quantile(resampled, [tail, 1.0 - tail], axis=0)
    return Indices(first, ends[:, 0], total, ends[:, 1])
