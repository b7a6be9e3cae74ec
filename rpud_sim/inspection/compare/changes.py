"""What differs in how runs were made, and the parts of the time between common changes."""

from __future__ import annotations

import difflib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.compare.values import RecordedValues
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.simulation import PARAMETERS
from rpud_sim.simulation.journal import JournalEntry

_MOST_TEXT = 300  # characters of a command
_SHORTEST = 0.1  # s; shorter parts hold nothing to compare
_TOGETHER = 1e-3  # s; changes so close are one
MOST_WINDOWS = 20  # number of segments that are compared


@dataclass(frozen=True)
class Setting:
    """Parameter or version that differs between runs."""

    name: str  # of it
    unit: str  # of a parameter
    values: tuple[str, ...]  # of each run, as text; empty where a run has none


@dataclass(frozen=True)
class AlignedEvent:
    """Command or fault, aligned over the runs."""

    text: str  # what it is
    times: tuple[float | None, ...]  # in each run [s]; None where a run has no such event
    # of a fault in each run [s]; None for a command, or while it lasts
    ends: tuple[float | None, ...]

    @property
    def common(self) -> bool:
        return all(time is not None for time in self.times)


def parameter_settings(drills: Sequence[RecordedDrill]) -> tuple[Setting, ...]:
    """Return the parameters at the beginning that differ, with the seed and the initial phase."""
    seeds = [{} if drill.seed is None else {"seed": drill.seed} for drill in drills]
    tables = [{**d.parameters, **seed} for d, seed in zip(drills, seeds, strict=True)]
    return tuple(Setting(name, _unit(name), values) for name, values in _differing(tables))


def version_settings(drills: Sequence[RecordedDrill]) -> tuple[Setting, ...]:
    found = _differing([drill.versions for drill in drills])
    return tuple(Setting(name, "", values) for name, values in found)


def _differing(tables: Sequence[Mapping[str, Any]]) -> list[tuple[str, tuple[str, ...]]]:
    names = sorted({str(name) for table in tables for name in table})
    rows = []
    for name in names:
        values = tuple(to_text(table[name]) if name in table else "" for table in tables)
        if len(set(values)) > 1:
            rows.append((name[:80], values))
    return rows


def _unit(name: str) -> str:
    if name == "initial_phase":
        return "cycles"
    declaration = PARAMETERS.get(name)
    return getattr(declaration.allowed, "unit", "") if declaration else ""


def to_text(value: Any) -> str:
    """Return a value as text, numbers in full precision."""
    if isinstance(value, float):
        return f"{value:.12g}" if float(f"{value:.12g}") == value else repr(value)
    return f"{value!s:.200}"


def commands(drills: Sequence[RecordedDrill]) -> tuple[AlignedEvent, ...]:
    return _aligned(
        [
            [(text, entry.time / SECOND, None) for entry, text in _command_texts(drill)]
            for drill in drills
        ]
    )


def _command_texts(drill: RecordedDrill) -> list[tuple[JournalEntry, str]]:
    found = []
    parameters: Mapping[str, Any] = drill.parameters
    for entry in drill.commands:
        content = dict(entry.content)
        if entry.kind == "configure" and isinstance(content.get("parameters"), dict):
            after = content["parameters"]
            content = {k: v for k, v in after.items() if parameters.get(k) != v}
            parameters = {**parameters, **after}
        found.append((entry, _command_text(entry.kind, content)))
    return found


def _command_text(kind: str, content: Mapping[str, Any]) -> str:
    parts = []
    for name, value in content.items():
        if isinstance(value, dict):
            inner = [f"{k} {to_text(v)}" for k, v in value.items() if v not in (None, "")]
            parts.append(" ".join(inner))
        elif value is not None:
            shown = to_text(value) if not isinstance(value, list) else json.dumps(value)
            parts.append(f"{name} {shown}")
    text = f"{kind}: {', '.join(parts)}" if parts else kind
    return text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}…"


def faults(values: Sequence[RecordedValues]) -> tuple[AlignedEvent, ...]:
    lists = []
    for run in values:
        found = sorted((run.faults or {}).values(), key=lambda fault: (fault.onset, fault.number))
        lists.append([(fault.text, fault.onset, fault.clear) for fault in found])
    return _aligned(lists)


