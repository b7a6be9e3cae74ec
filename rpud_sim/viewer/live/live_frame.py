"""Frames of a running drill: for each browser what has changed since its frame before."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES, number_text
from rpud_sim.viewer.live.heard import SECTION, Heard
from rpud_sim.viewer.live.live_drill import LiveDrill
from rpud_sim.viewer.plots import chosen_quantities, drill_plots
from rpud_sim.viewer.store import ClientState, StoreError, View

_GAP = 1.0  # at the beginning, in which nobody heard the drill, that is shown [s]
_MOST_SAMPLES = 1200  # of a section
_SHARE = 100.0  # a view may take one part of so many of the time

# Rows of "timing", and what a status has for them.
_TIMING = {
    "latest block of the last report": "lateness_max",
    "behind its schedule": "lag",
    "real-time factor": "real_time_factor",
    "deadlines missed": "deadlines_missed",
    "messages dropped by the drill": "messages_dropped",
    "commands accepted": "commands_accepted",
    "commands overwritten": "commands_discarded",
    "commanders": "commanders",
}


class LiveFrame:
    """Frame under construction, of one drill for one browser; ``sent`` says what that has."""

    def __init__(self, drill: LiveDrill, client: ClientState) -> None:
        self._drill = drill
        self._client = client
        self._fields: dict[str, Any] = {}
        self._now = time.monotonic()

    def fields(self, namespaces: list[str]) -> dict[str, Any] | None:
        """Return what has changed; None for nothing."""
        drill, client = self._drill, self._client
        if drill.error:
            raise StoreError(f"the thread that hears {drill.namespace} has ended: {drill.error}")
        with drill.reading() as heard:
            if client.sent.get("run", (None,))[0] != heard.run:
                client.sent.clear()
                client.section = True
            for field, value in {
                "run": heard.run,
                "growing": True,
                "drills": namespaces,
                "drill": drill.namespace,
                "connection": drill.connection,
                "kinds": drill.kinds,
                "channels": drill.channels,
                "refusals": drill.refusals,
                "losses": drill.lost,
                "outcomes": [asdict(each) for each in drill.actions.outcomes],
                "status": heard.status,
                "faults": heard.faults,
            }.items():
                self._put(field, value)
            if "status" in self._fields:
                self._fields["timing"] = _timing(heard.status)
            self._put_heard(heard)
            if heard.time is not None:
                self._put_measured(heard, heard.time)
        return self._fields or None

    def _put_heard(self, heard: Heard) -> None:
        if self._due("values", heard.version, 0.5):
            self._fields["values"] = heard.values
        if self._due("log", heard.log_version, 0.5):
            self._fields |= heard.commands.frame(heard.faults)
        view = self._client.view
        if self._due("steps", (heard.log_version, view), 0.5):
            start, end = _range(view, heard.time or 0.0)
            steps = heard.commands.steps(start, end, view.width)
            self._fields["steps"] = {name: steps[name] for name in steps if heard.is_stepped(name)}

    def _put_measured(self, heard: Heard, now: float) -> None:
        self._put("now", now)
        self._put("extent", [0.0, now])
        if heard.since is not None:
            self._put("gaps", [[0.0, heard.since]] if heard.since > _GAP else [])
        if self._due("has", now, 1.0):
            self._put("plots", drill_plots(heard.has))
        if self._due("numbers", now, 0.2):
            self._fields["numbers"] = heard.picture().numbers(now)
        if self._due("whole", heard.whole.end, 1.0):
            whole = heard.picture(0.0)
            self._fields["timeline"] = whole.line("peak_force", 0.0, now)
            if (found := whole.hole(now, heard.commands.parameters)) is not None:
                self._fields["hole"] = found
        block = heard.block
        if self._client.section and block is not None and self._due("section", block[0]):
            self._fields["section"] = _section(heard, *block)
        self._put_view(heard, now)

    def _put_view(self, heard: Heard, now: float) -> None:
        sent, client = self._client.sent, self._client
        asked = client.view, client.choices
        if sent.get("asked") != asked:
            sent["asked"], sent["view"] = asked, (None, -math.inf)
        if not self._due("view", heard.version, sent.get("cost", 0.0) * _SHARE):
            return
        began = time.perf_counter()
        start, end = _range(client.view, now)
        plots = [plot for plot in sent["plots"][0] if plot["id"] != "motion"]
        kinds = {
            quantity: kind
            for quantity, kind in chosen_quantities(plots, client.choices).items()
            if not heard.is_stepped(quantity)
        }
        self._fields["view"] = heard.picture(start).view(start, end, client.view.width, kinds)
        sent["cost"] = time.perf_counter() - began

    def _put(self, field: str, value: Any) -> None:
        """Send a value if it has changed."""
        if self._due(field, value):
            self._fields[field] = value

    def _due(self, field: str, key: Any, period: float = 0.0) -> bool:
        """Return whether a field has changed and is older than a period [s]; it is sent then."""
        before, at = self._client.sent.get(field, (None, -math.inf))
        if key == before or self._now - at < period:
            return False
        self._client.sent[field] = key, self._now
        return True


def _range(view: View, now: float) -> tuple[float, float]:
    return (view.start, view.end) if view.follow is None else (now - view.follow, now)


def _section(
    heard: Heard, begin: float, period: float, arrays: tuple[np.ndarray, ...]
) -> dict[str, Any]:
    """Return the end of a block."""
    length = len(arrays[0])
    first = max(0, length - max(2, round(SECTION / period)))
    stride = -(-(length - first) // _MOST_SAMPLES)
    time, end = begin + first * period, begin + length * period
    names = ("nodal_plane", "actuator", "free_mass", "drill_tool", "contact_force")
    samples = {
        name: array[first::stride].astype(np.float32)
        for name, array in zip(names, arrays, strict=False)
    }
    impacts = [[at - time, *rest] for at, *rest in heard.latest_impacts if time <= at < end]
    own = {"time": time, "period": period * stride, "exact": stride == 1, "impacts": impacts}
    return {**samples, **own}


def _timing(status: Mapping[str, Any]) -> dict[str, str]:
    return {
        label: QUANTITIES["lateness"].text(status[name])
        if name in ("lateness_max", "lag")
        else number_text(float(status[name]))
        for label, name in _TIMING.items()
        if name in status
    }
