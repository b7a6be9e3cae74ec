"""Specification of a fit, read from YAML: fixed parameters, unknowns, targets and effort."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import Allowed, Choice, Flag, Quantity, Text
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.configuration import (
    NODE_NAMES,
    PARAMETERS,
    Configuration,
    to_configuration,
)
from rpud_sim.studies.fit.data import read_data
from rpud_sim.studies.fit.measures import (
    CONTACT_FIGURES,
    IMPACT_VALUES,
    SIGNED,
    UNITS,
    Measure,
    missing_model,
)
from rpud_sim.studies.sweep.specification import SCALES, Range
from rpud_sim.studies.sweep.specification_file import (
    checked_range,
    read_checked,
    read_mapping,
    read_values,
)

_LONGEST = 100.0  # end of a window [s]
_GREATEST = 1e300  # value of a target
_LEAST_ERROR = 1e-3  # of the value: instruments are not better
_MOST_COMBINATIONS = 64
_ENTRIES = ("parameters", "unknowns", "targets", "data")
_DATA = ("bag", "csv", "skip", "parameters", "hold_out")
_TARGET = ("figure", "statistic", "window", "value", "tolerance", "parameters")
_EFFORT: Mapping[str, Allowed] = {
    "seed": Quantity("", "seed of everything that is drawn", 0, 2**32 - 1, whole=True),
    "points": Quantity("", "points of a round", 16, 2**16, whole=True),
    "rounds": Quantity("", "rounds", 1, 20, whole=True),
    "repeat": Quantity("", "runs at a point", 2, 1000, whole=True),
    "phase_spread": Quantity("cycles", "greatest initial phase", 0.0, 0.5),
}
_MORE: Mapping[str, Allowed] = {
    "runs": Quantity("", "", 1, 1e9, whole=True),
    "hold_out": Flag(""),
    "source": Text("", ""),
}
# Parameters of the drill; those of the node change no figure.
_NAMES = tuple(name for name in PARAMETERS if name not in NODE_NAMES)


@dataclasses.dataclass(frozen=True)
class FitTarget:
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
        """Return the standard deviation of tolerance and chance, from that of single runs."""
        chance = max(spread / math.sqrt(self.runs), self.sampling or 0.0)
        return math.hypot(chance, self.tolerance)

    @property
    def title(self) -> str:
        """Figure, window and own parameters."""
        own = (
            f", {name} {f'{value:g}' if isinstance(value, float) else value}"
            for name, value in self.parameters
        )
        return f"{self.measure}{''.join(own)}"


@dataclasses.dataclass(frozen=True)
class FitSpecification:
    """Fit of the drill's parameters."""

    parameters: Mapping[str, Any]  # fixed values, by name
    unknowns: Mapping[str, Range]  # bounds of the unknown numbers, by name
    choices: Mapping[str, tuple[Any, ...]]  # possible values of the unknown choices, by name
    targets: tuple[FitTarget, ...]  # at least one that is not held out
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
    def condition_numbers(self) -> np.ndarray:
        conditions = self.conditions
        return np.array([conditions.index(target.parameters) for target in self.targets])

    @property
    def combinations(self) -> tuple[dict[str, Any], ...]:
        """Combinations of the unknown choices; one empty one if there is no choice."""
        products = itertools.product(*self.choices.values())
        return tuple(dict(zip(self.choices, values, strict=True)) for values in products)

    def values_at(self, shares: np.ndarray) -> dict[str, np.ndarray]:
        """Return the values of the unknown numbers at points, by name, each of shape (n,)."""
        return {name: item.at(shares[:, i]) for i, (name, item) in enumerate(self.unknowns.items())}

    def configuration(
        self, unknown: Mapping[str, Any], condition: tuple[tuple[str, Any], ...] = ()
    ) -> Configuration:
        """Return the drill for values of the unknowns and a target's own parameters."""
        return to_configuration({**self.parameters, **unknown, **dict(condition)})


def read_target_file(path: str | Path) -> FitSpecification:
    """Return the specification of a YAML file; the paths in it begin at its folder."""
    return specification_of(open_yaml(path, lines=False), Path(path).parent)


