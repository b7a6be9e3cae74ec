"""Specification of a fit, read from YAML: fixed parameters, unknowns, targets and effort."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import Choice, Flag, ParameterError, Quantity, Text
from rpud_sim.foundation.schema import Reader, here, key, line, list_of, name_in, read
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.configuration import PARAMETERS, Configuration, to_configuration
from rpud_sim.studies.fit.measures import (
    CONTACT_FIGURES,
    IMPACT_VALUES,
    SIGNED,
    UNITS,
    Measure,
    missing_model,
    read_data,
)
from rpud_sim.studies.sweep.specification import SCALES, Range
from rpud_sim.studies.sweep.specification_file import (
    DRILL_PARAMETERS,
    range_between,
    values_of,
)

_GREATEST = 1e300  # value of a target
_LEAST_ERROR = 1e-3  # of the value: instruments are not better
_MOST_COMBINATIONS = 64
_TIME = Quantity("s", "", 0.0, 100.0)  # of a window
_EFFORT: Mapping[str, Reader] = {
    "seed": Quantity("", "seed of everything that is drawn", 0, 2**32 - 1, whole=True),
    "points": Quantity("", "points of a round", 16, 2**16, whole=True),
    "rounds": Quantity("", "rounds", 1, 20, whole=True),
    "repeat": Quantity("", "runs at a point", 2, 1000, whole=True),
    "phase_spread": Quantity("cycles", "greatest initial phase", 0.0, 0.5),
}


@dataclasses.dataclass(frozen=True)
class FitTarget:
    """Result of the drill that the fit must reach."""

    measure: Measure  # its counterpart in a run
    value: float  # of the drill, in SI units
    tolerance: float  # one standard deviation of the value's error [unit of the figure]
    runs: int = 1  # number of averaged runs
    # other values for this target only, by name
    parameters: tuple[tuple[str, Any], ...] = ()
    hold_out: bool = False  # whether the fit does not use it, and only reports it
    source: str = ""  # where the value comes from; may be empty
    # standard error from the scatter between parts of the data; None without data
    sampling: float | None = None

    def error(self, spread: float) -> float:
        """Return the standard deviation of tolerance and scatter, from that of single runs."""
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


@dataclasses.dataclass(frozen=True)
class _Bounds:
    low: Cursor = key(here)
    high: Cursor = key(here)
    scale: str = key(Choice("", SCALES), "linear")


def _unknown(name: str) -> Callable[[Cursor], Range | tuple[Any, ...]]:
    """Return the reader of an unknown: bounds of a number, or values to choose from."""

    def read_unknown(cursor: Cursor) -> Range | tuple[Any, ...]:
        allowed, given = PARAMETERS[name].allowed, cursor.value
        if isinstance(given, Mapping) and "values" in given:
            return tuple(read(cursor, {"values": values_of(name)})["values"])
        if isinstance(allowed, Text):
            raise cursor.error(f"{name} is a text, which cannot be fitted")
        if not isinstance(allowed, Quantity):
            return tuple(read(cursor, values_of(name)))
        if isinstance(given, list):
            return range_between(name, *read(cursor, list_of(here, 2, 2)))
        bounds = read(cursor, _Bounds)
        return range_between(name, bounds.low, bounds.high, scale=bounds.scale)

    return read_unknown


def _window(cursor: Cursor) -> tuple[float, float]:
    if isinstance(cursor.value, list):
        start, end = read(cursor, list_of(_TIME, 2, 2))
    else:
        start, end = 0.0, cursor.check(_TIME)
    if not start < end:
        raise cursor.wrong(f"begins at {start:g} s and ends at {end:g} s")
    return start, end


def _quantile(cursor: Cursor) -> float | None:
    """Return the quantile of ``statistic``; None for the mean."""
    if cursor.value == "mean":
        return None
    word, _, share = str(cursor.value).partition(" ")
    if word != "quantile":
        raise cursor.wrong("is neither mean nor quantile Q")
    return float(_number(cursor, share).check(Quantity("", "", 0, 1)))


def _number(cursor: Cursor, text: str) -> Cursor:
    """Return the cursor with a number in place of its text; as it is if that is none."""
    try:
        return dataclasses.replace(cursor, value=float(text))
    except ValueError:
        return cursor


@dataclasses.dataclass(frozen=True)
class _TargetEntry:
    figure: str = key(name_in(UNITS, "a figure"))
    value: Cursor = key(here)  # its unit and range belong to the figure
    tolerance: Cursor = key(here)
    statistic: float | None = key(_quantile, None)
    window: tuple[float, float] = key(_window, (0.0, 5.0))
    parameters: Mapping[str, Any] = key(DRILL_PARAMETERS, {})
    runs: int = key(Quantity("", "", 1, 1e9, whole=True), 1)
    hold_out: bool = key(Flag(""), False)
    source: str = key(Text("", ""), "")


def _target(cursor: Cursor) -> FitTarget:
    entry: _TargetEntry = read(cursor, _TargetEntry)
    figure = entry.figure
    if "statistic" in cursor.value and figure not in IMPACT_VALUES:
        raise cursor.get("statistic").error(
            f"statistic: {figure} has none; those of {', '.join(IMPACT_VALUES)} have"
        )
    window = (0.0, 0.0) if figure in CONTACT_FIGURES else entry.window
    measure = Measure(figure, *window, entry.statistic)
    least = -_GREATEST if figure in SIGNED else 0.0
    value = float(entry.value.check(Quantity(measure.unit, "", least, _GREATEST)))
    tolerance = _tolerance(entry.tolerance, value, measure.unit)
    own = tuple(entry.parameters.items())
    return FitTarget(measure, value, tolerance, entry.runs, own, entry.hold_out, entry.source)


def _tolerance(cursor: Cursor, value: float, unit: str) -> float:
    content = cursor.value
    if isinstance(content, str) and content.strip().endswith("%"):
        percent = Quantity("%", "", 0.0, 1e3, exclusive=True)
        tolerance = 0.01 * _number(cursor, content.strip()[:-1]).check(percent) * abs(value)
    else:
        tolerance = cursor.check(Quantity(unit, "", 0.0, _GREATEST, exclusive=True))
    if not tolerance > 0.0:
        raise cursor.wrong(f"of {value:g} is no tolerance above 0")
    return float(tolerance)


@dataclasses.dataclass(frozen=True)
class _DataEntry:
    bag: str = key(line, "")
    csv: str = key(line, "")
    skip: float = key(Quantity("s", "", 0.0, 50.0), 0.5)
    parameters: Mapping[str, Any] = key(DRILL_PARAMETERS, {})
    hold_out: bool = key(Flag(""), False)


def _data_targets(cursor: Cursor) -> list[FitTarget]:
    """Return the targets of an entry of ``data``: the figures of a bag or a CSV file."""
    entry: _DataEntry = read(cursor, _DataEntry)
    if bool(entry.bag) == bool(entry.csv):
        raise cursor.error("data needs either bag or csv, the path of a file")
    path = entry.bag or entry.csv
    own = tuple(entry.parameters.items())
    found, runs = read_data(Path(cursor.file).parent / path, bool(entry.bag), entry.skip)
    return [
        FitTarget(
            measure,
            value,
            max(_LEAST_ERROR * abs(value), 1e-300),
            runs,
            own,
            entry.hold_out,
            path,
            sampling,
        )
        for measure, value, sampling in found
    ]


_KEYS: Mapping[str, Reader] = {
    "parameters": DRILL_PARAMETERS,
    "unknowns": {name: _unknown(name) for name in DRILL_PARAMETERS},
    "targets": list_of(_target),
    "data": list_of(_data_targets),
    **_EFFORT,
}


def read_target_file(path: str | Path) -> FitSpecification:
    """Return the specification of a YAML file; the paths in it begin at its folder."""
    return specification_of(open_yaml(path))


def specification_of(top: Cursor) -> FitSpecification:
    """Return the fit that a file, at its top, describes."""
    top.mapping(_KEYS, ("unknowns",))
    found = read(top, _KEYS)
    fixed, unknowns = found.pop("parameters", {}), found.pop("unknowns")
    for name in unknowns.keys() & fixed.keys():
        raise top.get("unknowns").get(name).error(f"{name} is among the parameters as well")
    ranges = {name: item for name, item in unknowns.items() if isinstance(item, Range)}
    if not ranges:
        raise top.get("unknowns").error("unknowns holds no parameter with bounds")
    choices = {name: item for name, item in unknowns.items() if name not in ranges}
    targets = list(found.pop("targets", ()))
    targets += [each for listed in found.pop("data", ()) for each in listed]
    specification = FitSpecification(fixed, ranges, choices, tuple(targets), **found)
    with top.get("parameters", {}).errors():
        to_configuration(fixed)
    for item in (*top.get("targets", []).sequence(), *top.get("data", []).sequence()):
        with item.errors():
            to_configuration({**fixed, **item.value.get("parameters", {})})
    with top.errors():
        if specification.points & (specification.points - 1):
            raise ParameterError(f"points = {specification.points} is no power of two")
        if len(specification.combinations) > _MOST_COMBINATIONS:
            raise ParameterError(f"unknowns have more than {_MOST_COMBINATIONS} combinations")
        missing = _missing_models(specification)
        for number, (target, lacking) in enumerate(zip(targets, missing, strict=True)):
            if lacking and target.sampling is None:
                figure = f"{target.measure.figure} [{target.measure.unit}]"
                place = top.get("targets").sequence()[number]
                raise place.error(f"figure {figure} needs the parameter {lacking}")
        # A recording may have more than the drill of the fit is asked to model.
        kept = tuple(t for t, lacking in zip(targets, missing, strict=True) if not lacking)
        if all(target.hold_out for target in kept):
            raise ParameterError("targets holds no target that the fit may use")
    return dataclasses.replace(specification, targets=kept)


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
