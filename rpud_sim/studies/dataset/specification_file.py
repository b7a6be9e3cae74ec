"""Files of specifications of data sets: from YAML to a checked specification."""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from rpud_sim.foundation.quantities import (
    ParameterError,
    Quantity,
    did_you_mean,
    shown,
    shown_name,
)
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import read_yaml
from rpud_sim.simulation.changes import Planned, check_commands, parse_commands
from rpud_sim.simulation.conditions import check_honoured
from rpud_sim.simulation.configuration import NODE_NAMES, PARAMETERS
from rpud_sim.simulation.faults import KINDS, Fault, FaultError
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.studies.dataset.specification import (
    DEFAULT_TOPICS,
    DURATION,
    FEED_RATE,
    HEALTHY_RUNS,
    LENGTH,
    MOST_RUNS,
    NOT_IN_TABLES,
    SEED,
    SEEDS,
    SPLITS,
    STRIDE,
    TIME,
    DatasetError,
    FaultSeries,
    Interval,
    Rock,
    Specification,
    Window,
    window_starts,
)

PHYSICAL = "physical"
"""Word for every physical fault that the drill can honour, with its default magnitude."""

_ENTRIES = tuple(f.name for f in dataclasses.fields(Specification) if f.name != "left_out")
_NAME = re.compile(r"[a-z][a-z0-9_]{0,39}")
# The plan of a run gives its scenario and its seed; the rate of telemetry may be another.
_NOT_FIXED = tuple(name for name in NODE_NAMES if name not in ("telemetry_rate", "sample_rate"))


def read_specification(path: str | Path) -> Specification:
    """Return the data set of a YAML file.

    Raises:
        DatasetError: if the file is not valid; the text names the file, the entry and the reason.
    """
    try:
        # Without truth values: off is a kind of fault.
        content = read_yaml(path, truth_values=False)
    except ParameterError as error:
        raise DatasetError(str(error)) from None
    try:
        return parse_specification(content)
    except (DatasetError, ParameterError) as error:
        raise DatasetError(f"{path}: {error}") from None


def parse_specification(content: Any) -> Specification:
    """Return the data set that plain values from YAML describe.

    Raises:
        DatasetError: if they are not valid; the text names the entry and the reason.
        ParameterError: if a value is outside its range.
    """
    entries = _mapping("the file", content)
    _check_names("", entries, _ENTRIES)
    for name in ("duration", "onset", "rocks", "faults"):
        if name not in entries:
            raise DatasetError(f"{name}: is missing")
    fixed = _parameters("fixed", entries.get("fixed", {}))
    varied = {
        name: _interval(f"varied.{name}", value, _quantity(name))
        for name, value in _parameters("varied", entries.get("varied", {}), fixed).items()
    }
    lasting = entries.get("lasting")
    topics = _topics("topics", entries.get("topics", list(DEFAULT_TOPICS)), _in_tables())
    draft = Specification(
        seed=SEED.check("seed", entries.get("seed", 0)),
        duration=DURATION.check("duration", entries["duration"]),
        settling=TIME.check("settling", entries.get("settling", 1.0)),
        onset=_interval("onset", entries["onset"], TIME),
        lasting=None if lasting is None else _interval("lasting", lasting, TIME),
        seeds=SEEDS.check("seeds", entries.get("seeds", 1)),
        healthy=HEALTHY_RUNS.check("healthy", entries.get("healthy", 1)),
        topics=topics,
        only_in_bags=_topics(
            "only_in_bags", entries.get("only_in_bags", []), [n for n in TOPICS if n not in topics]
        ),
        window=_window(entries.get("window", {})),
        fixed=fixed,
        varied=varied,
        rocks=_rocks(entries["rocks"], {*fixed, *varied}),
        faults=(),
        commands=_commands(entries.get("commands", [])),
    )
    _check_times(draft)
    _check_parameters(draft)
    specification = _with_faults(draft, entries["faults"])
    if not 1 <= specification.run_count <= MOST_RUNS:
        raise DatasetError(
            f"runs = {specification.run_count} is outside its range [1, {MOST_RUNS}]"
        )
    return specification


def _commands(content: Any) -> tuple[Planned, ...]:
    if not isinstance(content, list):
        raise DatasetError(f"commands: {shown(content)} is not a list")
    try:
        return parse_commands(content)
    except ParameterError as error:
        raise DatasetError(f"commands: {error}") from None


