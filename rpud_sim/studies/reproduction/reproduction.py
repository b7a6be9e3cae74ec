"""Reproduction of the paper: all runs, and their numbers as one JSON object."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
from scipy import stats

from rpud_sim.simulation import Parameters, preset
from rpud_sim.studies.reproduction.bar_study import BarStudy, Comparison, run_bar_study
from rpud_sim.studies.reproduction.choices import Reading
from rpud_sim.studies.reproduction.jobs import Track, silent
from rpud_sim.studies.reproduction.named_readings import NAMED, PRESETS
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED, NUMBERS
from rpud_sim.studies.reproduction.parameter_studies import (
    OUTPUTS,
    Study,
    Trend,
    find_trends,
    run_studies,
)
from rpud_sim.studies.reproduction.scores import Fit, fit, not_reproduced
from rpud_sim.studies.reproduction.search import Search, search, simulate
from rpud_sim.studies.reproduction.windows import Members

BEST = "best reading"

_REGIMES = ("free", "drilling")
# Shown beside the numbers, and scored nowhere.
_EXTRAS = ("contact_force_share", "nodal_plane_mean")


@dataclasses.dataclass(frozen=True)
class Effort:
    """Amount of simulation for a reproduction."""

    search_points: int = 64  # of the search's design, a power of two
    refined_points: int = 16  # of each refinement, a power of two
    search_members: int = 3  # runs per drill of the search
    window_members: int = 40  # runs of the paper's windows per reading
    study_members: int = 12  # runs per point of a study
    study_duration: float = 20.0  # of each of these runs [s]
    study_points: int = 9  # number of values of each parameter
    bar_elements: int = 40  # elements in part I of the elastic bar
    seed: int = 0  # of the design and of all initial phases


QUICK = Effort(4, 2, 2, 4, 4, 2.0, 3, 4)


@dataclasses.dataclass(frozen=True)
class Reproduction:
    """Results of a reproduction."""

    effort: Effort  # amount of simulation
    search: Search  # for readings
    fits: list[Fit]  # of the named readings and of those found, the best first
    extras: dict[str, dict[str, float]]  # means of further figures by reading, then by name
    studies: dict[str, list[Study]]  # by drill, ``PRESETS`` and ``BEST``
    trends: dict[str, list[Trend]]  # verdicts on the studies, by drill
    bar: BarStudy  # study of the elastic bar

    @property
    def best(self) -> Fit:
        """Fit of the reading with the most figures within 15 %."""
        return self.fits[0]

    @property
    def presets(self) -> Fit:
        """Fit of the presets."""
        return self.fit(PRESETS)

    def fit(self, name: str) -> Fit:
        """Return the fit of a reading by its name."""
        return next(fit for fit in self.fits if fit.reading.name == name)

    def slope(self, drill: str) -> tuple[float, float]:
        """Return slope and half its 95 % interval of reacting force over weight on bit."""
        study = next(item for item in self.studies[drill] if item.parameter == "weight_on_bit")
        members = study.members["reacting_force_mean"]
        weights = np.broadcast_to(study.values[:, None], members.shape)
        valid = np.isfinite(members)
        line = stats.linregress(weights[valid], members[valid])
        spread = stats.t.ppf(0.975, np.count_nonzero(valid) - 2)
        return float(line.slope), float(spread * line.stderr)

    def numbers(self) -> dict[str, Any]:
        """Return every number in SI units, ready for JSON."""
        return {
            "effort": dataclasses.asdict(self.effort),
            "numbers": {number.key: dataclasses.asdict(number) for number in NUMBERS},
            "readings": [
                {**item.numbers(), **self.extras[item.reading.name]} for item in self.fits
            ],
            "search": {
                "runs": self.search.runs,
                "compared": self.search.compared,
                "design": {
                    tool: {"points": points.tolist(), "misfits": misfits.tolist()}
                    for tool, (points, misfits) in self.search.ridges.items()
                },
            },
            "not_reproduced": not_reproduced(self.fits),
            "studies": {
                drill: {study.parameter: _study_numbers(study) for study in group}
                for drill, group in self.studies.items()
            },
            "trends": {
                drill: [dataclasses.asdict(trend) for trend in group]
                for drill, group in self.trends.items()
            },
            "reacting_force_over_weight_on_bit": {
                drill: dict(zip(("slope", "half_interval"), self.slope(drill), strict=True))
                for drill in self.studies
            },
            "elastic_bar": {
                "by_free_mass": [_comparison_numbers(item) for item in self.bar.by_mass],
                "by_impact_velocity": [_comparison_numbers(item) for item in self.bar.by_speed],
                "by_elements": {
                    str(number): _scalars(bar) for number, bar in self.bar.by_elements.items()
                },
            },
            "figure_12_implies": figure_12_implies(),
        }


def reproduce(effort: Effort, track: Track = silent) -> Reproduction:
    """Run all simulations of the reproduction."""
    found = search(
        effort.search_points, effort.refined_points, effort.search_members, effort.seed, track
    )
    readings = (*NAMED, *found.readings)
    # Other phases than those of the search, which chose its readings for how well they did there.
    windows = simulate(
        [reading.parameters(regime) for reading in readings for regime in _REGIMES],
        effort.window_members,
        effort.seed + 1000,
        "readings",
        track,
    )
    fits = sorted(
        (fit(reading, windows, effort.seed) for reading in readings), key=lambda item: item.order
    )
    drills = {PRESETS: preset("drilling"), BEST: fits[0].reading.parameters("drilling")}
    studies = {
        name: run_studies(
            drill,
            effort.study_members,
            effort.study_duration,
            effort.study_points,
            effort.seed + 1 + number,
            track,
        )
        for number, (name, drill) in enumerate(drills.items())
    }
    return Reproduction(
        effort=effort,
        search=found,
        fits=fits,
        extras={reading.name: _extras(reading, windows) for reading in readings},
        studies=studies,
        trends={name: find_trends(group) for name, group in studies.items()},
        bar=run_bar_study(effort.bar_elements, track),
    )


def _extras(reading: Reading, windows: dict[Parameters, Members]) -> dict[str, float]:
    regimes = dict(zip(_EXTRAS, ("drilling", "free"), strict=True))
    return {
        name: float(np.nanmean(windows[reading.parameters(regime)].values[name]))
        for name, regime in regimes.items()
    }


def figure_12_implies() -> dict[str, float]:
    """Return effective mass [kg] and spring rate [N/m] of the tool that Fig. 12 implies.

    Such a tool gives both numbers of Fig. 12 by eqs. (21), (30) and (36), without gravity:
    F = m_fm w^2 eta and v' = w eta.
    """
    force, displacement = (
        next(number.paper for number in NUMBERS if number.key == key)
        for key in ("contact_peak_force", "contact_peak_displacement")
    )
    free_mass = preset("drilling").free_mass
    square = force / (free_mass * displacement)
    velocity = np.sqrt(square) * displacement
    mass = free_mass * (CONTACT_SPEED / velocity - 1.0)
    return {"tool_mass": float(mass), "tool_spring_rate": float(square * (free_mass + mass))}


def _study_numbers(study: Study) -> dict[str, Any]:
    return {
        "values": study.values.tolist(),
        **{
            output: {
                "mean": study.mean(output).tolist(),
                "half_interval": study.half_interval(output).tolist(),
            }
            for output in OUTPUTS
        },
        "stalled": int(np.count_nonzero(~np.isfinite(study.members["reacting_force_mean"]))),
    }


def _scalars(record: Any) -> dict[str, float]:
    fields = dataclasses.fields(record)
    values = {field.name: getattr(record, field.name) for field in fields}
    return {name: value for name, value in values.items() if isinstance(value, (int, float))}


def _comparison_numbers(comparison: Comparison) -> dict[str, Any]:
    contacts = {model: _scalars(contact) for model, contact in comparison.contacts.items()}
    return {**_scalars(comparison), "bar": _scalars(comparison.bar), **contacts}
