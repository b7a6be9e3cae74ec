"""Commands of a drill in words, from its journal: those that change something."""

from __future__ import annotations

import json
import math
from collections import deque
from collections.abc import Mapping
from typing import Any

import numpy as np

from rpud_sim.foundation.terminal import printable
from rpud_sim.pages.quantities import QUANTITIES, number_text

MOST_LISTED = 300  # commands that a frame has
MOST_LOGGED = 1000

_MOST_KEPT = 20_000
_NEWEST = 50  # commands that are never thinned
_LONGEST = 200  # characters of a text
_MOST_NAMES = 6  # parameters that a text names
_QUIET = ("origin", "flush", "stop", "state")  # the drill writes these for itself
_RUN = ("begin", "restore", "save", "end")
_FAULT = ("inject", "clear", "clear_all")
_TEXTS = {"begin": "a run begins", "end": "the drill stops", "clear_all": "all faults cleared"}


class Commands:
    """Commands of one run that changed something, and their values as stepped lines."""

    def __init__(self) -> None:
        self.count = 0  # entries that were kept so far; grows with each
        self.parameters: dict[str, Any] = {}
        self._entries: deque[dict[str, Any]] = deque(maxlen=_MOST_KEPT)
        self._texts: dict[str, str] = {}
        self._steps: dict[str, list[tuple[float, float]]] = {}

    def add(self, time: float, kind: str, content: object) -> None:
        """Add an entry of the journal at a time [s]; its content is JSON, or what that says."""
        if kind in _QUIET:
            return
        try:
            found = json.loads(content) if isinstance(content, str) else content
            text = self._take(time, kind, found if isinstance(found, dict) else {})
        except (AttributeError, KeyError, RecursionError, TypeError, ValueError):
            text = kind  # another program wrote it
        if kind in ("weight_on_bit", "drive", "feed"):
            if self._texts.get(kind) == text:
                return
            self._texts[kind] = text
        if text:
            sort = "run" if kind in _RUN else "fault" if kind in _FAULT else "command"
            self._entries.append(
                {"time": time, "kind": sort, "text": printable(text)[:_LONGEST]}
            )
            self.count += 1

    def listed(self) -> dict[str, Any]:
        """Return ``commands`` of a frame."""
        entries = [
            {**entry, "kind": entry["kind"]}
            for entry in self._entries
            if entry["kind"] == "command"
        ]
        kept = entries
        if len(entries) > MOST_LISTED:
            older = entries[:-_NEWEST]
            places = np.linspace(0, len(older) - 1, MOST_LISTED - _NEWEST).round().astype(int)
            kept = [older[place] for place in places] + entries[-_NEWEST:]
        return {"list": kept, "thinned": len(entries) - len(kept)}

    def log(self) -> tuple[list[dict[str, Any]], int]:
        """Return the newest entries of all kinds, newest last, and how many are left out."""
        entries = list(self._entries)[-MOST_LOGGED:]
        return entries, self.count - len(entries)

    def steps(self) -> dict[str, dict[str, np.ndarray]]:
        """Return ``steps`` of a frame: commanded values over time."""
        return {
            name: {
                "t": np.array([time for time, _ in steps], float),
                "v": np.array([value for _, value in steps], np.float32),
            }
            for name, steps in self._steps.items()
        }

    def _take(self, time: float, kind: str, content: Mapping[str, Any]) -> str:
        if kind == "weight_on_bit":
            force = float(content["force"])
            self._step("weight_on_bit", time, force)
            return f"press with {QUANTITIES['weight_on_bit'].text(force)}"
        if kind == "drive":
            return self._drive(time, content)
        if kind == "feed":
            return _feed(str(content["mode"]), float(content["value"]))
        if kind == "configure":
            return self._configure(content["parameters"])
        if kind == "begin":
            self._begin(time, content)
        if kind == "inject":
            fault = content["fault"]
            channel = f" of {fault['channel']}" if fault["channel"] else ""
            return f"fault injected: {fault['kind'].replace('_', ' ')}{channel}"
        if kind == "clear":
            return f"fault {content['number']} cleared"
        if kind in ("save", "restore"):
            return f"checkpoint {content['name']!s:.60} {kind}d"
        return _TEXTS.get(kind, kind.replace("_", " "))

    def _begin(self, time: float, content: Mapping[str, Any]) -> None:
        self._texts.clear()
        self.parameters = dict(content["parameters"])
        if self.parameters.get("feed_model", "none") == "none":
            self._step("weight_on_bit", time, float(self.parameters["weight_on_bit"]))
            force = QUANTITIES["weight_on_bit"].text(float(self.parameters["weight_on_bit"]))
            self._texts["weight_on_bit"] = f"press with {force}"

    def _drive(self, time: float, content: Mapping[str, Any]) -> str:
        on = bool(content["enabled"])
        voltage, frequency = float(content["voltage"]), float(content["frequency"])
        self._step("drive_voltage", time, voltage if on else 0.0)
        self._step("drive_frequency", time, frequency if on else math.nan)
        if not on:
            return "drive off"
        return f"drive {QUANTITIES['drive_voltage'].text(voltage)}" + (
            f" at {frequency * 1e-3:.6g} kHz" if frequency > 0.0 else ""
        )

    def _configure(self, parameters: Mapping[str, Any]) -> str:
        changed = [
            f"{name} {number_text(value) if isinstance(value, float) else value!s:.30}"
            for name, value in parameters.items()
            if name not in self.parameters or self.parameters[name] != value
        ]
        self.parameters.update(parameters)
        more = len(changed) - _MOST_NAMES
        text = "set " + ", ".join(changed[:_MOST_NAMES])
        return "" if not changed else f"{text} and {more} more" if more > 0 else text

    def _step(self, name: str, time: float, value: float) -> None:
        steps = self._steps.setdefault(name, [])
        if steps and (steps[-1][1] == value or steps[-1][1] != steps[-1][1] and value != value):
            return
        steps.append((time, value))
        if len(steps) > _MOST_KEPT:  # every second one of the older half goes
            steps[: len(steps) // 2] = steps[: len(steps) // 2 : 2]


def _feed(mode: str, value: float) -> str:
    if mode == "position":
        return f"feed to {QUANTITIES['feed'].text(value)}"
    return f"feed at {QUANTITIES['penetration_rate'].text(value)}" if value else "feed holds"