def specification_of(top: Cursor, folder: Path) -> FitSpecification:
    """Return the fit that a file, at its top, describes; the paths in it begin at a folder."""
    entries = read_mapping(top, (*_ENTRIES, *_EFFORT), ("unknowns",))
    parameters = top.get("parameters", {})
    fixed = _parameters(parameters, parameters, {})
    unknowns, choices = _unknowns(top.get("unknowns"), fixed)
    targets = [_target(item, fixed) for item in _items(top, "targets")]
    for item in _items(top, "data"):
        targets += _data_targets(item, fixed, folder)
    effort = read_checked(entries, _EFFORT)
    specification = FitSpecification(fixed, unknowns, choices, tuple(targets), **effort)
    if specification.points & (specification.points - 1):
        raise top.refusal(f"points = {specification.points} is no power of two")
    if len(specification.combinations) > _MOST_COMBINATIONS:
        raise top.refusal(f"unknowns: have more than {_MOST_COMBINATIONS} combinations")
    with top.errors():
        missing = _missing_models(specification)
    for number, (target, parameter) in enumerate(zip(targets, missing, strict=True)):
        if parameter and target.sampling is None:
            figure = f"{target.measure.figure} [{target.measure.unit}]"
            raise top.refusal(f"targets[{number}].figure: {figure} needs the parameter {parameter}")
    # A recording may have more than the drill of the fit is asked to model.
    kept = tuple(t for t, parameter in zip(targets, missing, strict=True) if not parameter)
    if all(target.hold_out for target in kept):
        raise top.refusal("targets: holds no target that the fit may use")
    return dataclasses.replace(specification, targets=kept)


def _items(top: Cursor, name: str) -> list[Cursor]:
    return top.get(name, []).sequence(other="holds no list")


