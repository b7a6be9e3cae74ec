"""Files of sweeps: from YAML to a checked specification."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import Choice, ParameterError, Quantity, Text
from rpud_sim.foundation.schema import Reader, as_it_is, here, key, list_of, name_in, named, read
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.changes import check_commands
from rpud_sim.simulation.configuration import NODE_NAMES, PARAMETERS
from rpud_sim.simulation.faults import Fault, check_supported
from rpud_sim.simulation.scenario_file import parse_commands
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.studies.sweep.specification import (
    DESIGNS,
    SCALES,
    SWEEP_FIGURES,
    Case,
    Range,
    SweepSpecification,
    Values,
)

MOST_SIMULATIONS = 10_000_000
_MOST_BAGS = 100_000
_MOST_VALUES = 10_000  # in a list
_TIME = Quantity("s", "", 0.0, 1e6)
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
# Parameters that a fit may change; those of the node change no figure.
DRILL_PARAMETERS: Mapping[str, Reader] = {
    name: declaration.allowed for name, declaration in PARAMETERS.items() if name not in NODE_NAMES
}
# The sweep itself gives scenario and seed; the rates of telemetry may be chosen.
_PARAMETERS: Mapping[str, Reader] = {
    **DRILL_PARAMETERS,
    **{name: PARAMETERS[name].allowed for name in ("telemetry_rate", "sample_rate")},
}


def values_of(name: str) -> Reader:
    """Return the reader of a list of values of a parameter."""
    return list_of(PARAMETERS[name].allowed, 1, _MOST_VALUES, unique=True)


def range_between(name: str, low: Cursor, high: Cursor, **more: Any) -> Range:
    """Return the range of a parameter between two values."""
    quantity = PARAMETERS[name].allowed
    if not isinstance(quantity, Quantity) or quantity.whole:
        raise ParameterError(f"{name} has no range; give a list of its values")
    least, most = float(low.check(quantity)), float(high.check(quantity))
    if not least < most:
        raise high.wrong(f"is not above {least:g}")
    if more.get("scale") == "log" and not least > 0.0:
        raise low.wrong("has no logarithm; it must be above 0")
    return Range(least, most, **more)


@dataclasses.dataclass(frozen=True)
class _Spread:
    """Range of a swept parameter."""

    minimum: Cursor = key(here)
    maximum: Cursor = key(here)
    scale: str = key(Choice("", SCALES), "linear")
    points: int | None = key(Quantity("", "", 2, MOST_SIMULATIONS, whole=True), None)
    source: str = key(Text("", ""), "")


def _axis(name: str) -> Callable[[Cursor], Range | Values]:
    def read_axis(cursor: Cursor) -> Range | Values:
        if isinstance(cursor.value, list):
            return Values(read(cursor, values_of(name)))
        spread = vars(read(cursor, _Spread)).copy()
        return range_between(name, spread.pop("minimum"), spread.pop("maximum"), **spread)

    return read_axis


@dataclasses.dataclass(frozen=True)
class _Interval:
    """Times between which one is drawn."""

    minimum: float = key(_TIME)
    maximum: float = key(_TIME)

    def __post_init__(self) -> None:
        if not self.minimum <= self.maximum:
            raise ParameterError(f"minimum = {self.minimum:g} s is above {self.maximum:g} s")


def _interval(cursor: Cursor) -> Range:
    return Range(*vars(read(cursor, _Interval)).values())


def _case(cursor: Cursor) -> Case:
    name = str(cursor.place[-1])
    if not _NAME.fullmatch(name):
        raise cursor.error(
            f"{name!r} is no name of a case: lower-case letters, digits and underscores, at most 40"
        )
    values = read(cursor, {**_PARAMETERS, "commands": parse_commands})
    return Case(values, values.pop("commands", ()))


@dataclasses.dataclass(frozen=True)
class _FaultEntry:
    kind: str = key(as_it_is)
    channel: str = key(as_it_is, "")
    severities: tuple[Any, ...] | None = key(list_of(as_it_is, 1), None)

    def series(self) -> list[Fault]:
        magnitudes = self.severities or (Fault(self.kind, self.channel).magnitude,)
        return [Fault(self.kind, self.channel, magnitude) for magnitude in magnitudes]


def _faults(cursor: Cursor) -> dict[str, Fault]:
    """Return the faults by name: kind, channel, and the number of the severity."""
    faults: dict[str, Fault] = {}
    for item in cursor.sequence():
        with item.errors():
            series = read(item, _FaultEntry).series()
        known = {str(fault) for fault in faults.values()}
        for severity, fault in enumerate(series, 1):
            if str(fault) in known or fault in faults.values():
                raise item.error(f"{fault} stands twice; give its severities in one entry, once")
            name = "-".join(filter(None, (fault.kind, fault.channel, str(severity))))
            faults[name] = fault
    return faults


def _names(known: Iterable[str], kind: str) -> Callable[[Cursor], tuple[str, ...]]:
    """Return the reader of names, which puts them in the order in which they are known."""
    known = tuple(known)

    def read_names(cursor: Cursor) -> tuple[str, ...]:
        given = read(cursor, list_of(name_in(known, kind)))
        return tuple(name for name in known if name in given)

    return read_names


_KEYS: Mapping[str, Reader] = {  # fields of the specification
    "design": Choice("", DESIGNS),
    "points": Quantity("", "", 1, MOST_SIMULATIONS, whole=True),
    "seed": Quantity("", "", 0, 2**32, whole=True),
    "repeat": Quantity("", "", 1, 1_000_000, whole=True),
    "duration": Quantity("s", "", 1e-9, 1e6),
    "fixed": _PARAMETERS,
    "swept": {name: _axis(name) for name in _PARAMETERS},
    "figures": _names(SWEEP_FIGURES, "a figure"),
    "cases": named(_case),
    "faults": _faults,
    "onset": _interval,
    "lasting": _interval,
    "commands": parse_commands,
    "bags": _names(TOPICS, "a topic"),
}


def read_specification(path: str | Path) -> SweepSpecification:
    return specification_of(open_yaml(path))


def specification_of(top: Cursor) -> SweepSpecification:
    """Return the sweep that a file, at its top, describes."""
    top.mapping(_KEYS, ("design", "duration"))
    found = {"points": None, "seed": 0, "repeat": 1, "fixed": {}, "swept": {}, **read(top, _KEYS)}
    found["figures"] = found.get("figures") or tuple(FIGURES)
    specification = SweepSpecification(**found)
    with top.errors():
        _check_names(specification)
        _check_design(specification)
        _check_times(specification)
    _check_drills(top, specification)
    return specification


def _check_names(specification: SweepSpecification) -> None:
    groups = {"fixed": specification.fixed, "swept": specification.swept}
    groups |= {f"cases.{name}": case.parameters for name, case in specification.cases.items()}
    for where, names in groups.items():
        for other in ("fixed", "swept"):
            for name in names.keys() & groups[other].keys() if where != other else ():
                raise ParameterError(f"{where}: {name} is among {other} as well")


def _check_design(specification: SweepSpecification) -> None:
    design, points = specification.design, specification.points
    if design == "grid":
        if points is not None:
            raise ParameterError("points: a grid has its points at each range of swept")
        for name, axis in specification.swept.items():
            if isinstance(axis, Range) and axis.points is None:
                raise ParameterError(f"swept: {name} lacks its points, as a grid needs")
    elif points is None:
        raise ParameterError(f"points is missing, the number of points of the {design} design")
    elif design in ("sobol", "saltelli") and points & (points - 1):
        raise ParameterError(f"points = {points} is no power of two, as a {design} design needs")
    elif design == "saltelli" and points < 2:
        raise ParameterError("points = 1: a saltelli design needs at least 2")
    if not (specification.swept or (design == "grid" and specification.axes)):
        raise ParameterError(f"swept names no parameter, as a {design} design needs")
    if design == "saltelli" and (specification.cases or specification.faults):
        raise ParameterError("design: a saltelli design takes neither cases nor faults")
    most = _MOST_BAGS if specification.bags else MOST_SIMULATIONS
    if specification.simulations > most:
        raise ParameterError(
            f"swept: {specification.point_count} points of {specification.repeat} simulations "
            f"are more than {most}"
        )


def _check_times(specification: SweepSpecification) -> None:
    duration, onset, lasting = (specification.duration, specification.onset, specification.lasting)
    cases = specification.cases.values()
    commands = [*specification.commands, *(each for case in cases for each in case.commands)]
    last = max((each.time / SECOND for each in commands), default=0.0)
    if not last < duration:
        raise ParameterError(f"commands: time = {last:g} s is not below duration = {duration:g} s")
    if specification.faults and onset is None:
        raise ParameterError("onset is missing, the time at which a fault begins")
    if not specification.faults and (onset or lasting):
        raise ParameterError("onset and lasting are of faults, and there are none")
    if onset and not onset.maximum + (lasting.maximum if lasting else 0.0) < duration:
        names = "the maxima of onset and lasting" if lasting else "its maximum"
        raise ParameterError(f"onset: {names} end after duration = {duration:g} s")
    if lasting and not lasting.minimum >= 1e-9:
        raise ParameterError(f"lasting: minimum = {lasting.minimum:g} s is below 1e-09 s")


def _check_drills(top: Cursor, specification: SweepSpecification) -> None:
    """Check cases, words, faults and commands together, at the first value of all else."""
    first = {
        name: item.minimum if isinstance(item, Range) else item.values[0]
        for name, item in specification.swept.items()
    }
    words = [
        {name: value}
        for name, item in specification.swept.items()
        if isinstance(item, Values) and isinstance(item.values[0], str)
        for value in item.values
    ]
    for case in specification.cases or ("",):
        place = top.get("cases", {}).get(case) if case else top
        for other in words or [{}]:
            point = {"case": case, **first, **other}
            with place.errors():
                drill = specification.configuration(point)
                check_commands(specification.planned(point), drill)
                for name, fault in specification.faults.items():
                    try:
                        check_supported(fault, drill)
                    except ParameterError as error:
                        raise ParameterError(f"faults: {name}: {error}") from None
