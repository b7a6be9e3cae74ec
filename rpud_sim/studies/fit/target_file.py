"""Reading of a fit's specification; each mistake is one line with file, entry and reason."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import (
    Choice,
    Flag,
    ParameterError,
    Quantity,
    Text,
    did_you_mean,
    shown,
    shown_name,
)
from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.simulation.configuration import NODE_NAMES, PARAMETERS, to_configuration
from rpud_sim.studies.fit.data import read_data
from rpud_sim.studies.fit.measures import (
    CONTACT_FIGURES,
    IMPACT_VALUES,
    SIGNED,
    UNITS,
    Measure,
    missing_model,
)
from rpud_sim.studies.fit.specification import Specification, Target
from rpud_sim.studies.sweep.specification import SCALES, Range

_LONGEST = 100.0  # end of a window [s]
_GREATEST = 1e300  # value of a target
_ENTRIES = ("parameters", "unknowns", "targets", "data")
_EFFORT = {
    "seed": Quantity("", "seed of everything that is drawn", 0, 2**32 - 1, whole=True),
    "points": Quantity("", "points of a round", 16, 2**16, whole=True),
    "rounds": Quantity("", "rounds", 1, 20, whole=True),
    "repeat": Quantity("", "runs at a point", 2, 1000, whole=True),
    "phase_spread": Quantity("cycles", "greatest initial phase", 0.0, 0.5),
}
_TARGET = (
    *("figure", "statistic", "window", "value", "tolerance", "runs"),
    *("parameters", "hold_out", "source"),
)
_MOST_COMBINATIONS = 64
# Parameters of the drill; those of the node change no figure.
_NAMES = tuple(name for name in PARAMETERS if name not in NODE_NAMES)


def read_target_file(path: str | Path) -> Specification:
    """Return the specification of a YAML file; the paths in it begin at its folder."""
    content = read_yaml(path)
    try:
        return parse_targets(content, Path(path).parent)
    except ParameterError as error:
        raise ParameterError(f"{path}: {error}") from None


def parse_targets(content: Any, folder: Path = Path()) -> Specification:
    """Return the specification that plain values from YAML describe.

    Args:
        folder: at which paths begin.
    """
    if content is None:
        raise ParameterError("is empty")
    entries = _mapping("the file", content)
    _known("", entries, [*_ENTRIES, *_EFFORT], "an entry")
    fixed = dict(_mapping("parameters", entries.get("parameters", {})))
    _check_parameters("parameters", fixed)
    unknowns, choices = _unknowns(entries.get("unknowns"), fixed)
    targets = [
        _target(f"targets[{number}]", item, fixed)
        for number, item in enumerate(_list("targets", entries.get("targets", [])))
    ]
    for number, item in enumerate(_list("data", entries.get("data", []))):
        entry = f"data[{number}]"
        own = _own_parameters(entry, _mapping(entry, item), fixed)
        targets += read_data(entry, item, own, folder)
    effort = {
        name: allowed.check(name, entries[name])
        for name, allowed in _EFFORT.items()
        if name in entries
    }
    specification = Specification(fixed, unknowns, choices, tuple(targets), **effort)
    if specification.points & (specification.points - 1):
        raise ParameterError(f"points = {specification.points} is no power of two")
    if len(specification.combinations) > _MOST_COMBINATIONS:
        raise ParameterError(f"unknowns: have more than {_MOST_COMBINATIONS} combinations")
    missing = _missing_models(specification)
    for number, target in enumerate(targets):
        if missing[number] and target.sampling is None:
            raise ParameterError(
                f"targets[{number}].figure: {target.measure.figure} [{target.measure.unit}] needs "
                f"the parameter {missing[number]}"
            )
    # A recording may have more than the drill of the fit is asked to model.
    kept = tuple(t for t, parameter in zip(targets, missing, strict=True) if not parameter)
    if all(target.hold_out for target in kept):
        raise ParameterError("targets: holds no target that the fit may use")
    return dataclasses.replace(specification, targets=kept)


def _unknowns(
    content: Any, fixed: Mapping[str, Any]
) -> tuple[dict[str, Range], dict[str, tuple[Any, ...]]]:
    ranges: dict[str, Range] = {}
    choices: dict[str, tuple[Any, ...]] = {}
    for name, item in _mapping("unknowns", content).items():
        entry = f"unknowns.{name}"
        _known("unknowns.", [name], _NAMES, "a parameter")
        if name in fixed:
            raise ParameterError(f"{entry}: is among the parameters as well")
        allowed = PARAMETERS[name].allowed
        if isinstance(item, Mapping) and "values" in item:
            _known(f"{entry}.", item, ["values"], "an entry beside values")
            choices[name] = _choices(entry, name, item["values"])
        elif isinstance(allowed, Quantity):
            ranges[name] = _range(entry, name, item)
        elif isinstance(allowed, Choice | Flag):
            choices[name] = _choices(entry, name, item)
        else:
            raise ParameterError(f"{entry}: is a text, which cannot be fitted")
    if not ranges:
        raise ParameterError("unknowns: holds no parameter with bounds")
    return ranges, choices


def _range(entry: str, name: str, content: Any) -> Range:
    scale = "linear"
    if isinstance(content, Mapping):
        _known(f"{entry}.", content, ["low", "high", "scale"], "an entry")
        scale = content.get("scale", "linear")
        if scale not in SCALES:
            raise ParameterError(f"{entry}.scale = {shown(scale)} is not one of linear, log")
        content = [content.get("low"), content.get("high")]
    if not (isinstance(content, list) and len(content) == 2):
        raise ParameterError(f"{entry}: {shown(content)} is not of the form [low, high]")
    allowed = PARAMETERS[name].allowed
    low, high = (float(allowed.check(f"{entry}: {name}", value)) for value in content)
    if not low < high:
        raise ParameterError(f"{entry}: low {low:g} is not below high {high:g}")
    if scale == "log" and not low > 0.0:
        raise ParameterError(f"{entry}: low {low:g} has no logarithm; it must be above 0")
    return Range(low, high, scale)


def _choices(entry: str, name: str, content: Any) -> tuple[Any, ...]:
    values = tuple(
        PARAMETERS[name].allowed.check(f"{entry}: {name}", v) for v in _list(entry, content)
    )
    if not values:
        raise ParameterError(f"{entry}: holds no value")
    if len(set(values)) < len(values):
        raise ParameterError(f"{entry}: holds a value twice")
    return values


def _target(entry: str, content: Any, fixed: Mapping[str, Any]) -> Target:
    entries = _mapping(entry, content)
    _known(f"{entry}.", entries, _TARGET, "an entry of a target")
    for name in ("figure", "value", "tolerance"):
        if name not in entries:
            raise ParameterError(f"{entry}.{name}: is missing")
    measure = _measure(entry, entries)
    least = -_GREATEST if measure.figure in SIGNED else 0.0
    allowed = Quantity(measure.unit, "", least, _GREATEST)
    value = float(allowed.check(f"{entry}.value", entries["value"]))
    own = _own_parameters(entry, entries, fixed)
    return Target(
        measure,
        value,
        _tolerance(f"{entry}.tolerance", entries["tolerance"], value, measure.unit),
        Quantity("", "", 1, 1e9, whole=True).check(f"{entry}.runs", entries.get("runs", 1)),
        tuple(own.items()),
        Flag("").check(f"{entry}.hold_out", entries.get("hold_out", False)),
        Text("", "").check(f"{entry}.source", entries.get("source", "")),
    )


def _measure(entry: str, entries: Mapping[str, Any]) -> Measure:
    figure = entries["figure"]
    _known(f"{entry}.figure: ", [figure], UNITS, "a figure")
    if figure in CONTACT_FIGURES:
        return Measure(figure, 0.0, 0.0)
    start, end = _window(f"{entry}.window", entries.get("window", 5.0))
    return Measure(figure, start, end, _quantile(f"{entry}.statistic", figure, entries))


def _quantile(entry: str, figure: str, entries: Mapping[str, Any]) -> float | None:
    """Return the quantile of ``statistic``; None for the mean."""
    if "statistic" not in entries:
        return None
    if figure not in IMPACT_VALUES:
        raise ParameterError(
            f"{entry}: {figure} has none; those of {', '.join(IMPACT_VALUES)} have"
        )
    content = entries["statistic"]
    if content == "mean":
        return None
    word, _, share = str(content).partition(" ")
    try:
        if word == "quantile":
            return float(Quantity("", "", 0, 1).check(f"{entry}: quantile", float(share)))
    except ValueError as error:
        if isinstance(error, ParameterError):
            raise
    raise ParameterError(f"{entry} = {shown(content)} is neither mean nor quantile Q")


def _window(entry: str, content: Any) -> tuple[float, float]:
    if not isinstance(content, list):
        content = [0.0, content]
    if len(content) != 2:
        raise ParameterError(f"{entry}: {shown(content)} is neither seconds nor [from, to]")
    allowed = Quantity("s", "", 0.0, _LONGEST)
    start, end = (allowed.check(entry, value) for value in content)
    if not start < end:
        raise ParameterError(f"{entry}: begins at {start:g} s and ends at {end:g} s")
    return start, end


def _tolerance(entry: str, content: Any, value: float, unit: str) -> float:
    if isinstance(content, str) and content.strip().endswith("%"):
        try:
            share: Any = float(content.strip()[:-1])
        except ValueError:
            share = content
        percent = Quantity("%", "", 0.0, 1e3, exclusive=True)
        tolerance = 0.01 * percent.check(entry, share) * abs(value)
    else:
        tolerance = Quantity(unit, "", 0.0, _GREATEST, exclusive=True).check(entry, content)
    if not tolerance > 0.0:
        raise ParameterError(f"{entry}: {shown(content)} of {value:g} is no tolerance above 0")
    return float(tolerance)


def _own_parameters(
    entry: str, entries: Mapping[str, Any], fixed: Mapping[str, Any]
) -> dict[str, Any]:
    own = dict(_mapping(f"{entry}.parameters", entries.get("parameters", {})))
    _check_parameters(entry, {**fixed, **own})
    return own


def _missing_models(specification: Specification) -> list[str]:
    """Return the parameter that each target needs and a drill of the fit lacks, or nothing.

    Every condition of the targets is checked at the corners that bounds and choices have.
    """
    found = [""] * len(specification.targets)
    for combination in specification.combinations:
        for end in ("minimum", "maximum"):
            values = {name: getattr(item, end) for name, item in specification.unknowns.items()}
            for condition in specification.conditions:
                drill = specification.configuration({**values, **combination}, condition)
                for number, target in enumerate(specification.targets):
                    if target.parameters == condition:
                        found[number] = found[number] or missing_model(drill, target.measure.figure)
    return found


def _check_parameters(entry: str, values: Mapping[str, Any]) -> None:
    _known(f"{entry}.", values, _NAMES, "a parameter")
    try:
        to_configuration(values)
    except ParameterError as error:
        raise ParameterError(f"{entry}: {error}") from None


def _mapping(entry: str, content: Any) -> Mapping[Any, Any]:
    if not isinstance(content, Mapping):
        raise ParameterError(f"{entry}: {'is missing' if content is None else 'holds no mapping'}")
    return content


def _list(entry: str, content: Any) -> list[Any]:
    if not isinstance(content, list):
        raise ParameterError(f"{entry}: holds no list")
    return content


def _known(prefix: str, names: Iterable[Any], known: Iterable[str], kind: str) -> None:
    for name in names:
        if not isinstance(name, str) or name not in known:
            raise ParameterError(
                f"{prefix}{shown_name(name)} is not {kind}; {did_you_mean(name, known)}"
            )
