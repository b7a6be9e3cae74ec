"""Commands of a run in words, and as stepped lines, from the entries of its journal."""

from __future__ import annotations

import math
import re
from array import array
from collections import deque
from collections.abc import Collection, Iterable, Mapping
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.foundation.shown_quantities import QUANTITIES
from rpud_sim.foundation.values import to_float32
from rpud_sim.simulation.configuration import parameter_rows
from rpud_sim.simulation.fault_kinds import fault_text, magnitude_text

# Kinds of entries; a failure is one of a test.
COMMAND, FAULT, RUN, REFUSAL, FAILURE = "command", "fault", "run", "refusal", "failure"
MOST_LOGGED = 1000  # entries that are kept, the newest

_MOST_STEPS = 50_000  # changes of one quantity that are kept, at most
_CLOSE = 1.0  # longest time between changes that follow each other closely [s]
_ALONE = 4  # close changes that have entries of their own; further ones share the last entry
_MOST_NAMES, _LENGTH = 4, 160  # parameters that a text names; its characters
_QUIET = ("flush", "stop", "origin")  # entries that change nothing for the user
_LASTING = ("weight_on_bit", "drive", "feed", "mount")  # kinds whose value holds until the next one
_LASTING_NAMES = [kind.replace("_", " ") for kind in _LASTING]
_BEYOND = re.compile(r"[\w ]+ = (\S+)( .+?)? is outside its range [\[(](\S+), (\S+)[\])].*")
_Told = tuple[str, str, Mapping[str, float]]  # kind of an entry, its text, and what it sets


@dataclass
class LogEntry:
    """Change of a run, in words."""

    time: float  # since the run, or the bag, began [s]
    kind: str  # ``COMMAND``, ``FAULT``, ``RUN`` or ``REFUSAL``
    text: str
    name: str = ""  # of what has changed several times
    count: int = 1  # of the changes that it represents

    def plain(self) -> dict[str, Any]:
        times, last = f"\N{MULTIPLICATION SIGN}{self.count}", self.text.removeprefix(self.name)
        text = f"{self.name} {times}, last{last}" if self.count > 1 else self.text
        return {"time": self.time, "kind": self.kind, "text": text}


