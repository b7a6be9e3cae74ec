"""Frames of a running drill: for each browser what has changed since its frame before."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES, number_text
from rpud_sim.viewer import hole
from rpud_sim.viewer.impacts import part_length
from rpud_sim.viewer.live.heard import SECTION, Heard
from rpud_sim.viewer.live.live_drill import LiveDrill
from rpud_sim.viewer.plots import chosen_quantities, drill_plots
from rpud_sim.viewer.store import ClientState, StoreError, View

_GAP = 1.0  # at the beginning, in which nobody heard the drill, that is shown [s]
_MOST_SAMPLES = 1200  # of a section
_MOST_EXACT = 60_000  # impacts of a view whose quantiles are computed; more have extremes
_POINT = 2.0  # px
_RATES = 10  # parts of a second, whose rates of impacts are compared
_SPARK = 60  # means of a sparkline, one a second
_TIMELINE = 1000  # bins
_LOG_BINS = 4000  # of the run, for rate and torque over the depth
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
            self._client.sent["sparks"] = _sparks(heard, now)
        if self._due("numbers", now, 0.2):
            self._fields["numbers"] = _numbers(heard, now, self._client.sent["sparks"])
        if self._due("whole", heard.whole.end, 1.0):
            line = heard.whole.view("peak_force", 0.0, heard.whole.end, _TIMELINE)
            names = {"t": line.times, "low": line.low, "mean": line.mean, "high": line.high}
            self._fields["timeline"] = names
            if (found := _hole(heard)) is not None:
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
        parts = max(1, int(client.view.width / _POINT))
        layers = {
            quantity: layer_of(heard, quantity, kind, start, end, parts)
            for quantity, kind in chosen_quantities(plots, client.choices).items()
            if not heard.is_stepped(quantity)
        }
        self._fields["view"] = {
            "start": start,
            "end": end,
            "detail": "overview",
            "complete": True,
            "band": "5-95 %",
            "layers": layers,
        }
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


def layer_of(
    heard: Heard, quantity: str, kind: str, start: float, end: float, parts: int
) -> dict[str, Any]:
    """Return a layer of ``view``: a quantity in about so many parts of a range of time [s]."""
    if quantity in ("impact_rate", "peak_force"):
        begin, last = max(start, heard.since or 0.0), min(end, heard.time or 0.0)
        times, _ = heard.impacts.between(begin, last)
        if quantity == "impact_rate":
            width = part_length(start, end, parts)
            edges = np.arange(np.floor(begin / width), np.ceil(last / width) + 1) * width
            counts = np.diff(np.searchsorted(times, edges)) * heard.impacts.stride
            return {"t": edges[:-1] + 0.5 * width, "mean": counts / width}
        if len(times) < _MOST_EXACT:
            share = (last - begin) / (end - start)  # parts stay as long as those of other layers
            spread = heard.impacts.spread(begin, max(begin, last), max(1, round(parts * share)))
            outliers = {"t": spread.outlier_times, "v": spread.outliers, "more": spread.more}
            band = {"low": spread.low, "high": spread.high, "band": "5-95 %", "outliers": outliers}
            return {"t": spread.times, "mean": spread.mean, **band}
    found = heard.view(quantity, start, end, parts)
    known = np.isfinite(found.mean)
    layer = {"t": found.times[known], "mean": found.mean[known]}
    if kind == "line":
        return layer
    return {
        **layer,
        "low": found.low[known],
        "high": found.high[known],
        "band": "least-greatest",
    }


def _numbers(
    heard: Heard, now: float, sparks: Mapping[str, np.ndarray]
) -> dict[str, dict[str, Any] | None]:
    """Return means and extremes of the last second."""
    begin = min(max(now - 1.0, heard.since or 0.0), now - 1e-3)
    times, peaks = heard.impacts.between(begin, now)
    counts = np.histogram(times, _RATES, (begin, now))[0] * heard.impacts.stride
    rates = counts * _RATES / (now - begin)
    found: dict[str, dict[str, Any] | None] = {
        "impact_rate": _extremes(rates, rates, rates),
        "peak_force": _extremes(peaks, peaks, peaks),
    }
    for name, quantity in _measured(heard).items():
        bins = heard.fine.view(quantity, now - heard.period(quantity), now, 1 << 10)
        known = np.flatnonzero(np.isfinite(bins.mean))
        if heard.is_reported(quantity):
            known = known[-1:]
        low, mean, high = (values[known] for values in (bins.low, bins.mean, bins.high))
        found[name] = _extremes(low, mean, high) if heard.has(quantity) else None
    return {
        name: None if number is None else {**number, "spark": sparks[name]}
        for name, number in found.items()
    }


def _measured(heard: Heard) -> dict[str, str]:
    """Return quantities by the numbers that show them."""
    power = "electrical_power" if heard.has("electrical_power") else "actuator_power"
    own = ("reacting_force", "penetration_rate")
    return {**dict(zip(own, own, strict=True)), "power": power}


def _extremes(low: np.ndarray, mean: np.ndarray, high: np.ndarray) -> dict[str, Any]:
    known = np.isfinite(mean)
    if not known.any():
        return dict.fromkeys(("mean", "least", "greatest"))
    return {"mean": mean[known].mean(), "least": low[known].min(), "greatest": high[known].max()}


def _sparks(heard: Heard, now: float) -> dict[str, np.ndarray]:
    """Return means of each of the last seconds, oldest first."""
    seconds = min(_SPARK, max(1, int(now - (heard.since or 0.0))))
    edges = now - np.arange(seconds, -1, -1.0)
    times, peaks = heard.impacts.between(edges[0], now)
    counts = np.histogram(times, edges)[0]
    totals = np.histogram(times, edges, weights=peaks)[0]
    with np.errstate(invalid="ignore"):
        sparks = {"impact_rate": counts * heard.impacts.stride, "peak_force": totals / counts}
    for name, quantity in _measured(heard).items():
        means = heard.fine.view(quantity, edges[0], now, seconds).mean
        sparks[name] = means[np.isfinite(means)][-_SPARK:]
    return {name: spark.astype(np.float32) for name, spark in sparks.items()}


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


def _hole(heard: Heard) -> dict[str, Any] | None:
    """Return depth, layers and log of the hole; None without a rock that has a depth."""
    layers = hole.layers(heard.commands.parameters)
    if not layers or not heard.has("depth"):
        return None
    depth, rate, torque = (
        heard.whole.view(quantity, 0.0, heard.whole.end, _LOG_BINS).mean
        for quantity in ("depth", "penetration_rate", "torque")
    )
    latest = heard.values.get("borehole", heard.status).get("depth")
    log = hole.well_log(depth, rate, torque if heard.has("torque") else None)
    return {"depth": latest, "layers": layers, "log": log}


def _timing(status: Mapping[str, Any]) -> dict[str, str]:
    return {
        label: QUANTITIES["lateness"].text(status[name])
        if name in ("lateness_max", "lag")
        else number_text(float(status[name]))
        for label, name in _TIMING.items()
        if name in status
    }
