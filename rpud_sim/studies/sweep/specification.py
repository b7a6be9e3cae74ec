"""Specification of a sweep, read from YAML: design, ensemble at each point, and parameters."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import ParameterError, Quantity
from rpud_sim.foundation.terminal import printable
from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.model.parameters import NAMES, QUANTITIES
from rpud_sim.simulation import Parameters, preset

DESIGNS = ("grid", "latin_hypercube", "sobol")
SCALES = ("linear", "log")
MOST_SIMULATIONS = 10_000_000
_MOST_SEED = 2**32
_MOST_VALUES = 10_000  # in a list
_DURATION = Quantity("s", "", 1e-9, 1e6)


class SweepError(ValueError):
    """Sweep that is not possible as specified; the text gives the reason in one line."""


@dataclasses.dataclass(frozen=True)
class Range:
    """Interval of values, spread evenly or evenly in their logarithms."""

    minimum: float  # least value, SI units
    maximum: float  # greatest value
    scale: str = "linear"  # of ``SCALES``
    points: int | None = None  # number of values in a grid; None in other designs

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the values at shares of the way from minimum to maximum, in the same shape."""
        if self.scale == "log":
            values = self.minimum * np.exp(shares * math.log(self.maximum / self.minimum))
        else:
            values = self.minimum + shares * (self.maximum - self.minimum)
        values = np.where(shares == 1.0, self.maximum, values)
        return np.clip(values, self.minimum, self.maximum)

    def levels(self) -> np.ndarray:
        """Return the values in a grid, shape (points,)."""
        return self.at(np.linspace(0.0, 1.0, self.points or 0))


@dataclasses.dataclass(frozen=True)
class Values:
    """List of values: numbers in SI units, or choices."""

    values: tuple[float, ...] | tuple[str, ...]

    def at(self, shares: np.ndarray) -> np.ndarray:
        """Return the value at each share in [0, 1); all values have equal parts of it."""
        return self.levels()[(shares * len(self.values)).astype(int)]

    def levels(self) -> np.ndarray:
        """Return the values in a grid."""
        return np.array(self.values)


@dataclasses.dataclass(frozen=True)
class Specification:
    """Sweep over the drill's parameters."""

    design: str  # of ``DESIGNS``
    points: int | None  # number of points; None in a grid, whose ranges have their own
    seed: int  # of the design and of the initial phases
    repeat: int  # simulations at each point, with different initial phases
    duration: float  # of each simulation [s]
    # parameters that differ from the regime's preset at all points
    fixed: Mapping[str, float | str]
    swept: Mapping[str, Range | Values]  # range or values of each swept parameter, by name

    @property
    def point_count(self) -> int:
        """Number of points."""
        if self.points is not None:
            return self.points
        return math.prod(_level_count(item) for item in self.swept.values())

    @property
    def simulations(self) -> int:
        """Number of simulations."""
        return self.point_count * self.repeat

    def parameters(self, point: Mapping[str, float | str]) -> Parameters:
        """Return the drill at a point, given by the values of the swept parameters.

        Raises:
            ParameterError: if a value is outside its range.
        """
        return _to_parameters({**self.fixed, **point})

    def content(self) -> dict[str, Any]:
        """Return the specification as plain values; equal sweeps give equal values."""
        content = dataclasses.asdict(self)
        return content | {
            "fixed": dict(self.fixed),
            "swept": {name: dataclasses.asdict(item) for name, item in self.swept.items()},
        }


def read_specification(path: str | Path) -> Specification:
    """Return the sweep of a YAML file.

    Raises:
        SweepError: if the file is not valid; the text names the file, the entry and the reason.
    """
    try:
        content = read_yaml(path)
    except ParameterError as error:
        raise SweepError(str(error)) from None
    try:
        return parse_specification(content)
    except (SweepError, ParameterError) as error:
        raise SweepError(f"{path}: {error}") from None


def parse_specification(content: Any) -> Specification:
    """Return the sweep that plain values from YAML describe.

    Raises:
        SweepError: if they are not valid; the text names the entry and the reason.
    """
    entries = _mapping("the file", content)
    _refuse_unknown("", entries, [field.name for field in dataclasses.fields(Specification)])
    for name in ("design", "duration", "swept"):
        if name not in entries:
            raise SweepError(f"{name}: is missing")
    design = _choice("design", entries["design"], DESIGNS)
    points = _points(entries, design)
    try:
        duration = _DURATION.check("duration", entries["duration"])
    except ParameterError as error:
        raise SweepError(f"duration: {error}") from None
    fixed = _fixed(entries.get("fixed", {}))
    specification = Specification(
        design,
        points,
        _whole("seed", entries.get("seed", 0), 0, _MOST_SEED),
        _whole("repeat", entries.get("repeat", 1), 1, 1_000_000),
        duration,
        fixed,
        _swept(entries["swept"], fixed, design),
    )
    if specification.simulations > MOST_SIMULATIONS:
        raise SweepError(
            f"swept: {specification.point_count} points of {specification.repeat} simulations "
            f"are more than {MOST_SIMULATIONS}"
        )
    return specification


