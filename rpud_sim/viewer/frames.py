"""Frames: what a browser looks at, what is new for it, and the bytes of that."""

from __future__ import annotations

import math
import time
from collections.abc import Collection, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.foundation.json_text import json_text
from rpud_sim.foundation.shown_quantities import QUANTITIES, for_browser
from rpud_sim.foundation.terminal import printable
from rpud_sim.recorded.drill_tables import field_units
from rpud_sim.viewer.history import History

_ALIGNED = 8  # bytes
_MOST_PLOTS = 5  # of a bag without a drill
_SHARE = 100.0  # a view of a running drill may take one part of so many of the time

# Choices of the last plot: title and quantities by identifier.
_MORE = {
    "depth": ("depth of the hole", "depth"),
    "rate": ("rate of penetration", "penetration_rate"),
    "power": ("power, mean of a second", "actuator_power", "absorbed_power", "electrical_power"),
    "impacts": ("impacts per second", "impact_rate"),
    "torque": ("torque", "torque", "drive_torque"),
    "rotation": ("rotation", "rotation_rate"),
    "feed": ("feed and mount", "feed", "mount_position"),
    "arm": ("force of the arm on the mount", "mount_force"),
    "positions": ("positions", "nodal_plane", "drill_tool"),
    "voltage": ("voltage of the drive", "drive_voltage"),
    "frequency": ("drive and resonance", "drive_frequency", "resonance_frequency"),
    "current": ("current of the actuator", "current"),
    "vibration": ("amplitude of the vibration", "vibration_amplitude"),
    "temperature": ("temperature of the actuator", "temperature"),
    "cuttings": ("cuttings in the flutes", "packed_cuttings"),
    "wear": ("wear of the bit", "bit_wear"),
    "lateness": ("how late the latest block was", "lateness"),
}
# Identifier and title of each plot, and its choices.
_PLOTS = (
    ("peak_force", "peak force of the impacts", {"": ("", "peak_force", "contact_force")}),
    ("load", "reacting force", {"": ("", "reacting_force", "weight_on_bit")}),
    ("motion", "motion", {"": ("", "actuator", "free_mass", "drill_tool")}),
    ("more", "more", _MORE),
)


def plots_of(history: History) -> list[dict[str, Any]]:
    """Return the plots of a drill as a frame has them; other signals are choices of the last."""
    others = [_choice(each.name, each.label, {each.name: each.label}) for each in history.others()]
    if not history.is_drill:
        return [
            {"id": f"signal{n}", "title": "signal", "choices": others[n:] + others[:n]}
            for n in range(min(_MOST_PLOTS, len(others)))
        ]
    plots = []
    for name, title, choices in _PLOTS:
        shown = [
            _choice(each, heading, labels)
            for each, (heading, *quantities) in choices.items()
            if (labels := {q: QUANTITIES[q].label for q in quantities if history.has(q)})
        ]
        if name == "more":
            shown += others
        if shown:
            plots.append({"id": name, "title": title, "choices": shown})
    return plots


def _choice(name: str, title: str, labels: Mapping[str, str]) -> dict[str, Any]:
    """Return a choice of a plot with a layer for each quantity, by the labels of these."""
    layers = [
        {
            "quantity": quantity,
            "label": label,
            "kind": QUANTITIES[quantity].kind if quantity in QUANTITIES else "band",
        }
        for quantity, label in labels.items()
    ]
    return {"id": name, "title": title, "layers": layers}


def chosen_quantities(plots: Collection[dict[str, Any]], choices: Any) -> dict[str, str]:
    """Return kinds of layers by the quantity that is shown, with these choices by plot.

    The plot of the motion is drawn from sections.
    """
    found: dict[str, str] = {}
    for plot in plots:
        options = {each["id"]: each["layers"] for each in plot["choices"]}
        layers = options.get(choices.get(plot["id"]), plot["choices"][0]["layers"])
        if plot["id"] != "motion":
            found |= {layer["quantity"]: layer["kind"] for layer in layers}
    return found


@dataclass(frozen=True)
class View:
    """Range of time that a browser shows: the last seconds, or from ``start`` to ``end``."""

    follow: float | None = 20.0  # s; None for a fixed range
    start: float = 0.0  # s
    end: float = 0.0  # s
    width: int = 1000  # of a plot [px]


@dataclass
class ClientState:
    """What one browser looks at, and what was sent there."""

    drill: str = ""  # namespace; empty for the store's own choice
    view: View = View()
    choices: Mapping[str, str] = field(default_factory=dict)  # identifiers of choices by plot
    playhead: float | None = None  # s; None if it has none
    section: bool = True  # whether the newest block is wanted; a frame with a section clears it
    jump: dict[str, Any] | None = None  # impact that was asked for, or why there is none
    sent: dict[str, Any] = field(default_factory=dict)  # keys and times of fields that were sent

    def is_due(self, name: str, key: Any, period: float = 0.0) -> bool:
        """Return whether a field has changed and is older than a period [s]; it is sent then."""
        before, at = self.sent.get(name, (None, -math.inf))
        if key == before or time.monotonic() - at < period:
            return False
        self.sent[name] = key, time.monotonic()
        return True


