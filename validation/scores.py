"""Scores of choices: every number of the model over the paper's.

The misfit is the root-mean-square of log(model / paper) over the simulated numbers; exp(misfit) is
the factor by which the model is typically off. Each simulated number has the same weight. Measured
numbers are in no score.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping

import numpy as np

from rpud_sim.simulation.configuration import whole_configuration
from rpud_sim.studies.fit.measures import measure
from validation.choices import Choices
from validation.jobs import Track, gather
from validation.paper_numbers import KINETIC_ENERGY, NUMBERS, SIMULATED, Number

NEAR = 0.10  # relative difference within which a number counts as reproduced

# The paper's runs begin at phase zero, eq. (1); those here at most this far from it [cycles].
PHASE_SPREAD = 0.1


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


def fit_all(choices: Iterable[Choices], runs: int, seed: int, track: Track) -> list[Fit]:
    """Run every drill over the paper's windows, and return the fits in the order of the choices.

    Args:
        runs: of each drill, each with an initial phase of its own.
    """
    choices = list(choices)
    regimes = {
        regime: [number for number in NUMBERS if number.regime == regime]
        for regime in ("free", "drilling")
    }
    # Equal drills run once, so that equal choices before drilling have equal numbers.
    drills = dict.fromkeys(
        (regime, item.parameters(regime)) for item in choices for regime in regimes
    )
    random = np.random.default_rng(seed)
    jobs = [
        (regime, drill, float(phase))
        for regime, drill in drills
        for phase in PHASE_SPREAD * random.uniform(-1.0, 1.0, runs)
    ]
    rows = gather(
        lambda job: measure(
            whole_configuration(job[1]), job[2], [number.measure for number in regimes[job[0]]]
        ),
        jobs,
        "numbers",
        track,
    )
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
        for item in choices
    ]


def _value(number: Number, choices: Choices, column: np.ndarray) -> Value:
    if number is KINETIC_ENERGY:
        column = column * choices.rock.energy_shares()[choices.rock.energy]
    low, high = np.quantile(column, (0.025, 0.975))
    half = 1.96 * np.std(column, ddof=1) / np.sqrt(len(column))
    return Value(float(column.mean()), float(half), float(low), float(high))
