"""Readings of the paper: sets of choices in what it leaves open, each used for all numbers.

The misfit of a reading is the root-mean-square of log(model / paper) over all numbers; exp(misfit)
is the factor by which the model is typically off. Nothing is fitted: the product of the choices
below is searched in full.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any

import numpy as np

from rpud_sim.simulation import Parameters, preset
from rpud_sim.studies.reproduction.jobs import Track, gather
from rpud_sim.studies.reproduction.paper_numbers import CONTACT_SPEED, NUMBERS, Number
from rpud_sim.studies.reproduction.single_contact import single_contact
from rpud_sim.studies.reproduction.windows import Members, run_windows

AMPLITUDES = (35e-6, 17.5e-6)  # 35 um read as amplitude, and as peak-to-peak [m]
WEIGHTS = (0.0, 5.0, 10.0, 15.0, 20.0, 25.0, 30.0)  # while drilling; it is zero before drilling [N]
MODULI = (1.96e9, 1.96e11)  # as printed, and of steel [Pa]
CONTACT_MODELS = ("printed", "rayleigh")
COUNTS = ("one", "both")  # impacts on the drill tool, or these and those of the actuator

# The paper's runs begin at phase zero, eq. (1); members begin at most this far from it [cycles].
PHASE_SPREAD = 0.1

NEAR = 0.10  # relative difference within which a number counts as reproduced
_RESAMPLES = 400
_REGIMES = ("free", "drilling")


@dataclasses.dataclass(frozen=True)
class Reading:
    """Set of choices.

    Args:
        vibration_amplitude: [m].
        weight_on_bit: while drilling [N].
        elastic_modulus: [Pa].
        contact_model: ``printed`` or ``rayleigh``.
        count: ``one`` collision of a cycle counted, or ``both``.
    """

    vibration_amplitude: float
    weight_on_bit: float
    elastic_modulus: float
    contact_model: str
    count: str

    def __str__(self) -> str:
        return self.describe("drilling")

    def describe(self, regime: str) -> str:
        """Return those choices in words that affect a number of the regime."""
        amplitude = f"A = {self.vibration_amplitude * 1e6:g} µm"
        weight = f"W = {self.weight_on_bit:g} N"
        contact = f"E = {self.elastic_modulus:g} Pa, {self.contact_model} contact"
        counted = f"{self.count} counted"
        return ", ".join(
            {
                "free": (amplitude, counted),
                "contact": (contact,),
                "drilling": (amplitude, weight, contact, counted),
            }[regime]
        )

    def parameters(self, regime: str) -> Parameters:
        """Return the drill of this reading."""
        return preset(regime).replace(
            vibration_amplitude=self.vibration_amplitude,
            weight_on_bit=0.0 if regime == "free" else self.weight_on_bit,
            elastic_modulus=self.elastic_modulus,
            contact_model=self.contact_model,
        )


@dataclasses.dataclass(frozen=True)
class Value:
    """Counterpart of a number in the model under one reading, in SI units.

    Args:
        mean: over the members.
        standard_error: of the mean.
        low: 2.5 % quantile of single members, since the paper shows one run.
        high: 97.5 % quantile.
    """

    mean: float
    standard_error: float
    low: float
    high: float

    def near(self, number: Number) -> bool:
        """Whether the mean is within ``NEAR`` of the paper's value."""
        return abs(self.mean / number.paper - 1.0) <= NEAR


@dataclasses.dataclass(frozen=True)
class Fit:
    """Fit of a reading to all numbers.

    Args:
        reading: the choices.
        values: of the model, by the numbers' keys.
        misfit: root-mean-square of log(model / paper).
        misfit_interval: its 95 % interval, from resampled members.
        misfit_simulated: over the numbers that the paper simulated.
        misfit_measured: over the numbers that it measured.
        stalled: number of members that the engine could not finish.
    """

    reading: Reading
    values: dict[str, Value]
    misfit: float
    misfit_interval: tuple[float, float]
    misfit_simulated: float
    misfit_measured: float
    stalled: int

    @property
    def near(self) -> int:
        """Number of numbers that are reproduced within ``NEAR``."""
        return sum(self.values[number.key].near(number) for number in NUMBERS)


