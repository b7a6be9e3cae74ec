"""What differs in how two runs were made, and the parts of the time between common changes."""

from __future__ import annotations

import difflib
import math
from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any, NamedTuple

from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.compare.values import RecordedValues
from rpud_sim.recorded.runs import RecordedRun
from rpud_sim.simulation import PARAMETERS
from rpud_sim.simulation.versions import engine_of

_MOST_TEXT = 300  # characters of a command
_SHORTEST = 0.1  # s; shorter parts hold nothing to compare
_TOGETHER = 1e-3  # s; changes so close are one
MOST_WINDOWS = 20  # number of segments that are compared

_Times = tuple[float, ...]  # simulation time in each run [s]


class Setting(NamedTuple):
    """Parameter or version that differs between runs."""

    name: str  # of it
    unit: str  # of a parameter
    values: tuple[str, ...]  # of each run, as text; empty where a run has none


class AlignedEvent(NamedTuple):
    """Command or fault, aligned over both runs."""

    text: str  # what it is
    times: tuple[float | None, ...]  # in each run [s]; None where a run has no such event
    # of a fault in each run [s]; None for a command, or while it lasts
    ends: tuple[float | None, ...]


class ComparedWindow(NamedTuple):
    """Part of the time that is compared."""

    name: str
    begins: _Times
    ends: _Times

    @property
    def spans(self) -> str:
        """Begins and ends as people read them; those of several runs if they differ."""
        spans = dict.fromkeys(zip(self.begins, self.ends, strict=True))
        return ", ".join(f"{begin:.6g} to {end:.6g} s" for begin, end in spans)


def parameter_settings(drills: Sequence[RecordedRun]) -> tuple[Setting, ...]:
    """Return the parameters at the beginning that differ, with the seed and the initial phase."""
    seeds = [{} if drill.seed is None else {"seed": drill.seed} for drill in drills]
    return _differing([_in_celsius(d) | seed for d, seed in zip(drills, seeds, strict=True)])


def _in_celsius(drill: RecordedRun) -> dict[str, Any]:
    """Return the parameters of a run; a journal of an engine before 6 has kelvin."""
    found, ambient = dict(drill.parameters), drill.parameters.get("ambient_temperature")
    if drill.entries and isinstance(ambient, float) and engine_of(drill.beginning) in range(6):
        found["ambient_temperature"] = round(ambient - 273.15, 9)
    return found


def version_settings(drills: Sequence[RecordedRun]) -> tuple[Setting, ...]:
    return _differing([drill.versions for drill in drills])


def _differing(tables: Sequence[Mapping[str, Any]]) -> tuple[Setting, ...]:
    found = []
    for name in sorted({str(name) for table in tables for name in table}):
        values = tuple(to_text(table[name]) if name in table else "" for table in tables)
        if len(set(values)) > 1:
            declared = PARAMETERS.get(name)
            unit = getattr(declared.allowed, "unit", "") if declared else ""
            found.append(Setting(name[:80], "cycles" if name == "initial_phase" else unit, values))
    return tuple(found)


def to_text(value: Any) -> str:
    """Return a value as text, numbers in full precision."""
    if isinstance(value, float):
        return f"{value:.12g}" if float(f"{value:.12g}") == value else repr(value)
    return f"{value!s:.200}"


def commands(drills: Sequence[RecordedRun]) -> tuple[AlignedEvent, ...]:
    return _aligned([_commands(drill) for drill in drills])


def _commands(drill: RecordedRun) -> list[tuple[str, float, None]]:
    found = []
    parameters: Mapping[str, Any] = drill.parameters
    for entry in drill.commands:
        content = dict(entry.content)
        if entry.kind == "configure" and isinstance(content.get("parameters"), dict):
            after = content["parameters"]
            content = {k: v for k, v in after.items() if parameters.get(k) != v}
            parameters = {**parameters, **after}
        flat: dict[str, Any] = {}
        for name, value in content.items():
            flat |= value if isinstance(value, dict) else {name: value}
        words = [f"{k} {to_text(v)}" for k, v in flat.items() if v not in (None, "")]
        text = f"{entry.kind}: {', '.join(words)}" if words else entry.kind
        text = text if len(text) <= _MOST_TEXT else f"{text[:_MOST_TEXT]}…"
        found.append((text, entry.time / SECOND, None))
    return found


