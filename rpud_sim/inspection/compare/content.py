"""Comparison as dictionaries, lists, numbers and texts, for JSON; unknown numbers are None."""

from __future__ import annotations

import math
from typing import Any

from rpud_sim.inspection.compare.changes import Event, Setting
from rpud_sim.inspection.compare.estimates import Difference, Estimate
from rpud_sim.inspection.compare.results import (
    Comparison,
    QuantityComparison,
    RunFigures,
    WindowComparison,
)
from rpud_sim.inspection.compare.same_bits import TopicBits


def content(found: Comparison) -> dict[str, Any]:
    """Return a comparison for JSON; ``docs/reference/compare.md`` lists its fields."""
    return {
        "equal_bits": found.equal_bits,
        "differs": found.differs,
        "undecided": found.undecided,
        "tolerance": found.tolerance or None,
        "runs": [
            {
                "name": name,
                "bag": drill.path,
                "namespace": drill.namespace or "/",
                "run": drill.number,
                "runs_in_bag": drill.runs,
                "journal": bool(drill.entries),
                "begin": number(values.begin),
                "end": number(values.end),
                "impacts_missing": values.missing_impacts,
                "timing": {
                    "greatest": {key: number(v) for key, v in timing.greatest.items()},
                    "median": {key: number(v) for key, v in timing.median.items()},
                    **timing.counters,
                },
            }
            for name, drill, values, timing in zip(
                found.names, found.drills, found.values, found.timing, strict=True
            )
        ],
        "parameters": [_setting(each) for each in found.parameters],
        "versions": [_setting(each) for each in found.versions],
        "commands": [_event(each) for each in found.commands],
        "faults": [_event(each) for each in found.faults],
        "bits": [[_bits(topic) for topic in run] for run in found.bits],
        "windows": [_window(each) for each in found.windows],
        "warnings": list(found.warnings),
        "damaged": found.damaged,
    }


def number(value: float | None) -> float | None:
    """Return a number, or None where it is not finite: JSON has no NaN."""
    return value if value is not None and math.isfinite(value) else None


def _setting(each: Setting) -> dict[str, Any]:
    return {"name": each.name, "unit": each.unit, "values": list(each.values)}


def _event(each: Event) -> dict[str, Any]:
    return {
        "text": each.text,
        "times": [number(time) for time in each.times],
        "ends": [number(time) for time in each.ends],
    }


def _bits(each: TopicBits) -> dict[str, Any]:
    return {
        "topic": each.topic,
        "state": each.state,
        "messages": each.messages,
        "time": number(each.time),
        "field": each.field,
        "reference": each.reference,
        "other": each.other,
        "note": each.note,
    }


def _window(each: WindowComparison) -> dict[str, Any]:
    return {
        "name": each.window.name,
        "begins": list(each.window.begins),
        "ends": list(each.window.ends),
        "quantities": [_quantity(quantity) for quantity in each.quantities],
    }


def _quantity(each: QuantityComparison) -> dict[str, Any]:
    return {
        "quantity": each.quantity,
        "unit": each.unit,
        "runs": [_figures(run) if run else None for run in each.runs],
        "differences": [[_difference(found) for found in run] for run in each.differences],
    }


def _figures(run: RunFigures) -> dict[str, Any]:
    figures: dict[str, Any] = {name: _estimate(each) for name, each in run.estimates.items()}
    return {"count": run.count, "max": number(run.greatest), **figures}


def _estimate(each: Estimate) -> dict[str, Any]:
    return {
        "value": number(each.value),
        "low": number(each.low),
        "high": number(each.high),
        "error": number(each.error),
        "blocks": number(each.blocks),
    }


def _difference(each: Difference) -> dict[str, Any]:
    return {
        "figure": each.figure,
        "difference": number(each.value),
        "low": number(each.low),
        "high": number(each.high),
        "relative": number(each.relative),
        "relative_low": number(each.relative_low),
        "relative_high": number(each.relative_high),
        "p": number(each.chance),
        "decision": each.decision,
    }