def all_readings() -> tuple[Reading, ...]:
    """Return the full product of the choices."""
    choices = itertools.product(AMPLITUDES, WEIGHTS, MODULI, CONTACT_MODELS, COUNTS)
    return tuple(Reading(*choice) for choice in choices)


def search(members: int, seed: int, track: Track) -> list[Fit]:
    """Return the fit of every reading, the best first.

    Args:
        members: number of members of each ensemble.
        seed: of the initial phases.
        track: shows the progress.
    """
    readings = all_readings()
    random = np.random.default_rng(seed)
    # Readings share runs: the count affects no run, and the contact none before drilling.
    drills = list(
        dict.fromkeys(_drill(reading, regime) for reading in readings for regime in _REGIMES)
    )
    phases = [PHASE_SPREAD * random.uniform(-1.0, 1.0, members) for _ in drills]
    jobs = list(zip(drills, phases, strict=True))
    results = gather(lambda job: run_windows(*job), jobs, "readings", track)
    windows = dict(zip(drills, results, strict=True))
    fits = [_fit(reading, windows, np.random.default_rng(seed)) for reading in readings]
    return sorted(fits, key=lambda fit: fit.misfit)


def _drill(reading: Reading, regime: str) -> Parameters:
    parameters = reading.parameters(regime)
    if regime == "free":
        return preset("free").replace(vibration_amplitude=parameters.vibration_amplitude)
    return parameters


def _fit(reading: Reading, windows: dict[Parameters, Members], random: np.random.Generator) -> Fit:
    ensembles = {regime: windows[_drill(reading, regime)] for regime in _REGIMES}
    contact = single_contact(reading.parameters("drilling"), CONTACT_SPEED)
    size = {regime: len(ensembles[regime].values["kinetic_energy"]) for regime in _REGIMES}
    draws = {regime: random.integers(0, n, (_RESAMPLES, n)) for regime, n in size.items()}
    values: dict[str, Value] = {}
    errors = []
    resampled = []
    for number in NUMBERS:
        if number.regime == "contact":
            exact = getattr(contact, number.figure)
            values[number.key] = Value(exact, 0.0, exact, exact)
            means = np.full(_RESAMPLES, exact)
        else:
            column = _column(ensembles[number.regime], number.figure, reading.count)
            values[number.key] = _value(column)
            means = column[draws[number.regime]].mean(axis=1)
        errors.append(np.log(values[number.key].mean / number.paper))
        resampled.append(np.log(means / number.paper))
    measured = np.array([number.measured for number in NUMBERS])
    squares = np.square(errors)
    low, high = np.quantile(np.sqrt(np.square(resampled).mean(axis=0)), (0.025, 0.975))
    return Fit(
        reading=reading,
        values=values,
        misfit=float(np.sqrt(squares.mean())),
        misfit_interval=(float(low), float(high)),
        misfit_simulated=float(np.sqrt(squares[~measured].mean())),
        misfit_measured=float(np.sqrt(squares[measured].mean())),
        stalled=sum(ensemble.stalled for ensemble in ensembles.values()),
    )


def _column(members: Members, figure: str, count: str) -> np.ndarray:
    if figure != "impact_rate":
        return members.values[figure]
    rate = members.values["drill_tool_impact_rate"]
    return rate if count == "one" else rate + members.values["actuator_impact_rate"]


def _value(column: np.ndarray) -> Value:
    low, high = np.quantile(column, (0.025, 0.975))
    error = np.std(column, ddof=1) / np.sqrt(len(column))
    return Value(float(column.mean()), float(error), float(low), float(high))


def nearest_fit(fits: list[Fit], number: Number) -> Fit:
    """Return the fit whose value is nearest to a number of the paper."""
    return min(fits, key=lambda fit: abs(np.log(fit.values[number.key].mean / number.paper)))


def not_reproduced(fits: list[Fit]) -> list[dict[str, Any]]:
    """Return the numbers that no reading reproduces within ``NEAR``, with the nearest values."""
    missing = []
    for number in NUMBERS:
        if any(fit.values[number.key].near(number) for fit in fits):
            continue
        nearest = nearest_fit(fits, number)
        missing.append(
            {
                "key": number.key,
                "paper": number.paper,
                "nearest": nearest.values[number.key].mean,
                "reading": nearest.reading.describe(number.regime),
            }
        )
    return missing
