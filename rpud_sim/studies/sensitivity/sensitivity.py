"""Run of a sensitivity study: the figures' distributions and their Sobol indices."""

from __future__ import annotations

import dataclasses
from types import MappingProxyType
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import EngineError, Parameters
from rpud_sim.simulation.configuration import whole_configuration
from rpud_sim.simulation.ensemble import compile_members
from rpud_sim.simulation.members import QuietRuns
from rpud_sim.simulation.statistics import Statistics
from rpud_sim.simulation.versions import engine_versions, version_of
from rpud_sim.studies.jobs import Track, gather, silent
from rpud_sim.studies.sensitivity.sobol_study import Indices, design, find_indices
from rpud_sim.studies.sensitivity.specification import SensitivityError, Specification

# Names and units of the headline figures.
FIGURES = MappingProxyType(
    {
        "drill_tool_impact_rate": "1/s",
        "contact_force_mean": "N",
        "contact_force_p99": "N",
        "kinetic_energy_rate": "W",
        "reacting_force_mean": "N",
    }
)

# The input beside the parameters [cycles]. Its total index is the share of sampling noise.
PHASE = "initial_phase"


@dataclasses.dataclass(frozen=True)
class Sensitivity:
    """Result of a sensitivity study."""

    specification: Specification  # of the study
    values: np.ndarray  # figures at the independent points of the design, shape (points, figures)
    indices: Indices  # of the figures; the last input is the initial phase

    @property
    def inputs(self) -> tuple[str, ...]:
        """Names of the inputs, in the order of the indices."""
        return (*self.specification.inputs, PHASE)

    def content(self) -> dict[str, Any]:
        """Return everything as plain values."""
        return {
            "figures": {
                name: self._figure(number, name, unit)
                for number, (name, unit) in enumerate(FIGURES.items())
            },
            "specification": dataclasses.asdict(self.specification),
            "simulations": self.specification.simulations,
            "versions": engine_versions() | {"scipy": version_of("scipy")},
        }

    def _figure(self, number: int, name: str, unit: str) -> dict[str, Any]:
        column = self.values[:, number]
        low, high = np.quantile(column, [0.05, 0.95]).tolist()
        found = self.indices
        return {
            "unit": unit,
            "mean": float(column.mean()),
            "standard_deviation": float(column.std(ddof=1)),
            "interval_90": [low, high],
            "noise_share": float(found.total[number, -1]),
            "inputs": {
                name: {
                    "first": float(found.first[number, i]),
                    "first_interval": found.first_interval[:, number, i].tolist(),
                    "total": float(found.total[number, i]),
                    "total_interval": found.total_interval[:, number, i].tolist(),
                }
                for i, name in enumerate(self.inputs)
            },
        }


def run_sensitivity(specification: Specification, track: Track = silent) -> Sensitivity:
    """Run all simulations of a study and divide the figures' variance among the inputs.

    Raises:
        SensitivityError: if a point has no figures; the text gives the reason.
    """
    intervals = list(specification.inputs.values())
    shares = design(len(intervals) + 1, specification.samples, specification.seed)
    least = np.array([interval.minimum for interval in intervals])
    most = np.array([interval.maximum for interval in intervals])
    points = least + shares[..., :-1] * (most - least)
    jobs = [
        (specification.parameters(dict(zip(specification.inputs, point, strict=True))), phase)
        for point, phase in zip(
            points.reshape(-1, len(intervals)).tolist(),
            shares[..., -1].ravel().tolist(),
            strict=True,
        )
    ]
    compile_members(jobs[0][0])
    settling, duration = specification.settling, specification.duration
    rows = gather(lambda job: _figures(*job, settling, duration), jobs, "simulations", track)
    values = np.array(rows).reshape(*shares.shape[:2], len(FIGURES))
    return Sensitivity(
        specification,
        values[:2].reshape(-1, len(FIGURES)),
        find_indices(values, specification.seed),
    )


def _figures(parameters: Parameters, phase: float, settling: float, duration: float) -> list[float]:
    run = QuietRuns(whole_configuration(parameters), (phase,))
    statistics = Statistics()
    try:
        run.advance_to(round(settling * SECOND))
        impacts = run.advance_to(round((settling + duration) * SECOND), statistics)
    except EngineError as error:
        raise SensitivityError(str(error)) from None
    if not len(impacts):
        raise SensitivityError(
            f"a point has no impact within {duration:g} s: weight_on_bit = "
            f"{parameters.weight_on_bit:g} N, vibration_amplitude = "
            f"{parameters.vibration_amplitude:g} m"
        )
    found: dict[str, Any] = dict(statistics.figures())
    return [float(found[name]) for name in FIGURES]