class Commands:
    """Commands of a drill; ``add`` takes the entries of its journal in their order.

    A command is an entry if its text differs from the one before. The fifth and later ones
    of several that follow each other within a second share one entry, which counts them.
    """

    def __init__(self) -> None:
        self.parameters: dict[str, Any] = {}  # of the current run, as far as it is known
        self._count = 0  # entries, also those that are not kept any more
        self._entries: deque[LogEntry] = deque(maxlen=MOST_LOGGED)
        self._last: dict[str, tuple[float, str, int, LogEntry]] = {}  # by kind; number in the row
        self._steps: dict[str, tuple[array[float], array[float]]] = {}

    def add(self, time: float, kind: str, content: Any) -> None:
        """Add an entry of the journal at a time [s]."""
        kind = kind[:_LENGTH]
        if kind in _QUIET:
            return
        try:
            sort, text, values = self._read(kind, content)
            text = text[:_LENGTH]
            for name, value in values.items():
                self._step(name, time, float(value))
        # Another program wrote it.
        except (AttributeError, LookupError, RecursionError, TypeError, ValueError):
            sort, text = COMMAND, kind
        if sort == RUN:
            self._last.clear()
        since, before, row, entry = self._last.get(kind, (-math.inf, "", 0, None))
        if kind in _LASTING and text == before:
            return
        row = row + 1 if 0.0 <= time - since <= _CLOSE else 1
        if kind in _LASTING and row > _ALONE and entry is not None:
            entry.time, entry.text, entry.count = time, text[:_LENGTH], entry.count + 1
        else:
            entry = self._log(time, sort, text)
            entry.name = kind.replace("_", " ")
        self._last[kind] = time, text, row, entry

    def refuse(self, time: float, reason: str) -> None:
        """Add a rejection to the log, at a time [s]."""
        self._log(time, REFUSAL, f"rejected: {plain_refusal(reason)}")

    @property
    def quantities(self) -> Collection[str]:
        """Quantities of which there are steps."""
        return self._steps.keys()

    def frame(
        self,
        faults: Iterable[Mapping[str, Any]] = (),
        lost: Iterable[tuple[float, float]] = (),
    ) -> dict[str, Any]:
        """Return the fields ``log`` and ``log_thinned`` of a frame.

        ``faults`` are the frame's. Their beginnings and ends replace what the
        journal contains about faults. One entry replaces what the drill did by itself while
        commands were lost, from and until [s].
        """
        told = []
        for fault in faults:
            name = f"fault {fault['number']}"
            begins = f"{name}: {_fault_text(fault)} begins"
            told.append(LogEntry(float(fault["onset"]), FAULT, begins))
            if fault.get("end") is not None:
                told.append(LogEntry(float(fault["end"]), FAULT, f"{name} ends"))
        own = [entry for entry in self._entries if not (told and entry.kind == FAULT)]
        for begin, end in lost:
            own = [e for e in own if e.name not in _LASTING_NAMES or not begin <= e.time < end]
            told.append(LogEntry(begin, FAULT, "commands lost: drive and weight on bit fall to 0"))
        entries = sorted([*own, *told], key=lambda entry: entry.time)
        return {
            "log": [entry.plain() for entry in entries],
            "log_thinned": self._count - len(self._entries),
            "parameters": parameter_rows(self.parameters),
        }

    def _log(self, time: float, kind: str, text: str) -> LogEntry:
        self._count += 1
        self._entries.append(entry := LogEntry(time, kind, text[:_LENGTH]))
        return entry

    def steps(self, start: float, end: float, most: int) -> dict[str, dict[str, np.ndarray]]:
        """Return the field ``steps`` of a frame: each commanded value from its time on.

        The first of a quantity is the one active at ``start``, and the last one holds. At most
        ``most`` of a quantity are returned, evenly thinned.
        """
        found = {}
        for name, (times, values) in self._steps.items():
            t, v = np.array(times), to_float32(values)
            first = max(int(np.searchsorted(t, start, "right")) - 1, 0)
            last = int(np.searchsorted(t, end, "right"))
            chosen = np.linspace(first, last - 1, min(last - first, most)).astype(int)
            found[name] = {"t": t[chosen], "v": v[chosen]}
        return found

    def _read(self, kind: str, content: Mapping[str, Any]) -> _Told:
        """Return kind and text of an entry, and what it sets; note its parameters."""
        match kind:
            case "begin":
                own = self.parameters = dict(content["parameters"])
                values = {
                    "drive_voltage": own["nominal_voltage"] if own["drive_enabled"] else 0.0,
                    "drive_frequency": own["vibration_frequency"],
                }
                if own.get("feed_model", "none") == "none":  # else it follows from the feed
                    values["weight_on_bit"] = own["weight_on_bit"]
                return RUN, "a run begins", values
            case "end":
                return RUN, "the drill stops", {}
            case "weight_on_bit":
                text = f"weight on bit {_shown(kind, content['force'])}"
                return COMMAND, text, {kind: content["force"]}
            case "drive" if not content["enabled"]:
                return COMMAND, "drive off", {"drive_voltage": 0.0}
            case "drive":
                voltage, frequency = float(content["voltage"]), float(content["frequency"])
                text = f"drive {_shown('drive_voltage', voltage)} at {1e-3 * frequency:.6g} kHz"
                return COMMAND, text, {"drive_voltage": voltage, "drive_frequency": frequency}
            case "feed" if content["mode"] == "position":
                return COMMAND, f"feed to {_shown('feed', content['value'])}", {}
            case "feed":
                rate = f"feed at {1e3 * float(content['value']):.4g} mm/s"
                return COMMAND, rate if content["value"] else "feed holds", {}
            case "mount":
                velocity = 1e3 * float(content["velocity"])
                place = f"mount at {_shown('feed', content['position'])}"
                return COMMAND, f"{place}, {velocity:.4g} mm/s", {}
            case "configure":
                before, now = self.parameters, dict(content["parameters"])
                self.parameters = before | now
                new = [f"{k} {v!s:.30}" for k, v in now.items() if before.get(k) != v]
                more = f" and {len(new) - _MOST_NAMES} more" if len(new) > _MOST_NAMES else ""
                return COMMAND, f"parameters: {', '.join(new[:_MOST_NAMES])}{more}", {}
            case "inject":
                return FAULT, f"{_fault_text(content['fault'])} begins", {}
            case "clear":
                return FAULT, f"fault {int(content['number'])} ends", {}
            case "clear_all":
                return FAULT, "all faults end", {}
        return COMMAND, kind.replace("_", " "), {}

    def _step(self, name: str, time: float, value: float) -> None:
        times, values = self._steps.setdefault(name, (array("d"), array("d")))
        if not values or values[-1] != value:
            times.append(time)
            values.append(value)
        if len(times) > _MOST_STEPS:
            self._steps[name] = times[::2], values[::2]


def _shown(quantity: str, value: float) -> str:
    return QUANTITIES[quantity].text(float(value))


def _fault_text(fault: Mapping[str, Any]) -> str:
    """Return ``noise on reacting force 5 N``: kind, channel and magnitude."""
    kind, channel = str(fault["kind"]), str(fault.get("channel") or "")
    size = magnitude_text(kind, channel, float(fault.get("magnitude") or 0.0))
    return f"{fault_text(kind, channel).replace('_', ' ')} {size}".strip()


def plain_refusal(reason: str) -> str:
    """Return a drill's reason in fewer words, such as ``9999 V is above 200 V``."""
    if found := _BEYOND.fullmatch(reason):
        value, unit, low, high = (each or "" for each in found.groups())
        with suppress(ValueError):
            if float(value) < float(low):
                return f"{value}{unit} is below {low}{unit}"
            if float(value) > float(high):
                return f"{value}{unit} is above {high}{unit}"
    return reason