def _aligned(runs: Sequence[list[tuple[str, float, float | None]]]) -> tuple[AlignedEvent, ...]:
    """Return the events of all runs, each with its text, time and end in each."""
    rows: list[tuple[str, list[tuple[float | None, float | None]]]] = []
    for number, events in enumerate(runs):
        texts = [text for text, _, _ in events]
        matcher = difflib.SequenceMatcher(None, [text for text, _ in rows], texts, autojunk=False)
        merged = []
        for kind, low, high, first, last in matcher.get_opcodes():
            if kind == "equal":
                for (text, cells), event in zip(rows[low:high], events[first:last], strict=True):
                    merged.append((text, [*cells, event[1:]]))
                continue
            merged += [(text, [*cells, (None, None)]) for text, cells in rows[low:high]]
            lacking = [(None, None)] * number
            merged += [(text, [*lacking, (time, end)]) for text, time, end in events[first:last]]
        rows = merged
    return tuple(AlignedEvent(text, *zip(*cells, strict=True)) for text, cells in rows)


@dataclass(frozen=True)
class ComparedWindow:
    """Part of the time that is compared."""

    name: str
    begins: tuple[float, ...]  # begins, ends: in each run, simulation time [s]
    ends: tuple[float, ...]

    @property
    def spans(self) -> str:
        """Begins and ends as people read them; those of several runs if they differ."""
        spans = dict.fromkeys(zip(self.begins, self.ends, strict=True))
        return ", ".join(f"{begin:.6g} to {end:.6g} s" for begin, end in spans)


def windows(
    runs: Sequence[RecordedValues],
    commands: Sequence[AlignedEvent],
    faults: Sequence[AlignedEvent],
    begin: float,
    end: float | None,
    settle: float,
) -> tuple[tuple[ComparedWindow, ...], list[str]]:
    """Return the windows from one simulation time to another [s], and warnings in one line each.

    ``settle`` is the time that is left out after the start and after each change [s].
    Where all runs have the same commands, each part between them is compared for itself, and so
    with faults. Otherwise the common time is one window.
    """
    warnings = []
    changes: list[tuple[str, tuple[float, ...]]] = []
    if all(event.common for event in commands):
        changes += [(event.text, _times(event)) for event in commands]
    else:
        warnings.append(
            "the commands differ: a difference may come from them, so causes are mixed; "
            "--from and --to choose a time in which they agree"
        )
    if all(event.common for event in faults):
        changes += [(f"fault {event.text}", _times(event)) for event in faults]
        changes += [
            (f"end of fault {event.text}", tuple(end or 0.0 for end in event.ends))
            for event in faults
            if all(end is not None for end in event.ends)
        ]
    else:
        warnings.append("the faults differ: a difference may come from them, so causes are mixed")
    changes.sort(key=lambda change: change[1])
    if any(
        later < earlier
        for (_, before), (_, after) in pairwise(changes)
        for earlier, later in zip(before, after, strict=True)
    ):
        warnings.append("commands and faults come in another order in each run: causes are mixed")
        changes = []
    last = min([math.inf if end is None else end, *(run.end for run in runs)])
    return _between(runs, changes, begin, last, settle, warnings), warnings


def _times(event: AlignedEvent) -> tuple[float, ...]:
    return tuple(time or 0.0 for time in event.times)


def _between(
    runs: Sequence[RecordedValues],
    changes: Sequence[tuple[str, tuple[float, ...]]],
    begin: float,
    last: float,
    settle: float,
    warnings: list[str],
) -> tuple[ComparedWindow, ...]:
    first = max([begin, *(run.begin for run in runs)])
    inside = [
        (text, tuple(min(max(time, first), last) for time in times))
        for text, times in changes
        if not _before(times, first + _TOGETHER) and min(times) < last
    ]
    # A change before the first moment, or at it, only has to settle.
    early = [times for _, times in changes if _before(times, first + _TOGETHER)]
    names = [""]
    places = [tuple(first for _ in runs)]
    settled = [
        tuple(
            max([first, settle, *(times[run] + settle for times in early)])
            for run in range(len(runs))
        )
    ]
    for text, times in inside:
        close = max(b - a for a, b in zip(places[-1], times, strict=True)) < _TOGETHER
        if close:
            names[-1] = f"{names[-1]}; {text}" if names[-1] else text
        else:
            names.append(text)
            places.append(times)
            settled.append(tuple(time + settle for time in times))
    ends = [*places[1:], tuple(last for _ in runs)]
    found = []
    short = 0
    for name, *bounds in zip(names, settled, ends, strict=True):
        if min(b - a for a, b in zip(*bounds, strict=True)) < _SHORTEST:
            short += 1
            continue
        title = f"after {name}" if name else "from the start" if len(names) > 1 else "whole time"
        found.append(ComparedWindow(title, *bounds))
    if short and found:
        warnings.append(f"{short} segments between changes are too short to compare")
    if len(found) > MOST_WINDOWS:
        warnings.append(f"only the first {MOST_WINDOWS} of {len(found)} segments are compared")
    return tuple(found[:MOST_WINDOWS])


def _before(times: Sequence[float], moment: float) -> bool:
    return all(time <= moment for time in times)