def _rocks(content: Any, taken: Iterable[str]) -> dict[str, Rock]:
    rocks: dict[str, Rock] = {}
    for name, entry in _mapping("rocks", content).items():
        place = f"rocks.{shown_name(name)}"
        if not (isinstance(name, str) and _NAME.fullmatch(name)):
            raise DatasetError(
                f"{place}: is not a name of a rock: lower-case letters, digits and underscores, "
                "at most 40"
            )
        values = dict(_mapping(place, entry))
        if "split" not in values:
            raise DatasetError(f"{place}.split: is missing")
        split = values.pop("split")
        if split not in SPLITS:
            raise DatasetError(f"{place}.split: {shown(split)} is not one of {', '.join(SPLITS)}")
        feed_rate = values.pop("feed_rate", None)
        if feed_rate is not None:
            feed_rate = FEED_RATE.check(f"{place}.feed_rate", feed_rate)
        parameters = _parameters(place, values, taken)
        for other, rock in rocks.items():
            # The same rock under two names would be in two splits.
            if rock.parameters == parameters:
                raise DatasetError(f"{place}: has the parameters of rocks.{other}")
        rocks[name] = Rock(split, parameters, feed_rate)
    for split in SPLITS:
        if split not in [rock.split for rock in rocks.values()]:
            raise DatasetError(f"rocks: the split {split} has no rock")
    return rocks


def _with_faults(draft: Specification, content: Any) -> Specification:
    if content == PHYSICAL:
        found = {kind: _refusal(draft, Fault(kind)) for kind in KINDS if KINDS[kind].physical}
        return dataclasses.replace(
            draft,
            faults=tuple(
                FaultSeries(kind, "", (Fault(kind).magnitude,))
                for kind, refusal in found.items()
                if not refusal
            ),
            left_out=tuple(kind for kind, refusal in found.items() if refusal),
        )
    if not isinstance(content, list):
        raise DatasetError(f"faults: {shown(content)} is neither a list nor the word {PHYSICAL}")
    series: list[FaultSeries] = []
    for number, entry in enumerate(content, 1):
        place = f"faults: entry {number}"
        try:
            one = _series(place, entry)
        except FaultError as error:
            raise DatasetError(f"{place}: {error}") from None
        for severity in range(1, len(one.magnitudes) + 1):
            if refusal := _refusal(draft, one.fault(severity)):
                raise DatasetError(f"{place}: {refusal}")
        if (one.kind, one.channel) in [(other.kind, other.channel) for other in series]:
            raise DatasetError(f"{place}: {one.fault(1)} stands there twice")
        series.append(one)
    return dataclasses.replace(draft, faults=tuple(series))


def _series(place: str, entry: Any) -> FaultSeries:
    values = _mapping(place, entry)
    _check_names(f"{place}: ", values, ("kind", "channel", "severities"))
    if "kind" not in values:
        raise DatasetError(f"{place}: kind is missing")
    kind, channel = values["kind"], values.get("channel", "")
    default = Fault(kind, channel)
    severities = values.get("severities", [default.magnitude])
    if not (isinstance(severities, list) and severities):
        raise DatasetError(f"{place}: severities = {shown(severities)} is not a list of magnitudes")
    magnitudes = tuple(Fault(kind, channel, magnitude).magnitude for magnitude in severities)
    if len(set(magnitudes)) < len(magnitudes):
        raise DatasetError(f"{place}: severities hold a magnitude twice")
    return FaultSeries(kind, channel, magnitudes)


def _refusal(draft: Specification, fault: Fault) -> str:
    """Return why a rock cannot have a fault; empty if all can."""
    try:
        for rock in draft.rocks:
            for values in draft.extremes():
                check_honoured(fault, draft.settings(rock, values).configuration)
    except FaultError as error:
        return f"rock {rock}: {error}"
    return ""


def _check_parameters(draft: Specification) -> None:
    for rock in draft.rocks:
        for values in draft.extremes():
            try:
                configuration = draft.settings(rock, values).configuration
                if (feed := draft.feed(rock)) is not None:
                    configuration.check_feed(feed)
                check_commands(draft.commands, configuration)
            except ParameterError as error:
                raise DatasetError(f"rocks.{rock}: {error}") from None


