"""Sobol indices of a sweep's figures: which parameter causes how much of their variance.

The points are Saltelli's design. Its first matrix stands in it twice, with other initial phases:
the motion is chaotic, and the total index of this change of nothing is the share of the noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.stats import qmc, sobol_indices

from rpud_sim.studies.sweep.specification import SWEEP_FIGURES, SweepSpecification

_CONFIDENCE = 0.95
_RESAMPLES = 400


def saltelli_shares(inputs: int, samples: int, seed: int) -> np.ndarray:
    """Return the points of Saltelli's design in the unit cube; ``samples`` is a power of two.

    Shape (inputs + 3, samples, inputs): the matrices A and B, for each input A with that input's
    column of B, and A again.
    """
    # Every version of SciPy accepts a generator by this name.
    sequence = qmc.Sobol(2 * inputs, seed=np.random.default_rng(seed))
    both = sequence.random_base2(samples.bit_length() - 1)
    a, b = both[:, :inputs], both[:, inputs:]
    mixed = np.repeat(a[np.newaxis], inputs + 1, axis=0)
    for column in range(inputs):
        mixed[column, :, column] = b[:, column]
    return np.array([a, b, *mixed])


def find_indices(values: np.ndarray, seed: int) -> np.ndarray:
    """Return first and total indices, with their intervals, shape (3, 2, figures, inputs).

    The first index is the share of the variance that an input explains alone, the total one that in
    which it takes part. Finite values have shape (matrices, samples, figures), in the order of
    ``saltelli_shares``.
    """
    a, b, mixed = values[0].T, values[1].T, np.swapaxes(values[2:], 1, 2)
    samples = a.shape[1]
    random = np.random.default_rng(seed)

    def estimate(chosen: np.ndarray) -> np.ndarray:
        # A resample of few points may have no variance to divide.
        with np.errstate(divide="ignore", invalid="ignore"):
            found = sobol_indices(
                func={"f_A": a[:, chosen], "f_B": b[:, chosen], "f_AB": mixed[..., chosen]},
                n=samples,
            )
        # SciPy drops the axis of the figures if there is only one.
        return np.array([found.first_order, found.total_order]).reshape(2, len(a), -1)

    found = estimate(np.arange(samples))
    resampled = np.array(
        [estimate(random.integers(0, samples, samples)) for _ in range(_RESAMPLES)]
    )
    tail = 0.5 * (1.0 - _CONFIDENCE)
    ends = np.nanquantile(resampled, [tail, 1.0 - tail], axis=0)
    return np.concatenate([found[None], ends])


def figure_indices(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> dict[str, dict[str, Any]]:
    """Return distribution and indices of each figure as plain values.

    A figure that a point lacks has the entry ``missing`` instead, which gives the reason.
    """
    reasons = {name: _missing(points, name) for name in sweep.figures}
    names = [name for name, reason in reasons.items() if not reason]
    plain: dict[str, dict[str, Any]] = {}
    if names:
        shape = (len(sweep.swept) + 3, sweep.points or 0, len(names))
        values = np.column_stack([points[name] for name in names]).reshape(shape)
        found = find_indices(values, sweep.seed)
        for i, name in enumerate(names):
            plain[name] = _plain(list(sweep.swept), values[:2, :, i].ravel(), found[:, :, i])
    return {
        name: {"unit": SWEEP_FIGURES[name], **plain.get(name, {"missing": reason})}
        for name, reason in reasons.items()
    }


def independent(
    sweep: SweepSpecification, points: Mapping[str, np.ndarray]
) -> Mapping[str, np.ndarray]:
    """Return the points that do not repeat values of others: in Saltelli's design A and B."""
    if sweep.design != "saltelli":
        return points
    return {name: values[: 2 * (sweep.points or 0)] for name, values in points.items()}


def _missing(points: Mapping[str, np.ndarray], name: str) -> str:
    """Return why a figure has no indices; empty if it has."""
    values = points[name]
    lacking = np.flatnonzero(np.isnan(values))
    if len(lacking):
        first = int(lacking[0])
        failed = points["members"][first] == 0
        reason = "every simulation failed" if failed else "there is nothing to average"
        return f"{len(lacking)} of {len(values)} points lack it; at point {first} {reason}"
    if np.ptp(values) == 0.0:
        return "it is the same at all points"
    return ""


def _plain(names: list[str], values: np.ndarray, indices: np.ndarray) -> dict[str, Any]:
    """Return distribution and indices, shape (3, 2, inputs), of one figure."""
    value, *ends = indices
    first, total = value.tolist()
    first_ends, total_ends = np.array(ends).transpose(1, 2, 0).tolist()
    return {
        "mean": float(values.mean()),
        "standard_deviation": float(values.std(ddof=1)),
        "interval_90": np.quantile(values, [0.05, 0.95]).tolist(),
        "noise_share": total[-1],
        "noise_share_interval": total_ends[-1],
        "inputs": {
            name: {
                "first": first[i],
                "first_interval": first_ends[i],
                "total": total[i],
                "total_interval": total_ends[i],
            }
            for i, name in enumerate(names)
        },
    }