def _points(entries: Mapping[Any, Any], design: str) -> int | None:
    if design == "grid":
        if "points" in entries:
            raise SweepError("points: a grid has its points at each range of swept")
        return None
    if "points" not in entries:
        raise SweepError(f"points: is missing, the number of points of the {design} design")
    points = _whole("points", entries["points"], 1, MOST_SIMULATIONS)
    if design == "sobol" and points & (points - 1):
        raise SweepError(f"points: {points} is no power of two, as a sobol design needs")
    return points


def _fixed(content: Any) -> dict[str, float | str]:
    fixed = {str(name): value for name, value in _mapping("fixed", content).items()}
    _refuse_unknown("fixed.", fixed, NAMES)
    drill = _checked("fixed", fixed)
    return {name: getattr(drill, name) for name in fixed}


def _swept(
    content: Any, fixed: Mapping[str, float | str], design: str
) -> dict[str, Range | Values]:
    swept = _mapping("swept", content)
    _refuse_unknown("swept.", swept, NAMES)
    if not swept:
        raise SweepError("swept: names no parameter")
    for name in swept:
        if name in fixed:
            raise SweepError(f"swept.{name}: is fixed as well")
    return {name: _range_or_values(name, item, design) for name, item in swept.items()}


def _range_or_values(name: str, content: Any, design: str) -> Range | Values:
    entry = f"swept.{name}"
    if isinstance(content, list):
        return _values(entry, name, content)
    if not isinstance(content, Mapping):
        raise SweepError(f"{entry}: {content!r} is neither a list nor minimum and maximum")
    if name not in QUANTITIES:
        raise SweepError(f"{entry}: has no range; give a list of its choices")
    needed = ["minimum", "maximum", *(["points"] if design == "grid" else [])]
    _refuse_unknown(f"{entry}.", content, [*needed, "scale"])
    for key in needed:
        if key not in content:
            raise SweepError(f"{entry}.{key}: is missing")
    low, high = (
        float(getattr(_checked(f"{entry}.{key}", {name: content[key]}), name))
        for key in ("minimum", "maximum")
    )
    if not low < high:
        raise SweepError(f"{entry}: minimum {low:g} is not below maximum {high:g}")
    scale = _choice(f"{entry}.scale", content.get("scale", "linear"), SCALES)
    if scale == "log" and not low > 0.0:
        raise SweepError(f"{entry}.minimum: {low:g} has no logarithm; it must be above 0")
    points = content.get("points")
    if points is not None:
        points = _whole(f"{entry}.points", points, 2, MOST_SIMULATIONS)
    return Range(low, high, scale, points)


def _values(entry: str, name: str, content: list[Any]) -> Values:
    if not content:
        raise SweepError(f"{entry}: holds no value")
    if len(content) > _MOST_VALUES:
        raise SweepError(f"{entry}: holds {len(content)} values, more than {_MOST_VALUES}")
    values = tuple(
        getattr(_checked(f"{entry}[{number}]", {name: value}), name)
        for number, value in enumerate(content)
    )
    if len(set(values)) < len(values):
        raise SweepError(f"{entry}: holds a value twice")
    return Values(values)


def _to_parameters(values: Mapping[str, Any]) -> Parameters:
    others = {name: value for name, value in values.items() if name != "regime"}
    return preset(values.get("regime", "drilling")).replace(**others)


def _checked(entry: str, values: Mapping[str, Any]) -> Parameters:
    try:
        return _to_parameters(values)
    except ParameterError as error:
        raise SweepError(f"{entry}: {error}") from None


def _level_count(item: Range | Values) -> int:
    return len(item.values) if isinstance(item, Values) else item.points or 0


def _mapping(entry: str, content: Any) -> Mapping[Any, Any]:
    if not isinstance(content, Mapping):
        raise SweepError(f"{entry}: holds no mapping")
    return content


def _refuse_unknown(prefix: str, content: Mapping[Any, Any], names: Any) -> None:
    for name in content:
        if name not in names:
            known = ", ".join(names)
            raise SweepError(f"{prefix}{printable(name)}: is unknown; known are {known}")


def _choice(entry: str, value: Any, choices: tuple[str, ...]) -> str:
    if not (isinstance(value, str) and value in choices):
        raise SweepError(f"{entry}: {value!r} is not one of {', '.join(choices)}")
    return value


def _whole(entry: str, value: Any, least: int, most: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise SweepError(f"{entry}: {value!r} is no whole number from {least} to {most}")
    return value