def _check_times(draft: Specification) -> None:
    """Check that each fault lies between the first window and the end of the run.

    The commands must lie within the run.
    """
    if draft.commands and not (last := draft.commands[-1].delay / SECOND) < draft.duration:
        raise DatasetError(
            f"commands: time = {last:g} s is not below duration = {draft.duration:g} s"
        )
    if draft.onset.minimum < draft.settling:
        raise DatasetError(
            f"onset.minimum = {draft.onset.minimum:g} s is before settling = {draft.settling:g} s"
        )
    end = draft.onset.maximum + (draft.lasting.maximum if draft.lasting else 0.0)
    if not end < draft.duration:
        names = "onset.maximum + lasting.maximum" if draft.lasting else "onset.maximum"
        raise DatasetError(f"{names} = {end:g} s is not below duration = {draft.duration:g} s")
    if draft.lasting and not draft.lasting.minimum >= 1e-9:
        raise DatasetError(
            f"lasting.minimum = {draft.lasting.minimum:g} s is outside its range [1e-09, 1e+05] s"
        )
    if not len(window_starts(draft)):
        raise DatasetError(
            f"window.length = {draft.window.length:g} s does not fit between settling = "
            f"{draft.settling:g} s and duration = {draft.duration:g} s"
        )


def _parameters(place: str, content: Any, taken: Iterable[str] = ()) -> dict[str, Any]:
    values = _mapping(place, content)
    _check_names(f"{place}.", values, [name for name in PARAMETERS if name not in _NOT_FIXED])
    for name in values:
        if name in taken:
            raise DatasetError(f"{place}.{name}: stands twice, once for all runs")
    return {name: _plain(name, value) for name, value in values.items()}


def _plain(name: str, value: Any) -> Any:
    """Return a truth value for its word: the file is read without truth values."""
    words = {"true": True, "false": False}
    is_flag = isinstance(PARAMETERS[name].default, bool)
    return words.get(value, value) if is_flag and isinstance(value, str) else value


def _quantity(name: str) -> Quantity:
    allowed = PARAMETERS[name].allowed
    if not isinstance(allowed, Quantity) or allowed.whole:
        raise DatasetError(f"varied.{name}: is not a number that can be drawn")
    return allowed


def _interval(place: str, content: Any, quantity: Quantity) -> Interval:
    values = _mapping(place, content)
    _check_names(f"{place}.", values, ("minimum", "maximum"))
    for key in ("minimum", "maximum"):
        if key not in values:
            raise DatasetError(f"{place}.{key}: is missing")
    least, most = (quantity.check(f"{place}.{key}", values[key]) for key in ("minimum", "maximum"))
    if not least <= most:
        raise DatasetError(f"{place}: minimum {least:g} is above maximum {most:g}")
    return Interval(least, most)


def _window(content: Any) -> Window:
    values = _mapping("window", content)
    _check_names("window.", values, ("length", "stride"))
    window = Window(**values)
    return Window(
        LENGTH.check("window.length", window.length), STRIDE.check("window.stride", window.stride)
    )


def _in_tables() -> list[str]:
    return [name for name in TOPICS if name not in NOT_IN_TABLES]


def _topics(place: str, content: Any, known: Iterable[str]) -> tuple[str, ...]:
    known = list(known)
    if not isinstance(content, list):
        raise DatasetError(f"{place}: {shown(content)} is not a list of topics")
    if place == "topics" and not content:
        raise DatasetError("topics: names no topic")
    for name in content:
        if name not in known:
            raise DatasetError(
                f"{place}: {shown(name)} cannot be here; {did_you_mean(name, known)}"
            )
    if len(set(content)) < len(content):
        raise DatasetError(f"{place}: names a topic twice")
    return tuple(name for name in TOPICS if name in content)


def _mapping(place: str, content: Any) -> Mapping[Any, Any]:
    if not isinstance(content, Mapping):
        raise DatasetError(f"{place}: holds no mapping")
    return content


def _check_names(prefix: str, content: Mapping[Any, Any], known: Iterable[str]) -> None:
    known = list(known)
    for name in content:
        if name not in known:
            raise DatasetError(
                f"{prefix}{shown_name(name)}: is unknown; {did_you_mean(name, known)}"
            )
