"""Frames of a live page: what has changed since the one before, as plain values."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.foundation.terminal import printable
from rpud_sim.inspection.report.power_flow import FEED_POWERS, INFLOWS, OUTFLOWS, flows
from rpud_sim.pages.flow import flow_picture
from rpud_sim.watch.picture import Impact, Picture, Section, Series

_CHANGING = 40  # rows at the end of a series that may still change
_OUTCOMES = 8


class Frames:
    """Maker of the frames of one browser tab."""

    def __init__(self, namespace: str) -> None:
        self.dropped = 0  # frames that were due while the browser was busy with another one
        self._namespace = namespace
        self._number = 0
        self._version = -1
        self._run = -1
        self._sent = [0, 0]  # rows of the series that the browser has
        self._status: Mapping[str, Any] | None = None
        self._section_wanted = True
        self._section_time: float | None = None
        self._refusal = (0, "")
        self._refusal_sent = 0

    def want_section(self) -> None:
        """Send the next block of the waveform with the next frame."""
        self._section_wanted = True

    def refuse(self, reason: str) -> None:
        """Show why an action was not even asked of the drill."""
        self._refusal = self._refusal[0] + 1, printable(reason)

    def drop(self, picture: Picture) -> None:
        """Count a frame that is due and cannot be sent."""
        if self._number and picture.version != self._version:
            self.dropped += 1

    def next(self, picture: Picture) -> dict[str, Any] | None:
        """Return the next frame; None if nothing has changed."""
        section = self._section_of(picture)
        same = (picture.version, self._refusal[0]) == (self._version, self._refusal_sent)
        if same and section is None:
            return None
        began = picture.run != self._run
        if began:
            self._sent = [0, 0]
        self._number += 1
        self._version, self._run = picture.version, picture.run
        self._refusal_sent = self._refusal[0]
        frame: dict[str, Any] = {
            "number": self._number,
            "dropped": self.dropped,
            "began": began,
            "run": picture.run,
            "time": picture.time,
            "connection": {
                "state": picture.connection.state,
                "since": picture.connection.since,
                "reason": printable(picture.connection.reason),
            },
            "values": _values(picture),
            "impact": _impact(picture.impact),
            "faults": [_fault(fault) for fault in picture.faults],
            "kinds": [printable(kind) for kind in picture.kinds],
            "channels": [printable(channel) for channel in picture.channels],
            "marks": [
                {"time": mark.time, "kind": mark.kind, "text": printable(mark.text)}
                for mark in picture.marks
                if math.isfinite(mark.time)
            ],
            "lost": {printable(topic): count for topic, count in picture.lost.items()},
            "refusals": [picture.refusals[0], printable(picture.refusals[1])],
            "outcomes": [_outcome(each) for each in picture.outcomes[-_OUTCOMES:]],
            "refusal": list(self._refusal),
            "series": self._rows(0, picture.series),
            "statuses": self._rows(1, picture.statuses),
        }
        if section is not None:
            frame["section"] = section
        if picture.status and picture.status != self._status:
            frame["status"] = _texts(picture.status)
            frame["flow"] = _flow(picture.status)
            self._status = picture.status
        return frame

    def _section_of(self, picture: Picture) -> dict[str, Any] | None:
        section = picture.section
        if section is None or not self._section_wanted or section.time == self._section_time:
            return None
        self._section_wanted = False
        self._section_time = section.time
        return _section(section, picture.impacts)

    def _rows(self, place: int, series: Series) -> dict[str, Any]:
        end = series.first + len(series.rows)
        first = max(series.first, min(self._sent[place] - _CHANGING, end))
        self._sent[place] = end
        return {
            "kept": series.first,
            "first": first,
            "columns": len(series.columns),
            "rows": _packed(series.rows[first - series.first :], "<f8"),
        }


def _packed(values: np.ndarray, kind: str = "<f4") -> str:
    return base64.b64encode(np.ascontiguousarray(values, kind).tobytes()).decode()


def _texts(fields: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: printable(value) if isinstance(value, str) else value
        for name, value in fields.items()
    }


def _values(picture: Picture) -> dict[str, Any]:
    return {topic: _texts(values) for topic, values in picture.latest.items()}


def _impact(impact: Impact | None) -> dict[str, Any] | None:
    if impact is None:
        return None
    return {
        "time": impact.time,
        "sequence": impact.sequence,
        "peak_force": impact.peak_force,
        "contact_duration": impact.contact_duration,
        "impact_velocity": impact.impact_velocity,
        "energy": impact.energy,
    }


def _fault(fault: Any) -> dict[str, Any]:
    return {
        "number": fault.number,
        "kind": printable(fault.kind),
        "channel": printable(fault.channel),
        "magnitude": fault.magnitude,
        "active": fault.active,
        "onset": fault.onset,
        "end": fault.end,
    }


def _outcome(outcome: Any) -> dict[str, Any]:
    arguments = ", ".join(
        f"{name} {value}" for name, value in outcome.arguments.items() if value != ""
    )
    return {
        "number": outcome.number,
        "name": outcome.name,
        "arguments": printable(arguments)[:200],
        "state": outcome.state,
        "text": printable(outcome.text),
    }


def _section(section: Section, impacts: tuple[Impact, ...]) -> dict[str, Any]:
    end = section.time + section.period * len(section.nodal_plane)
    within = [each for each in impacts if section.time <= each.time < end]
    # Relative to the first sample: single precision then resolves a nanosecond.
    return {
        "time": section.time,
        "period": section.period,
        "nodal_plane": _packed(section.nodal_plane),
        "actuator": _packed(section.actuator - section.nodal_plane),
        "free_mass": _packed(section.free_mass),
        "drill_tool": _packed(section.drill_tool),
        "impacts": [[each.time - section.time, each.peak_force] for each in within],
    }


def _flow(status: Mapping[str, Any]) -> str:
    """Return the picture of the powers; empty while nothing flows."""
    names = (*INFLOWS, *OUTFLOWS, *FEED_POWERS)
    into, out = flows({name: float(status.get(name, math.nan)) for name in names})
    if not into and not out:
        return ""
    said = ", ".join(f"{name} {value:.3g} W" for name, value in {**into, **out}.items())
    return str(flow_picture(into, out, "W", f"Mean powers of the last second: {said}."))
