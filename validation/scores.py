"""Scores of choices: every number of the model over the paper's; and all runs of the validation.

The misfit is the root-mean-square of log(model / paper) over the simulated numbers; exp(misfit) is
the factor by which the model is typically off. Measured numbers are in no score.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from rpud_sim.simulation import preset
from validation.choices import FITTED, NAMED, TABLES, Choices, named
from validation.elastic_bar import BarImpact, Comparison, compare_with_bar, strike
from validation.numbers import (
    CONTACT_SPEED,
    KINETIC_ENERGY,
    NUMBERS,
    SIMULATED,
    Number,
    gather,
    values_of,
)
from validation.trends import Study, Trend, find_trends, run_studies

NEAR = 0.10  # relative difference within which a number counts as reproduced

# The paper's runs begin at phase zero, eq. (1); those here at most this far from it [cycles].
PHASE_SPREAD = 0.1


@dataclasses.dataclass(frozen=True)
class Effort:
    """Amount of simulation."""

    runs: int = 40  # of the paper's windows for each drill
    study_runs: int = 12  # at each point of a study of trends
    study_duration: float = 20.0  # of each of these runs [s]
    bar_elements: int = 40  # elements in part I of the elastic bar
    seed: int = 0  # of all initial phases


@dataclasses.dataclass(frozen=True)
class Value:
    """Counterpart of a number in the model, in SI units."""

    mean: float  # over the runs
    half_interval: float  # half the 95 % interval of the mean
    low: float  # 2.5 % quantile of single runs, since the paper shows one run
    high: float  # 97.5 % quantile

    def over(self, number: Number) -> float:
        """Return model over paper."""
        return self.mean / number.paper

    def near(self, number: Number) -> bool:
        """Whether the mean is within ``NEAR`` of the paper's value."""
        return abs(self.over(number) - 1.0) <= NEAR


@dataclasses.dataclass(frozen=True)
class Fit:
    """Fit of a set of choices to all numbers."""

    choices: Choices
    values: Mapping[Number, Value]  # of the model

    def near(self) -> int:
        """Return how many simulated numbers are within ``NEAR``."""
        return sum(self.values[number].near(number) for number in SIMULATED)

    def misfit(self) -> float:
        """Return the misfit over the simulated numbers."""
        ratios = [self.values[number].over(number) for number in SIMULATED]
        return float(np.sqrt(np.mean(np.square(np.log(ratios)))))

    def energies(self) -> dict[str, float]:
        """Return the energy of Fig. 13 [J] by each of its meanings."""
        shares = self.choices.rock.energy_shares()
        arriving = self.values[KINETIC_ENERGY].mean / shares[self.choices.rock.energy]
        return {name: arriving * share for name, share in shares.items()}


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


def run_validation(effort: Effort) -> Results:
    """Run all simulations of the page."""
    fits = _fit_all(effort.runs, effort.seed)
    amount = effort.study_runs, effort.study_duration
    studies = {
        name: run_studies(named(name).parameters("drilling"), *amount, effort.seed + place)
        for place, name in enumerate((TABLES, FITTED), 1)
    }
    elements = (effort.bar_elements // 4, effort.bar_elements // 2, effort.bar_elements)
    return Results(
        effort=effort,
        fits=sorted(fits, key=lambda fit: (-fit.near(), fit.misfit())),
        studies=studies,
        trends={name: find_trends(group) for name, group in studies.items()},
        bar=compare_with_bar(effort.bar_elements),
        meshes={number: strike(preset("drilling"), CONTACT_SPEED, number) for number in elements},
    )


def _fit_all(runs: int, seed: int) -> list[Fit]:
    """Run every drill over the paper's windows, and return the fits of the named choices."""
    regimes = {
        regime: [number for number in NUMBERS if number.regime == regime]
        for regime in ("free", "drilling")
    }
    # Equal drills run once, so that equal choices before drilling have equal numbers.
    drills = dict.fromkeys(
        (regime, item.parameters(regime)) for item in NAMED for regime in regimes
    )
    random = np.random.default_rng(seed)
    jobs = [
        (drill, float(phase), regimes[regime])
        for regime, drill in drills
        for phase in PHASE_SPREAD * random.uniform(-1.0, 1.0, runs)
    ]
    rows = gather(values_of, jobs, "numbers")
    tables = {
        drill: np.array(rows[place * runs : (place + 1) * runs])
        for place, drill in enumerate(drills)
    }
    return [
        Fit(
            item,
            {
                number: _value(number, item, tables[regime, item.parameters(regime)][:, column])
                for regime, numbers in regimes.items()
                for column, number in enumerate(numbers)
            },
        )
        for item in NAMED
    ]


def _value(number: Number, choices: Choices, column: np.ndarray) -> Value:
    if number is KINETIC_ENERGY:
        column = column * choices.rock.energy_shares()[choices.rock.energy]
    low, high = np.quantile(column, (0.025, 0.975))
    half = 1.96 * np.std(column, ddof=1) / np.sqrt(len(column))
    return Value(float(column.mean()), float(half), float(low), float(high))