class Store:
    """Drills that browsers look at. All methods are called from one thread, which may be any."""

    mode = ""  # ``live`` or ``recorded``

    def open(self, client: ClientState) -> None:
        """Note one more browser; an expected error ends the page."""

    def request(self, client: ClientState, name: str, content: Any) -> None:
        """Do what a browser asks: ``act`` and its arguments, or ``seek``; ParameterError if not."""

    def shown(
        self, client: ClientState
    ) -> AbstractContextManager[tuple[History, Mapping[str, Any]]]:
        """Return the drill of a browser and its state, which do not change meanwhile."""
        raise NotImplementedError

    def frame(self, client: ClientState) -> dict[str, Any] | None:
        """Return fields of the next frame without ``number``; None if nothing is new."""
        with self.shown(client) as (history, state):
            if client.sent.get("run", (None,))[0] != state["run"]:
                client.sent.clear()
                client.section = True
            frame = {name: value for name, value in state.items() if client.is_due(name, value)}
            frame |= measured(history, client)
        if client.jump:
            frame["jump"], client.jump = client.jump, None
        return frame or None


def measured(history: History, client: ClientState) -> dict[str, Any]:
    """Return what is new for a browser: commands, plots, numbers and motion."""
    sent, due, view, found = client.sent, client.is_due, client.view, dict[str, Any]()
    pace = 1.0 if history.live else 0.0  # of what changes all the time
    start, end = history.range(view)
    if due("faults", faults := history.faults):
        found["faults"] = faults
    if due("log", history.log_version, 0.5 * pace):
        found |= history.log()
    stepped = [name for name in history.commands.quantities if history.is_stepped(name)]
    if due("steps", (history.log_version, start if not pace else None, view, stepped), 0.5 * pace):
        # An entry of the journal may come before the messages of its time.
        steps = history.commands.steps(start, math.inf if view.follow else end, view.width)
        found["steps"] = {name: steps[name] for name in stepped}
    if history.time is None:
        return found
    now = history.time
    at = now if client.playhead is None else min(max(client.playhead, 0.0), now)
    # By what came, not by its time: a message that arrives late is shown too.
    version = history.version
    if due("has", version, 1.0 * pace):
        plots = plots_of(history)
        if due("plots", plots):
            others = [each.for_browser() for each in history.others()]
            found |= {"plots": plots, "quantities": for_browser() + others, "units": field_units()}
    if due("moment", (version, at), 0.2 * pace):
        found |= history.moment(at)
    if due("whole", version, 1.0 * pace):
        found |= history.whole()
    key = history.section_key(at) if client.section else None
    if key is not None and due("section", key) and (section := history.section(at)):
        found["section"] = section
    kinds = chosen_quantities(sent["plots"][0], client.choices)
    kinds = {name: kind for name, kind in kinds.items() if name not in stepped}
    if due("asked", (view, kinds)):
        sent["view"] = None, -math.inf
    if due("view", history.view_key(start, end), sent.get("cost", 0.0) * _SHARE * pace):
        began = time.thread_time()
        found["view"] = history.view(start, end, view.width, kinds)
        sent["cost"] = time.thread_time() - began
    return found


def encode(frame: Mapping[str, Any]) -> bytes:
    """Return the bytes of a frame: a header in JSON, and arrays in binary.

    They are ``uint32 n`` (little-endian), n bytes of the header, zeros up to a multiple of 8, and
    the arrays, each filled up to a multiple of 8. In the header an array is ``{"$": [offset,
    length, type]}``: the offset counts from the first array [bytes], the type is ``f4`` or ``f8``.

    Its values are plain ones, mappings, sequences and one-dimensional arrays. Times need double
    precision, and have it; other arrays become single. Equal arrays are sent once. A scalar that is
    not finite becomes null.
    """
    arrays: dict[bytes, int] = {}  # offsets by content
    size = 0

    def plain(value: Any) -> Any:
        nonlocal size
        if isinstance(value, np.ndarray):
            kind = "f8" if value.dtype == np.float64 else "f4"
            with np.errstate(over="ignore"):  # garbage of a sensor
                data = _filled(np.ascontiguousarray(value, f"<{kind}").tobytes())
            if data not in arrays:
                arrays[data] = size
                size += len(data)
            return {"$": [arrays[data], len(value), kind]}
        if isinstance(value, Mapping):
            return {printable(str(key)): plain(each) for key, each in value.items()}
        if isinstance(value, list | tuple):
            return [plain(each) for each in value]
        if isinstance(value, np.generic):
            value = value.item()
        if isinstance(value, float) and not math.isfinite(value):
            return None
        return printable(value) if isinstance(value, str) else value

    header = json_text(plain(frame), separators=(",", ":")).encode()
    return b"".join([_filled(len(header).to_bytes(4, "little") + header), *arrays])


def _filled(data: bytes) -> bytes:
    return data + bytes(-len(data) % _ALIGNED)
