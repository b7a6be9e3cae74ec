"""Scores of readings: every number of the model over the paper's, by groups of figures.

The misfit of a reading is the root-mean-square of log(model / paper); exp(misfit) is the factor by
which the model is typically off. Each simulated number has the same weight. Measured numbers are
scored apart.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from functools import cache
from typing import Any

import numpy as np

from rpud_sim.model.drill import effective_tool
from rpud_sim.simulation import Parameters
from rpud_sim.studies.reproduction.choices import ENERGIES, Reading, Rock, energy_share
from rpud_sim.studies.reproduction.paper_numbers import (
    CONTACT_SPEED,
    GROUPS,
    KINETIC_ENERGY,
    MEASURED,
    NUMBERS,
    SIMULATED,
    Number,
)
from rpud_sim.studies.reproduction.single_contact import single_contact
from rpud_sim.studies.reproduction.windows import Members

NEAR = 0.10  # relative difference within which a number counts as reproduced
CLOSE = 0.15  # and within which a figure counts in the order of the readings
_RESAMPLES = 400


@dataclasses.dataclass(frozen=True)
class Value:
    """Counterpart of a number in the model under one reading, in SI units."""

    mean: float  # over the members
    standard_error: float  # of the mean
    low: float  # 2.5 % quantile of single members, since the paper shows one run
    high: float  # 97.5 % quantile

    def over(self, number: Number) -> float:
        """Return model over paper."""
        return self.mean / number.paper

    def near(self, number: Number, within: float = NEAR) -> bool:
        """Whether the mean is within a share of the paper's value."""
        return abs(self.over(number) - 1.0) <= within


@dataclasses.dataclass(frozen=True)
class Fit:
    """Fit of a reading to all numbers."""

    reading: Reading  # the choices
    values: Mapping[str, Value]  # of the model, by the numbers' keys
    misfit: float  # over the simulated numbers
    misfit_interval: tuple[float, float]  # its 95 % interval, from resampled members
    # misfit of each group of ``GROUPS``, and of the measured numbers
    group_misfits: Mapping[str, float]
    stalled: int  # number of members that the engine could not finish

    def near(self, numbers: Iterable[Number] = SIMULATED, within: float = NEAR) -> int:
        """Return how many of the numbers are within a share of the paper's values."""
        return sum(self.values[number.key].near(number, within) for number in numbers)

    @property
    def close_figures(self) -> int:
        """Number of the paper's simulated figures all of whose numbers are within ``CLOSE``."""
        figures: dict[str, bool] = {}
        for number in SIMULATED:
            close = self.values[number.key].near(number, CLOSE)
            figures[number.source] = figures.get(number.source, True) and close
        return sum(figures.values())

    @property
    def order(self) -> tuple[int, int, float]:
        """Key that sorts the best fit first: close figures, numbers within 10 %, misfit."""
        return -self.close_figures, -self.near(), self.misfit

    def energies(self) -> dict[str, float]:
        """Return the energy of Fig. 13 [J] by each of its meanings."""
        drill = self.reading.rock.parameters()
        masses = drill.free_mass, effective_tool(drill).mass
        arriving = self.values[KINETIC_ENERGY].mean / self.reading.rock.energy_share()
        return {name: arriving * energy_share(name, *masses) for name in ENERGIES}

    def numbers(self) -> dict[str, Any]:
        """Return everything in SI units, ready for JSON."""
        return {
            "name": self.reading.name,
            "searched": self.reading.searched,
            "consistent": self.reading.consistent,
            "before": dataclasses.asdict(self.reading.before),
            "rock": dataclasses.asdict(self.reading.rock),
            "reasons": list(self.reading.reasons),
            "values": {
                number.key: {
                    **dataclasses.asdict(self.values[number.key]),
                    "over_paper": self.values[number.key].over(number),
                    "near": self.values[number.key].near(number),
                }
                for number in NUMBERS
            },
            "energies": self.energies(),
            "misfit": self.misfit,
            "misfit_interval": list(self.misfit_interval),
            "group_misfits": dict(self.group_misfits),
            "near": self.near(),
            "near_by_group": {name: self.near(group) for name, group in GROUPS.items()},
            "close_figures": self.close_figures,
            "stalled": self.stalled,
        }


