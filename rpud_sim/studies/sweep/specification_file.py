"""Files of sweeps: from YAML to a checked specification."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import Allowed, Choice, Flag, Quantity, Text
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import Cursor, open_yaml
from rpud_sim.simulation.configuration import NODE_NAMES, PARAMETERS
from rpud_sim.simulation.faults import Fault, check_supported
from rpud_sim.simulation.plans import check_commands
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
_PLAIN: Mapping[str, Allowed] = {
    "design": Choice("", DESIGNS),
    "points": Quantity("", "", 1, MOST_SIMULATIONS, whole=True),
    "seed": Quantity("", "", 0, 2**32, whole=True),
    "repeat": Quantity("", "", 1, 1_000_000, whole=True),
    "duration": Quantity("s", "", 1e-9, 1e6),
}
_OF_RANGE: Mapping[str, Allowed] = {
    "scale": Choice("", SCALES),
    "points": Quantity("", "", 2, MOST_SIMULATIONS, whole=True),
    "source": Text("", ""),
}
_TIME = Quantity("s", "", 0.0, 1e6)
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
_ENDS = ("minimum", "maximum")
# The sweep itself gives scenario and seed; the rates of telemetry may be chosen.
_NAMES = tuple(
    name
    for name in PARAMETERS
    if name not in NODE_NAMES or name in ("telemetry_rate", "sample_rate")
)


def read_specification(path: str | Path) -> SweepSpecification:
    # Without truth values: off is a kind of fault.
    return specification_of(open_yaml(path, truth_values=False, lines=False))


def specification_of(top: Cursor) -> SweepSpecification:
    """Return the sweep that a file, at its top, describes."""
    names = [field.name for field in dataclasses.fields(SweepSpecification)]
    entries = read_mapping(top, names, ("design", "duration"))
    plain = read_checked(entries, _PLAIN)
    design = plain["design"]
    _check_points(top, design, plain.get("points"))
    fixed = _parameters(top.get("fixed", {}))
    swept = read_mapping(top.get("swept", {}), _NAMES)
    for name, item in swept.items():
        if name in fixed:
            raise item.refusal("is fixed as well")
    ranges = {name: _range_or_values(item, name, design) for name, item in swept.items()}
    specification = SweepSpecification(
        **{"points": None, "seed": 0, "repeat": 1, **plain},
        fixed=fixed,
        swept=ranges,
        figures=_names(top.get("figures", []), SWEEP_FIGURES) or tuple(FIGURES),
        cases=_cases(top.get("cases", {}), {*fixed, *swept}),
        faults=_faults(top.get("faults", [])),
        onset=_interval(entries["onset"]) if "onset" in entries else None,
        lasting=_interval(entries["lasting"]) if "lasting" in entries else None,
        commands=parse_commands(top.get("commands", [])),
        bags=_names(top.get("bags", []), TOPICS),
    )
    _check_design(top, specification)
    _check_times(top, specification)
    _check_drills(top, specification)
    return specification


def _check_design(top: Cursor, specification: SweepSpecification) -> None:
    design = specification.design
    if not specification.axes:
        raise top.refusal("swept: names no parameter, and there are neither cases nor faults")
    if design != "grid" and not specification.swept:
        raise top.refusal(f"swept: names no parameter, as a {design} design needs")
    if design == "saltelli" and (specification.cases or specification.faults):
        raise top.refusal("design: a saltelli design takes neither cases nor faults")
    most = _MOST_BAGS if specification.bags else MOST_SIMULATIONS
    if specification.simulations > most:
        raise top.refusal(
            f"swept: {specification.point_count} points of {specification.repeat} simulations "
            f"are more than {most}"
        )


def _check_times(top: Cursor, specification: SweepSpecification) -> None:
    duration, onset, lasting = (specification.duration, specification.onset, specification.lasting)
    cases = specification.cases.values()
    commands = [*specification.commands, *(each for case in cases for each in case.commands)]
    last = max((each.delay / SECOND for each in commands), default=0.0)
    if not last < duration:
        raise top.refusal(f"commands: time = {last:g} s is not below duration = {duration:g} s")
    if specification.faults and onset is None:
        raise top.refusal("onset: is missing, the time at which a fault begins")
    if not specification.faults and (onset or lasting):
        raise top.refusal("onset and lasting are of faults, and there are none")
    if onset and not onset.maximum + (lasting.maximum if lasting else 0.0) < duration:
        names = "onset.maximum + lasting.maximum" if lasting else "onset.maximum"
        raise top.refusal(f"{names}: is not below duration = {duration:g} s")
    if lasting and not lasting.minimum >= 1e-9:
        raise top.refusal(f"lasting.minimum: {lasting.minimum:g} s is below 1e-09 s")


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
        place = dataclasses.replace(top, name=f"cases.{case}" if case else "")
        for other in words or [{}]:
            point = {"case": case, **first, **other}
            with place.errors():
                drill = specification.configuration(point)
                check_commands(specification.planned(point), drill)
            for name, fault in specification.faults.items():
                outer = f"{place.name}: " if case else ""
                with dataclasses.replace(top, name=f"{outer}faults: {name}").errors():
                    check_supported(fault, drill)


def _check_points(top: Cursor, design: str, points: int | None) -> None:
    if design == "grid":
        if points is not None:
            raise top.refusal("points: a grid has its points at each range of swept")
    elif points is None:
        raise top.refusal(f"points: is missing, the number of points of the {design} design")
    elif design in ("sobol", "saltelli") and points & (points - 1):
        raise top.refusal(f"points: {points} is no power of two, as a {design} design needs")
    elif design == "saltelli" and points < 2:
        raise top.refusal("points: a saltelli design needs at least 2")


def _parameters(cursor: Cursor, taken: Collection[str] = ()) -> dict[str, Any]:
    values = read_mapping(cursor, _NAMES)
    for name, item in values.items():
        if name in taken:
            raise item.refusal("is given elsewhere as well")
    return {name: _checked(cursor, name, item.value) for name, item in values.items()}


def _cases(cursor: Cursor, taken: Collection[str]) -> dict[str, Case]:
    cases: dict[str, Case] = {}
    for name, item in read_mapping(cursor).items():
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise item.refusal(
                "is not a name: lower-case letters, digits and underscores, at most 40"
            )
        values = {key: each.value for key, each in read_mapping(item).items()}
        commands = parse_commands(item.get("commands", []))
        values.pop("commands", None)
        own = dataclasses.replace(item, value=values)
        cases[name] = Case(_parameters(own, taken), commands)
    return cases


def _faults(cursor: Cursor) -> dict[str, Fault]:
    """Return the faults by name: kind, channel, and the number of the severity."""
    faults: dict[str, Fault] = {}
    for item in cursor.sequence():
        values = read_mapping(item, ("kind", "channel", "severities"), ("kind",))
        kind, channel = values["kind"].value, item.get("channel", "").value
        with item.errors():
            severities = item.get("severities", None)
            magnitudes = severities.value
            if "severities" not in values:
                magnitudes = [Fault(kind, channel).magnitude]
            if not (isinstance(magnitudes, list) and magnitudes):
                raise severities.refusal("{shown} is not a list of magnitudes")
            series = [Fault(kind, channel, magnitude) for magnitude in magnitudes]
        for severity, fault in enumerate(series, 1):
            if fault in faults.values():
                raise item.refusal(f"{fault} stands twice with magnitude {fault.magnitude}")
            known = any((each.kind, each.channel) == (kind, channel) for each in faults.values())
            if severity == 1 and known:
                raise item.refusal(f"{fault} stands twice; give all severities in one entry")
            faults["-".join(filter(None, (kind, channel, str(severity))))] = fault
    return faults


def _interval(cursor: Cursor) -> Range:
    values = read_mapping(cursor, _ENDS, _ENDS)
    low, high = (float(values[end].check(_TIME)) for end in _ENDS)
    if not low <= high:
        raise cursor.refusal(f"minimum {low:g} is above maximum {high:g}")
    return Range(low, high)


def _range_or_values(cursor: Cursor, name: str, design: str) -> Range | Values:
    if isinstance(cursor.value, list):
        return Values(read_values(cursor, name))
    if not isinstance(cursor.value, Mapping):
        raise cursor.refusal("{shown} is neither a list nor minimum and maximum")
    allowed = PARAMETERS[name].allowed
    if not isinstance(allowed, Quantity) or allowed.whole:
        raise cursor.refusal("has no range; give a list of its choices")
    needed = (*_ENDS, *(["points"] if design == "grid" else []))
    entries = read_mapping(cursor, (*needed, "scale", "source"), needed)
    ends = {end: entries[end].value for end in _ENDS}
    return checked_range(cursor, name, ends, **read_checked(entries, _OF_RANGE))


def checked_range(cursor: Cursor, name: str, ends: Mapping[str, Any], **more: Any) -> Range:
    """Return the range of a parameter between two ends, given by their names in the file."""
    (first, _), (last, _) = ends.items()
    low, high = (float(_checked(cursor, name, value)) for value in ends.values())
    if not low < high:
        raise cursor.refusal(f"{first} {low:g} is not below {last} {high:g}")
    if more.get("scale") == "log" and not low > 0.0:
        raise cursor.refusal(f"{first} {low:g} has no logarithm; it must be above 0")
    return Range(low, high, **more)


def read_values(cursor: Cursor, name: str) -> tuple[Any, ...]:
    items = cursor.sequence(other="{shown} is not a list of values")
    if not items:
        raise cursor.refusal("holds no value")
    if len(items) > _MOST_VALUES:
        raise cursor.refusal(f"holds {len(items)} values, more than {_MOST_VALUES}")
    values = tuple(_checked(item, name, item.value) for item in items)
    if len(set(values)) < len(values):
        raise cursor.refusal("holds a value twice")
    return values


def _checked(place: Cursor, name: str, value: Any) -> Any:
    """Return the value of a parameter; a word stands for a truth value."""
    allowed = PARAMETERS[name].allowed
    if isinstance(allowed, Flag) and isinstance(value, str):
        value = {"true": True, "false": False}.get(value, value)
    with place.errors():
        return allowed.check(name, value)


def _names(cursor: Cursor, known: Iterable[str]) -> tuple[str, ...]:
    """Return names of a list, in the order in which they are known."""
    known = tuple(known)
    for item in cursor.sequence(other="{shown} is not a list of names"):
        if not (isinstance(item.value, str) and item.value in known):
            raise item.refusal("{shown} is unknown; {hint}", known)
    return tuple(name for name in known if name in cursor.value)


def read_checked(entries: Mapping[str, Cursor], allowed: Mapping[str, Allowed]) -> dict[str, Any]:
    """Return the values of those entries that are given, checked."""
    return {name: entries[name].check(each) for name, each in allowed.items() if name in entries}


def read_mapping(
    cursor: Cursor, known: Iterable[str] | None = None, needed: Iterable[str] = ()
) -> dict[Any, Cursor]:
    """Return the values of a mapping by key, of which some are ``known`` and some are needed."""
    texts = {"unknown": "is unknown; {hint}", "missing": "is missing"}
    other = "holds no mapping" if cursor.name else "the file: holds no mapping"
    return cursor.mapping(known, needed, other=other, **texts)
