"""Files of sweeps: from YAML to a checked specification."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import (
    Flag,
    ParameterError,
    Quantity,
    did_you_mean,
    shown,
    shown_name,
)
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import cursor_at, read_yaml
from rpud_sim.simulation.changes import Planned, check_commands, parse_commands
from rpud_sim.simulation.configuration import NODE_NAMES, PARAMETERS
from rpud_sim.simulation.faults import Fault, FaultError, check_supported
from rpud_sim.simulation.statistics import FIGURES
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.studies.sweep.specification import (
    DESIGNS,
    SCALES,
    SWEEP_FIGURES,
    Case,
    Interval,
    Range,
    SweepError,
    SweepSpecification,
    Values,
)

MOST_SIMULATIONS = 10_000_000
_MOST_BAGS = 100_000
_MOST_SEED = 2**32
_MOST_VALUES = 10_000  # in a list
_DURATION = Quantity("s", "", 1e-9, 1e6)
_TIME = Quantity("s", "", 0.0, 1e6)
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
# The sweep itself gives scenario and seed; the rates of telemetry may be chosen.
_NAMES = tuple(
    name
    for name in PARAMETERS
    if name not in NODE_NAMES or name in ("telemetry_rate", "sample_rate")
)


def read_specification(path: str | Path) -> SweepSpecification:
    """Return the sweep of a YAML file.

    Raises:
        SweepError: if the file is not valid; the text names the file, the entry and the reason.
    """
    try:
        # Without truth values: off is a kind of fault.
        content = read_yaml(path, truth_values=False)
    except ParameterError as error:
        raise SweepError(str(error)) from None
    try:
        return parse_specification(content)
    except SweepError as error:
        raise SweepError(f"{path}: {error}") from None


def parse_specification(content: Any) -> SweepSpecification:
    """Return the sweep that plain values from YAML describe.

    Raises:
        SweepError: if they are not valid; the text names the entry and the reason.
    """
    entries = _mapping("the file", content)
    _refuse_unknown("", entries, [field.name for field in dataclasses.fields(SweepSpecification)])
    for name in ("design", "duration"):
        if name not in entries:
            raise SweepError(f"{name}: is missing")
    design = _choice("design", entries["design"], DESIGNS)
    points = _points(entries, design)
    fixed = _parameters("fixed", entries.get("fixed", {}))
    swept = _swept(entries.get("swept", {}), fixed, design)
    specification = SweepSpecification(
        design,
        points,
        _whole("seed", entries.get("seed", 0), 0, _MOST_SEED),
        _whole("repeat", entries.get("repeat", 1), 1, 1_000_000),
        _number("duration", entries["duration"], _DURATION),
        fixed,
        swept,
        _names("figures", entries.get("figures", list(FIGURES)), SWEEP_FIGURES) or tuple(FIGURES),
        _cases(entries.get("cases", {}), {*fixed, *swept}),
        _faults(entries.get("faults", [])),
        _interval("onset", entries["onset"]) if "onset" in entries else None,
        _interval("lasting", entries["lasting"]) if "lasting" in entries else None,
        _commands("commands", entries.get("commands", [])),
        _names("bags", entries.get("bags", []), TOPICS),
    )
    _check_design(specification)
    _check_times(specification)
    _check_drills(specification)
    return specification


def _check_design(specification: SweepSpecification) -> None:
    if not specification.axes:
        raise SweepError("swept: names no parameter, and there are neither cases nor faults")
    if specification.design != "grid" and not specification.swept:
        raise SweepError(f"swept: names no parameter, as a {specification.design} design needs")
    if specification.design == "saltelli" and (specification.cases or specification.faults):
        raise SweepError("design: a saltelli design takes neither cases nor faults")
    most = _MOST_BAGS if specification.bags else MOST_SIMULATIONS
    if specification.simulations > most:
        raise SweepError(
            f"swept: {specification.point_count} points of {specification.repeat} simulations "
            f"are more than {most}"
        )


def _check_times(specification: SweepSpecification) -> None:
    duration, onset, lasting = (
        specification.duration,
        specification.onset,
        specification.lasting,
    )
    commands = [*specification.commands]
    for case in specification.cases.values():
        commands += case.commands
    last = max((each.delay / SECOND for each in commands), default=0.0)
    if not last < duration:
        raise SweepError(f"commands: time = {last:g} s is not below duration = {duration:g} s")
    if specification.faults and onset is None:
        raise SweepError("onset: is missing, the time at which a fault begins")
    if not specification.faults and (onset or lasting):
        raise SweepError("onset and lasting are of faults, and there are none")
    if onset and not onset.maximum + (lasting.maximum if lasting else 0.0) < duration:
        names = "onset.maximum + lasting.maximum" if lasting else "onset.maximum"
        raise SweepError(f"{names}: is not below duration = {duration:g} s")
    if lasting and not lasting.minimum >= 1e-9:
        raise SweepError(f"lasting.minimum: {lasting.minimum:g} s is below 1e-09 s")


def _check_drills(specification: SweepSpecification) -> None:
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
        place = f"cases.{case}: " if case else ""
        for other in words or [{}]:
            point = {"case": case, **first, **other}
            try:
                drill = specification.configuration(point)
                check_commands(specification.planned(point), drill)
            except ParameterError as error:
                raise SweepError(f"{place}{error}") from None
            for name, fault in specification.faults.items():
                try:
                    check_supported(fault, drill)
                except FaultError as error:
                    raise SweepError(f"{place}faults: {name}: {error}") from None


def _points(entries: Mapping[Any, Any], design: str) -> int | None:
    if design == "grid":
        if "points" in entries:
            raise SweepError("points: a grid has its points at each range of swept")
        return None
    if "points" not in entries:
        raise SweepError(f"points: is missing, the number of points of the {design} design")
    points = _whole("points", entries["points"], 1, MOST_SIMULATIONS)
    if design in ("sobol", "saltelli") and points & (points - 1):
        raise SweepError(f"points: {points} is no power of two, as a {design} design needs")
    if design == "saltelli" and points < 2:
        raise SweepError("points: a saltelli design needs at least 2")
    return points


def _parameters(entry: str, content: Any, taken: Iterable[str] = ()) -> dict[str, Any]:
    values = _mapping(entry, content)
    _refuse_unknown(f"{entry}.", values, _NAMES)
    for name in values:
        if name in taken:
            raise SweepError(f"{entry}.{name}: is given elsewhere as well")
    return {name: _checked(entry, name, value) for name, value in values.items()}


def _cases(content: Any, taken: Iterable[str]) -> dict[str, Case]:
    cases: dict[str, Case] = {}
    for name, entry in _mapping("cases", content).items():
        place = f"cases.{shown_name(name)}"
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise SweepError(
                f"{place}: is not a name: lower-case letters, digits and underscores, at most 40"
            )
        values = dict(_mapping(place, entry))
        commands = _commands(f"{place}.commands", values.pop("commands", []))
        cases[name] = Case(_parameters(place, values, taken), commands)
    return cases


def _commands(entry: str, content: Any) -> tuple[Planned, ...]:
    cursor = cursor_at(content, entry, SweepError)
    return parse_commands(cursor.sequence("command {number}", other="{shown} is not a list"))


def _faults(content: Any) -> dict[str, Fault]:
    """Return the faults by name: kind, channel, and the number of the severity."""
    if not isinstance(content, list):
        raise SweepError(f"faults: {shown(content)} is not a list")
    faults: dict[str, Fault] = {}
    for number, item in enumerate(content, 1):
        place = f"faults: entry {number}"
        values = _mapping(place, item)
        _refuse_unknown(f"{place}: ", values, ("kind", "channel", "severities"))
        if "kind" not in values:
            raise SweepError(f"{place}: kind is missing")
        kind, channel = values["kind"], values.get("channel", "")
        try:
            severities = values.get("severities", [Fault(kind, channel).magnitude])
            if not (isinstance(severities, list) and severities):
                raise SweepError(
                    f"{place}: severities: {shown(severities)} is not a list of magnitudes"
                )
            series = [Fault(kind, channel, magnitude) for magnitude in severities]
        except FaultError as error:
            raise SweepError(f"{place}: {error}") from None
        for severity, fault in enumerate(series, 1):
            if fault in faults.values():
                raise SweepError(f"{place}: {fault} stands twice with magnitude {fault.magnitude}")
            known = sum((each.kind, each.channel) == (kind, channel) for each in faults.values())
            if severity == 1 and known:
                raise SweepError(f"{place}: {fault} stands twice; give all severities in one entry")
            faults["-".join(filter(None, (kind, channel, str(severity))))] = fault
    return faults


def _interval(entry: str, content: Any) -> Interval:
    values = _mapping(entry, content)
    _refuse_unknown(f"{entry}.", values, ("minimum", "maximum"))
    for key in ("minimum", "maximum"):
        if key not in values:
            raise SweepError(f"{entry}.{key}: is missing")
    low, high = (_number(f"{entry}.{key}", values[key], _TIME) for key in ("minimum", "maximum"))
    if not low <= high:
        raise SweepError(f"{entry}: minimum {low:g} is above maximum {high:g}")
    return Interval(low, high)


def _swept(content: Any, fixed: Mapping[str, Any], design: str) -> dict[str, Range | Values]:
    swept = _mapping("swept", content)
    _refuse_unknown("swept.", swept, _NAMES)
    for name in swept:
        if name in fixed:
            raise SweepError(f"swept.{name}: is fixed as well")
    return {name: _range_or_values(name, item, design) for name, item in swept.items()}


def _range_or_values(name: str, content: Any, design: str) -> Range | Values:
    entry = f"swept.{name}"
    if isinstance(content, list):
        return _values(entry, name, content)
    if not isinstance(content, Mapping):
        raise SweepError(f"{entry}: {shown(content)} is neither a list nor minimum and maximum")
    allowed = PARAMETERS[name].allowed
    if not isinstance(allowed, Quantity) or allowed.whole:
        raise SweepError(f"{entry}: has no range; give a list of its choices")
    needed = ["minimum", "maximum", *(["points"] if design == "grid" else [])]
    _refuse_unknown(f"{entry}.", content, [*needed, "scale", "source"])
    for key in needed:
        if key not in content:
            raise SweepError(f"{entry}.{key}: is missing")
    low, high = (
        float(_checked(f"{entry}.{key}", name, content[key])) for key in ("minimum", "maximum")
    )
    if not low < high:
        raise SweepError(f"{entry}: minimum {low:g} is not below maximum {high:g}")
    scale = _choice(f"{entry}.scale", content.get("scale", "linear"), SCALES)
    if scale == "log" and not low > 0.0:
        raise SweepError(f"{entry}.minimum: {low:g} has no logarithm; it must be above 0")
    points = content.get("points")
    if points is not None:
        points = _whole(f"{entry}.points", points, 2, MOST_SIMULATIONS)
    source = content.get("source", "")
    if not isinstance(source, str):
        raise SweepError(f"{entry}.source: {shown(source)} is not a text")
    return Range(low, high, scale, points, source)


def _values(entry: str, name: str, content: list[Any]) -> Values:
    if not content:
        raise SweepError(f"{entry}: holds no value")
    if len(content) > _MOST_VALUES:
        raise SweepError(f"{entry}: holds {len(content)} values, more than {_MOST_VALUES}")
    values = tuple(_checked(f"{entry}[{i}]", name, value) for i, value in enumerate(content))
    if len(set(values)) < len(values):
        raise SweepError(f"{entry}: holds a value twice")
    return Values(values)


def _checked(entry: str, name: str, value: Any) -> Any:
    """Return the value of a parameter; a word stands for a truth value."""
    allowed = PARAMETERS[name].allowed
    if isinstance(allowed, Flag) and isinstance(value, str):
        value = {"true": True, "false": False}.get(value, value)
    try:
        return allowed.check(name, value)
    except ParameterError as error:
        raise SweepError(f"{entry}: {error}") from None


def _number(entry: str, value: Any, quantity: Quantity) -> float:
    try:
        return float(quantity.check(entry, value))
    except ParameterError as error:
        raise SweepError(str(error)) from None


def _names(entry: str, content: Any, known: Iterable[str]) -> tuple[str, ...]:
    """Return names of a list, in the order in which they are known."""
    known = tuple(known)
    if not isinstance(content, list):
        raise SweepError(f"{entry}: {shown(content)} is not a list of names")
    for name in content:
        if not (isinstance(name, str) and name in known):
            raise SweepError(f"{entry}: {shown_name(name)} is unknown; {did_you_mean(name, known)}")
    return tuple(name for name in known if name in content)


def _mapping(entry: str, content: Any) -> Mapping[Any, Any]:
    if not isinstance(content, Mapping):
        raise SweepError(f"{entry}: holds no mapping")
    return content


def _refuse_unknown(prefix: str, content: Mapping[Any, Any], names: Iterable[str]) -> None:
    names = tuple(names)
    for name in content:
        if not (isinstance(name, str) and name in names):
            raise SweepError(f"{prefix}{shown_name(name)}: is unknown; {did_you_mean(name, names)}")


def _choice(entry: str, value: Any, choices: tuple[str, ...]) -> str:
    if not (isinstance(value, str) and value in choices):
        raise SweepError(f"{entry}: {shown(value)} is not one of {', '.join(choices)}")
    return value


def _whole(entry: str, value: Any, least: int, most: int) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise SweepError(f"{entry}: {shown(value)} is no whole number from {least} to {most}")
    return value