def _parameters(cursor: Cursor, entry: Cursor, fixed: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters of an entry; with those that are fixed they make a drill."""
    own = {name: each.value for name, each in read_mapping(cursor, _NAMES).items()}
    with entry.errors():
        to_configuration({**fixed, **own})
    return own


def _unknowns(
    cursor: Cursor, fixed: Mapping[str, Any]
) -> tuple[dict[str, Range], dict[str, tuple[Any, ...]]]:
    ranges: dict[str, Range] = {}
    choices: dict[str, tuple[Any, ...]] = {}
    for name, item in read_mapping(cursor, _NAMES).items():
        if name in fixed:
            raise item.refusal("is among the parameters as well")
        allowed = PARAMETERS[name].allowed
        if isinstance(item.value, Mapping) and "values" in item.value:
            choices[name] = read_values(read_mapping(item, ["values"])["values"], name)
        elif isinstance(allowed, Quantity):
            ranges[name] = _range(item, name)
        elif isinstance(allowed, Choice | Flag):
            choices[name] = read_values(item, name)
        else:
            raise item.refusal("is a text, which cannot be fitted")
    if not ranges:
        raise cursor.refusal("holds no parameter with bounds")
    return ranges, choices


def _range(cursor: Cursor, name: str) -> Range:
    ends, more = cursor.value, {}
    if isinstance(ends, Mapping):
        entries = read_mapping(cursor, ["low", "high", "scale"])
        more = read_checked(entries, {"scale": Choice("", SCALES)})
        ends = [ends.get("low"), ends.get("high")]
    if not (isinstance(ends, list) and len(ends) == 2):
        raise cursor.refusal("{shown} is not of the form [low, high]")
    return checked_range(cursor, name, {"low": ends[0], "high": ends[1]}, **more)


def _target(item: Cursor, fixed: Mapping[str, Any]) -> FitTarget:
    entries = read_mapping(item, (*_TARGET, *_MORE), ("figure", "value", "tolerance"))
    measure = _measure(item, entries)
    least = -_GREATEST if measure.figure in SIGNED else 0.0
    value = float(entries["value"].check(Quantity(measure.unit, "", least, _GREATEST)))
    own = _parameters(item.get("parameters", {}), item, fixed)
    tolerance = _tolerance(entries["tolerance"], value, measure.unit)
    more = read_checked(entries, _MORE)
    return FitTarget(measure, value, tolerance, parameters=tuple(own.items()), **more)


def _measure(item: Cursor, entries: Mapping[str, Cursor]) -> Measure:
    figure = entries["figure"].value
    if not (isinstance(figure, str) and figure in UNITS):
        raise entries["figure"].refusal("{shown} is not a figure; {hint}", UNITS)
    if figure in CONTACT_FIGURES:
        return Measure(figure, 0.0, 0.0)
    window = item.get("window", 5.0)
    content = window.value if isinstance(window.value, list) else [0.0, window.value]
    if len(content) != 2:
        raise window.refusal("{shown} is neither seconds nor [from, to]")
    allowed = Quantity("s", "", 0.0, _LONGEST)
    start, end = (dataclasses.replace(window, value=each).check(allowed) for each in content)
    if not start < end:
        raise window.refusal(f"begins at {start:g} s and ends at {end:g} s")
    quantile = _quantile(entries["statistic"], figure) if "statistic" in entries else None
    return Measure(figure, start, end, quantile)


def _quantile(cursor: Cursor, figure: str) -> float | None:
    """Return the quantile of ``statistic``; None for the mean."""
    if figure not in IMPACT_VALUES:
        raise cursor.refusal(f"{figure} has none; those of {', '.join(IMPACT_VALUES)} have")
    if cursor.value == "mean":
        return None
    word, _, share = str(cursor.value).partition(" ")
    if word != "quantile":
        raise cursor.refusal("{shown} is neither mean nor quantile Q")
    return float(_number(cursor, share).check(Quantity("", "", 0, 1)))


def _number(cursor: Cursor, text: str) -> Cursor:
    """Return the cursor with a number in place of its text; as it is if that is none."""
    try:
        return dataclasses.replace(cursor, value=float(text))
    except ValueError:
        return cursor


def _tolerance(cursor: Cursor, value: float, unit: str) -> float:
    content = cursor.value
    if isinstance(content, str) and content.strip().endswith("%"):
        percent = Quantity("%", "", 0.0, 1e3, exclusive=True)
        tolerance = 0.01 * _number(cursor, content.strip()[:-1]).check(percent) * abs(value)
    else:
        tolerance = cursor.check(Quantity(unit, "", 0.0, _GREATEST, exclusive=True))
    if not tolerance > 0.0:
        raise cursor.refusal(f"{{shown}} of {value:g} is no tolerance above 0")
    return float(tolerance)


def _data_targets(item: Cursor, fixed: Mapping[str, Any], folder: Path) -> list[FitTarget]:
    """Return the targets of an entry of ``data``: the figures of a bag or a CSV file."""
    entries = read_mapping(item, _DATA)
    own = _parameters(item.get("parameters", {}), item, fixed)
    if ("bag" in entries) == ("csv" in entries):
        raise item.refusal("needs either bag or csv, the path of a file")
    file = entries["bag" if "bag" in entries else "csv"]
    if not isinstance(file.value, str):
        raise file.refusal("is no path")
    skip = item.get("skip", 0.5).check(Quantity("s", "", 0.0, 50.0))
    hold_out = item.get("hold_out", False).check(Flag(""))
    with dataclasses.replace(item, name="").errors():
        found, runs = read_data(folder / file.value, "bag" in entries, skip)
    return [
        FitTarget(
            measure,
            value,
            max(_LEAST_ERROR * abs(value), 1e-300),
            runs,
            tuple(own.items()),
            hold_out,
            file.value,
            sampling,
        )
        for measure, value, sampling in found
    ]


def _missing_models(specification: FitSpecification) -> list[str]:
    """Return the parameter that each target needs and a drill of the fit lacks, or nothing.

    Every condition of the targets is checked at the corners that bounds and choices have.
    """
    found = [""] * len(specification.targets)
    numbers = specification.condition_numbers.tolist()
    for combination in specification.combinations:
        for end in ("minimum", "maximum"):
            values = {name: getattr(item, end) for name, item in specification.unknowns.items()}
            drills = [
                specification.configuration({**values, **combination}, condition)
                for condition in specification.conditions
            ]
            for i, target in enumerate(specification.targets):
                found[i] = found[i] or missing_model(drills[numbers[i]], target.measure.figure)
    return found
