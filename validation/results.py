"""All runs of the validation."""

from __future__ import annotations

import dataclasses

from rpud_sim.simulation import preset
from validation.choices import Choices
from validation.elastic_bar import BarImpact, Comparison, compare_with_bar, strike
from validation.jobs import Track, silent
from validation.named_choices import FITTED, NAMED, TABLES
from validation.paper_numbers import CONTACT_SPEED
from validation.parameter_studies import Study, Trend, find_trends, run_studies
from validation.scores import Fit, fit_all


@dataclasses.dataclass(frozen=True)
class Effort:
    """Amount of simulation."""

    runs: int = 40  # of the paper's windows for each drill
    study_runs: int = 12  # at each point of a parameter study
    study_duration: float = 20.0  # of each of these runs [s]
    bar_elements: int = 40  # elements in part I of the elastic bar
    seed: int = 0  # of all initial phases


@dataclasses.dataclass(frozen=True)
class Results:
    """Results of all runs."""

    effort: Effort
    fits: list[Fit]  # of the named choices, the most numbers within 10 % first
    studies: dict[str, list[Study]]  # of the tables and of the fitted choices
    trends: dict[str, list[Trend]]  # verdicts on the studies
    bar: list[Comparison]  # the elastic bar beside the energy balance
    meshes: dict[int, BarImpact]  # the bar with the paper's free mass, by elements in part I

    def fit(self, name: str) -> Fit:
        """Return the fit of named choices."""
        return next(fit for fit in self.fits if fit.choices.name == name)


def named(name: str) -> Choices:
    """Return named choices."""
    return next(choices for choices in NAMED if choices.name == name)


def run_validation(effort: Effort, track: Track = silent) -> Results:
    """Run all simulations of the page."""
    fits = fit_all(NAMED, effort.runs, effort.seed, track)
    studies = {
        name: run_studies(
            named(name).parameters("drilling"),
            effort.study_runs,
            effort.study_duration,
            effort.seed + 1 + place,
            track,
        )
        for place, name in enumerate((TABLES, FITTED))
    }
    elements = (effort.bar_elements // 4, effort.bar_elements // 2, effort.bar_elements)
    return Results(
        effort=effort,
        fits=sorted(fits, key=lambda fit: (-fit.near(), fit.misfit())),
        studies=studies,
        trends={name: find_trends(group) for name, group in studies.items()},
        bar=compare_with_bar(effort.bar_elements, track),
        meshes={number: strike(preset("drilling"), CONTACT_SPEED, number) for number in elements},
    )