def faults(runs: Sequence[RecordedValues]) -> tuple[AlignedEvent, ...]:
    return _aligned([[(f.text, f.onset, f.clear) for f in sorted(r.faults.values())] for r in runs])


def _aligned(runs: Sequence[Sequence[tuple[str, float, float | None]]]) -> tuple[AlignedEvent, ...]:
    """Return the events of both runs, each with its text, time and end in each."""
    first, second = runs
    texts = [[text for text, *_ in events] for events in runs]
    matcher = difflib.SequenceMatcher(None, texts[0], texts[1], autojunk=False)
    found = []
    for kind, low, high, begin, end in matcher.get_opcodes():
        old, new = first[low:high], second[begin:end]
        if kind == "equal":
            pairs = zip(old, new, strict=True)
            found += [AlignedEvent(a[0], (a[1], b[1]), (a[2], b[2])) for a, b in pairs]
        else:
            found += [AlignedEvent(text, (time, None), (end, None)) for text, time, end in old]
            found += [AlignedEvent(text, (None, time), (None, end)) for text, time, end in new]
    return tuple(found)


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
    changes: list[tuple[str, _Times]] = []
    for what, before, events in (("commands", "", commands), ("faults", "fault ", faults)):
        if any(None in event.times for event in events):
            warnings.append(
                f"the {what} differ: a difference may come from them, so causes are mixed; "
                "--from and --to choose a time in which they agree"
            )
            continue
        for event in events:
            changes.append((f"{before}{event.text}", tuple(time or 0.0 for time in event.times)))
            if None not in event.ends:
                ends = tuple(time or 0.0 for time in event.ends)
                changes.append((f"end of {before}{event.text}", ends))
    changes.sort(key=lambda change: change[1])
    if any(b < a for (_, x), (_, y) in pairwise(changes) for a, b in zip(x, y, strict=True)):
        warnings.append("commands and faults come in another order in each run: causes are mixed")
        changes = []
    first = max([begin, *(run.begin for run in runs)])
    last = min([math.inf if end is None else end, *(run.end for run in runs)])
    found = _between([(first,) * len(runs), (last,) * len(runs)], changes, settle)
    kept = [window for window in found if window]
    if kept and len(kept) < len(found):
        warnings.append(
            f"{len(found) - len(kept)} segments between changes are too short to compare"
        )
    if len(kept) > MOST_WINDOWS:
        warnings.append(f"only the first {MOST_WINDOWS} of {len(kept)} segments are compared")
    return tuple(kept[:MOST_WINDOWS]), warnings


def _between(
    whole: Sequence[_Times], changes: Sequence[tuple[str, _Times]], settle: float
) -> list[ComparedWindow | None]:
    """Return the parts of a time between changes, once they have settled; None for too short ones.

    ``whole`` are its begin and its end, in each run.
    """
    first, last = whole
    names: list[list[str]] = [[]]
    places = [first]
    settled = [[max(time, settle) for time in first]]
    for text, times in changes:
        if min(times) >= last[0]:
            continue
        place = tuple(min(max(t, first[0]), last[0]) for t in times)
        if max(b - a for a, b in zip(places[-1], place, strict=True)) >= _TOGETHER:
            names.append([])
            places.append(place)
            settled.append([*place])
        elif max(times) <= first[0] + _TOGETHER:
            text = ""  # a change before the first moment, or at it, only has to settle
        names[-1] += [text] if text else []
        settled[-1] = [max(a, t + settle) for a, t in zip(settled[-1], times, strict=True)]
    found: list[ComparedWindow | None] = []
    for name, begins, ends in zip(names, settled, [*places[1:], last], strict=True):
        title = f"after {'; '.join(name)}" if name else "from the start"
        title = title if len(names) > 1 or name else "whole time"
        long = min(b - a for a, b in zip(begins, ends, strict=True)) >= _SHORTEST
        found.append(ComparedWindow(title, tuple(begins), ends) if long else None)
    return found
