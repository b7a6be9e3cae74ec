"""What differs in how runs were made: parameters, versions, seed, commands and faults."""

from __future__ import annotations

import difflib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.compare.recorded_values import RecordedValues
from rpud_sim.inspection.recorded_drill import RecordedDrill
from rpud_sim.simulation import PARAMETERS
from rpud_sim.simulation.journal import JournalEntry

_MOST_TEXT = 300  # characters of a command


@dataclass(frozen=True)
class Setting:
    """Parameter or version that differs between runs."""

    name: str  # of it
    unit: str  # of a parameter
    values: tuple[str, ...]  # of each run, as text; empty where a run has none


@dataclass(frozen=True)
class Event:
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


def commands(drills: Sequence[RecordedDrill]) -> tuple[Event, ...]:
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


def faults(values: Sequence[RecordedValues]) -> tuple[Event, ...]:
    lists = []
    for run in values:
        found = sorted((run.faults or {}).values(), key=lambda fault: (fault.onset, fault.number))
        lists.append([(fault.text, fault.onset, fault.clear) for fault in found])
    return _aligned(lists)


def _aligned(runs: Sequence[list[tuple[str, float, float | None]]]) -> tuple[Event, ...]:
    rows: list[tuple[str, list[tuple[float, float | None] | None]]] = []
    for number, events in enumerate(runs):
        texts = [text for text, _, _ in events]
        matcher = difflib.SequenceMatcher(None, [text for text, _ in rows], texts, autojunk=False)
        merged: list[tuple[str, list[tuple[float, float | None] | None]]] = []
        for kind, low, high, first, last in matcher.get_opcodes():
            for text, cells in rows[low:high]:
                merged.append((text, [*cells, None]))
            if kind == "equal":
                for offset, (_, time, end) in enumerate(events[first:last]):
                    merged[len(merged) - (high - low) + offset][1][-1] = (time, end)
            else:
                for text, time, end in events[first:last]:
                    merged.append((text, [*[None] * number, (time, end)]))
        rows = merged
    return tuple(
        Event(
            text,
            tuple(cell[0] if cell else None for cell in cells),
            tuple(cell[1] if cell else None for cell in cells),
        )
        for text, cells in rows
    )
