"""Specification of a fit, read from YAML: fixed parameters, unknowns, targets and effort."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from typing import Any

from rpud_sim.foundation.quantities import Quantity
from rpud_sim.simulation.configuration import PARAMETERS, Configuration, to_configuration
from rpud_sim.studies.fit.measures import Measure
from rpud_sim.studies.sweep.specification import Range


@dataclasses.dataclass(frozen=True)
class Target:
    """Figure of the drill that the fit shall reach."""

    measure: Measure  # its counterpart in a run
    value: float  # of the drill, in SI units
    tolerance: float  # one standard deviation of the value's error [unit of the figure]
    runs: int = 1  # number of runs whose mean the value is; 1 if it is from one run
    # that the drill had for this target alone, by name
    parameters: tuple[tuple[str, Any], ...] = ()
    hold_out: bool = False  # whether the fit does not see it, and only reports it
    source: str = ""  # where the value comes from; may be empty
    # standard error by chance, from the parts of the data that the value is from; else None
    sampling: float | None = None

    def error(self, spread: float) -> float:
        """Return the standard deviation of tolerance and chance.

        Args:
            spread: standard deviation of single runs.
        """
        chance = max(spread / math.sqrt(self.runs), self.sampling or 0.0)
        return math.hypot(chance, self.tolerance)

    @property
    def title(self) -> str:
        """Figure, window and own parameters."""
        own = "".join(f", {name} {_plain(value)}" for name, value in self.parameters)
        return f"{self.measure}{own}"


@dataclasses.dataclass(frozen=True)
class Specification:
    """Fit of the drill's parameters."""

    parameters: Mapping[str, Any]  # fixed values, by name
    unknowns: Mapping[str, Range]  # bounds of the unknown numbers, by name
    choices: Mapping[str, tuple[Any, ...]]  # possible values of the unknown choices, by name
    targets: tuple[Target, ...]  # at least one that is not held out
    seed: int = 0  # of the design, the initial phases and the posterior
    points: int = 256  # simulated in each round, for each combination of choices; a power of two
    rounds: int = 3  # number of rounds; each has a smaller region
    repeat: int = 4  # runs at each point
    phase_spread: float = 0.5  # greatest initial phase of the vibration, either way [cycles]

    @property
    def conditions(self) -> tuple[tuple[tuple[str, Any], ...], ...]:
        """Sets of own parameters that the targets have, without repetition."""
        return tuple(dict.fromkeys(target.parameters for target in self.targets))

    @property
    def combinations(self) -> tuple[dict[str, Any], ...]:
        """Combinations of the unknown choices; one empty one if there is no choice."""
        products = itertools.product(*self.choices.values())
        return tuple(dict(zip(self.choices, values, strict=True)) for values in products)

    def configuration(
        self, unknown: Mapping[str, Any], condition: tuple[tuple[str, Any], ...] = ()
    ) -> Configuration:
        """Return the drill for values of the unknowns and a target's own parameters."""
        return to_configuration({**self.parameters, **unknown, **dict(condition)})

    def content(self) -> dict[str, Any]:
        """Return the specification as plain values; equal fits give equal values."""
        return dataclasses.asdict(self) | {
            "parameters": dict(self.parameters),
            "unknowns": {name: dataclasses.asdict(item) for name, item in self.unknowns.items()},
            "choices": {name: list(values) for name, values in self.choices.items()},
        }


def unit_of(name: str) -> str:
    """Return the SI unit of a parameter; empty for choices."""
    allowed = PARAMETERS[name].allowed
    return allowed.unit if isinstance(allowed, Quantity) else ""


def _plain(value: Any) -> str:
    return f"{value:g}" if isinstance(value, float) else str(value)
