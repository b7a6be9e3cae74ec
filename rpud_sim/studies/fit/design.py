"""Designs of a fit, the simulations at their points, and the chunks in which processes run them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.stats import qmc

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.versions import engine_versions
from rpud_sim.studies.fit.measures import measure
from rpud_sim.studies.fit.specification import Specification
from rpud_sim.studies.processes import check_versions

_CHUNK = 100.0  # simulated time in a chunk [s]: a fraction of a second of work


@dataclasses.dataclass(frozen=True)
class Region:
    """Box in the space of the unknowns, as shares of the way from low to high bounds."""

    low: np.ndarray  # shape (unknowns,)
    high: np.ndarray  # shape (unknowns,)

    @staticmethod
    def whole(count: int) -> Region:
        """Return the region between all bounds."""
        return Region(np.zeros(count), np.ones(count))

    @property
    def log_volume(self) -> float:
        """Logarithm of the share of the whole."""
        return float(np.log(self.high - self.low).sum())

    def holds(self, shares: np.ndarray) -> np.ndarray:
        """Return which points are inside, shape (n,)."""
        return np.all((shares >= self.low) & (shares <= self.high), axis=1)

    def from_unit(self, unit: np.ndarray) -> np.ndarray:
        """Return points of the unit cube, stretched to the region."""
        return self.low + unit * (self.high - self.low)

    def to_unit(self, shares: np.ndarray) -> np.ndarray:
        """Return points of the region, stretched to the unit cube."""
        return (shares - self.low) / (self.high - self.low)


@dataclasses.dataclass(frozen=True)
class Chunk:
    """Points of a design with the same choices."""

    number: int  # of the chunk in its job
    specification: Specification  # of the fit
    points: tuple[Mapping[str, Any], ...]  # values of all unknowns at each point
    phases: np.ndarray  # initial phases [cycles], shape (points, repeat, conditions)
    versions: Mapping[str, str]  # of everything that determines the results


def values_at(specification: Specification, shares: np.ndarray) -> dict[str, np.ndarray]:
    """Return the values of the unknown numbers at points, by name, each of shape (n,)."""
    return {
        name: item.at(shares[:, i]) for i, (name, item) in enumerate(specification.unknowns.items())
    }


def sobol_points(region: Region, count: int, seed: Sequence[int]) -> np.ndarray:
    """Return a scrambled Sobol design in a region, shape (count, unknowns)."""
    random = np.random.default_rng(seed)
    sequence = qmc.Sobol(len(region.low), seed=random)
    return region.from_unit(sequence.random_base2(count.bit_length() - 1))


def make_chunks(
    specification: Specification,
    points: Sequence[Mapping[str, Any]],
    repeat: int,
    seed: Sequence[int],
) -> list[Chunk]:
    """Return the chunks of a list of points.

    Args:
        points: values of all unknowns at each.
        repeat: runs at each.
    """
    random = np.random.default_rng(seed)
    spread = specification.phase_spread
    shape = (len(points), repeat, len(specification.conditions))
    phases = np.mod(random.uniform(-spread, spread, shape), 1.0)
    ends: dict[Any, float] = {}
    for target in specification.targets:
        ends[target.parameters] = max(ends.get(target.parameters, 0.0), target.measure.end)
    size = max(1, round(_CHUNK / max(sum(ends.values()) * repeat, 1e-3)))
    size = min(size, 64)
    versions = engine_versions()
    return [
        Chunk(number, specification, tuple(points[i : i + size]), phases[i : i + size], versions)
        for number, i in enumerate(range(0, len(points), size))
    ]


def simulate(chunk: Chunk) -> np.ndarray:
    """Return the targets' measures of all runs, shape (points, repeat, targets); NaN if missing."""
    check_versions(chunk.versions)
    specification = chunk.specification
    found = np.full((*chunk.phases.shape[:2], len(specification.targets)), np.nan)
    for number, condition in enumerate(specification.conditions):
        places = [i for i, t in enumerate(specification.targets) if t.parameters == condition]
        measures = [specification.targets[i].measure for i in places]
        for point, values in enumerate(chunk.points):
            try:
                configuration = specification.configuration(values, condition)
                for member in range(chunk.phases.shape[1]):
                    phase = float(chunk.phases[point, member, number])
                    found[point, member, places] = measure(configuration, phase, measures)
            except (EngineError, ParameterError):
                continue  # NaN: the surrogate leaves such points out
    return found