def root_mean_square_log(ratios: Iterable[float]) -> float:
    """Return the root-mean-square of the logarithms of ratios."""
    return float(np.sqrt(np.mean(np.square(np.log(list(ratios))))))


def columns_of(
    numbers: Iterable[Number], reading: Reading, windows: Mapping[Parameters, Members]
) -> dict[str, np.ndarray]:
    """Return each number's counterpart in every member, by the numbers' keys.

    Args:
        windows: the runs, by drill; those of the reading's drills are needed.
    """
    return {number.key: _column(number, reading, windows) for number in numbers}


def _column(number: Number, reading: Reading, windows: Mapping[Parameters, Members]) -> np.ndarray:
    if number.regime == "contact":
        return np.array([getattr(_blow(reading.rock.tool, reading.rock.gravity), number.figure)])
    values = windows[reading.parameters(number.regime)].values
    if number.figure == "impact_rate":
        count = reading.before.count if number.regime == "free" else reading.rock.count
        rate = values["drill_tool_impact_rate"]
        return rate if count == "one" else rate + values["actuator_impact_rate"]
    if number.figure == "kinetic_energy":
        return reading.rock.energy_share() * values["kinetic_energy"]
    return values[number.figure]


@cache
def _blow(tool: str, gravity: float) -> Any:
    return single_contact(Rock(tool=tool, gravity=gravity).parameters(), CONTACT_SPEED)


def fit(reading: Reading, windows: Mapping[Parameters, Members], seed: int) -> Fit:
    """Return the fit of a reading whose drills have run."""
    random = np.random.default_rng(seed)
    columns = columns_of(NUMBERS, reading, windows)
    sizes = sorted({len(column) for column in columns.values()})
    draws = {size: random.integers(0, size, (_RESAMPLES, size)) for size in sizes}
    resampled = [
        np.log(columns[number.key][draws[len(columns[number.key])]].mean(axis=1) / number.paper)
        for number in SIMULATED
    ]
    low, high = np.quantile(np.sqrt(np.square(resampled).mean(axis=0)), (0.025, 0.975))
    values = {key: _value(column) for key, column in columns.items()}

    def misfit(numbers: Iterable[Number]) -> float:
        return root_mean_square_log(values[number.key].over(number) for number in numbers)

    return Fit(
        reading=reading,
        values=values,
        misfit=misfit(SIMULATED),
        misfit_interval=(float(low), float(high)),
        group_misfits={
            **{name: misfit(group) for name, group in GROUPS.items()},
            "measured": misfit(MEASURED),
        },
        stalled=sum(windows[reading.parameters(regime)].stalled for regime in ("free", "drilling")),
    )


def _value(column: np.ndarray) -> Value:
    low, high = np.quantile(column, (0.025, 0.975))
    error = np.std(column, ddof=1) / np.sqrt(len(column)) if len(column) > 1 else 0.0
    return Value(float(column.mean()), float(error), float(low), float(high))


def nearest_fit(fits: Iterable[Fit], number: Number) -> Fit:
    """Return the fit whose value is nearest to a number of the paper."""
    return min(fits, key=lambda item: abs(np.log(item.values[number.key].over(number))))


def not_reproduced(fits: Iterable[Fit]) -> list[dict[str, Any]]:
    """Return the numbers that no reading reproduces within ``NEAR``, with the nearest values."""
    fits = list(fits)
    missing = []
    for number in NUMBERS:
        if any(item.values[number.key].near(number) for item in fits):
            continue
        nearest = nearest_fit(fits, number)
        missing.append(
            {
                "key": number.key,
                "paper": number.paper,
                "nearest": nearest.values[number.key].mean,
                "reading": nearest.reading.name,
            }
        )
    return missing
