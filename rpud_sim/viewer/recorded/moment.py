"""One moment of a bag: status, latest values, and the figures of the second before it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from rpud_sim.viewer import hole
from rpud_sim.viewer.commands import Commands
from rpud_sim.viewer.recorded.overview import Overview
from rpud_sim.viewer.recorded.recording import Recording
from rpud_sim.viewer.recorded.signals import STATUS
from rpud_sim.viewer.recorded.views import Views
from rpud_sim.viewer.recorded.waveforms import Waveforms

_SPAN = 1.0  # time before the moment that the numbers are of [s]
_PARTS = 10  # of that time, whose rates are compared
_SPARK = 60  # means of a sparkline, each of about a second
_MOST_BACK = 50  # parts of the bag that are searched for the latest status
_TIMES = ("weight_on_bit_applied", "drive_applied", "feed_applied")
_LOG_BINS = 4000  # of the run, for rate and torque over the depth


class Moments:
    """Moments of one recording."""

    def __init__(
        self, recording: Recording, overview: Overview, waveforms: Waveforms, views: Views
    ) -> None:
        self._recording = recording
        self._overview = overview
        self._waveforms = waveforms
        self._views = views

    def at(self, drill: str, time: float, commands: Commands) -> dict[str, Any]:
        """Return status, values, numbers and hole of a frame at a time [s]."""
        found = {
            "status": self.status(drill, time),
            "values": self.values(drill, time),
            "numbers": self.numbers(drill, time),
        }
        shown = self.hole(drill, time, commands.parameters)
        return found | ({"hole": shown} if shown else {})

    def status(self, drill: str, time: float) -> dict[str, Any]:
        """Return the fields of the last status at a time [s] or before; none before the first."""
        recording = self._recording
        topic = recording.topic(drill, STATUS)
        if not topic or not recording.readers[topic].stamped:
            return {}
        for number in itertools.islice(recording.pieces_from(drill, time, back=True), _MOST_BACK):
            for message, status in reversed(recording.decoded(number, topic)):
                if recording.time_of(message, status.header.stamp) <= time + 1e-9:
                    fields = {k: v for k, v in vars(status).items() if _is_plain(v)}
                    for name in filter(partial(hasattr, status), _TIMES):
                        fields[name] = recording.time_of(message, getattr(status, name))
                    return fields
        return {}

    def values(self, drill: str, time: float) -> dict[str, dict[str, float]]:
        """Return the latest values of each topic within the last second, by topic and field."""
        recording = self._recording
        found: dict[str, tuple[float, dict[str, float]]] = {}
        for number in recording.pieces_between(drill, time - _SPAN, time):
            for topic, rows in recording.rows(number).items():
                if topic.rpartition("/")[0] != drill or not rows.values or not len(rows.stamps):
                    continue
                times = recording.elapsed(topic, rows)
                before = np.flatnonzero((times <= time + 1e-9) & (times >= time - _SPAN))
                if len(before) and times[before[-1]] >= found.get(topic, (-np.inf, {}))[0]:
                    place = before[-1]
                    values = {name: float(each[place]) for name, each in rows.values.items()}
                    found[topic] = float(times[place]), values
        return {topic.rpartition("/")[2]: values for topic, (_, values) in sorted(found.items())}

    def numbers(self, drill: str, time: float) -> dict[str, Any]:
        """Return the field ``numbers`` of a frame at a time [s]."""
        begin = max(time - _SPAN, 0.0)
        names = {
            "reacting_force": ("reacting_force",),
            "power": ("electrical_power", "actuator_power"),
            "penetration_rate": ("penetration_rate",),
        }
        chosen = {
            key: next(filter(None, (self._views.signal(drill, name) for name in choice)), None)
            for key, choice in names.items()
        }
        signals = {key: signal for key, signal in chosen.items() if signal is not None}
        pieces = [*self._recording.pieces_between(drill, begin, time)]
        series = self._views.series(signals.values(), pieces, begin, time)
        found: dict[str, Any] = dict.fromkeys(
            ("impact_rate", "peak_force", "reacting_force", "power", "penetration_rate")
        )
        for key, signal in signals.items():
            times, values = series[signal]
            values = values[: int(np.searchsorted(times, time + 1e-9, "right"))]
            inside = values[int(np.searchsorted(times, begin)) :]
            values = inside if len(inside) else values[-1:]  # a status is as old as a second
            if len(values):
                layer = self._views.bins(signal, max(time - _SPARK, 0.0), time, _SPARK)
                found[key] = _figures(values, layer["mean"])
        impacts = self._overview.impacts[drill]
        if impacts.total and time > begin:
            spread = impacts.spread(max(time - _SPARK, 0.0), time, _SPARK)
            at = self._waveforms.impacts(drill, begin, time)
            counts, _ = np.histogram(at["time"], _PARTS, (begin, time))
            rates = counts * _PARTS / (time - begin)
            found["impact_rate"] = _figures(rates, spread.rate)
            if len(at["time"]):
                found["peak_force"] = _figures(at["peak_force"], spread.mean)
        return found

    def hole(self, drill: str, time: float, parameters: Mapping[str, Any]) -> dict[str, Any] | None:
        """Return the field ``hole`` of a frame at a time [s]; None without a rock or a depth."""
        depth, rate, torque = (
            self._views.signal(drill, name) for name in ("depth", "penetration_rate", "torque")
        )
        found = hole.layers(parameters)
        if not found or depth is None or rate is None:
            return None
        bins = self._overview.bins
        parts = [
            bins.view(signal.name, 0.0, max(time, bins.width), _LOG_BINS).mean
            if signal is not None
            else None
            for signal in (depth, rate, torque)
        ]
        assert parts[0] is not None
        assert parts[1] is not None
        pieces = [*self._recording.pieces_between(drill, time - _SPAN, time)]
        times, depths = self._views.series([depth], pieces, time - _SPAN, time)[depth]
        depths = depths[times <= time + 1e-9]
        known = parts[0][np.isfinite(parts[0])]
        latest = depths[-1:] if len(depths) else known[-1:]
        return {
            "depth": float(latest[0]) if len(latest) else 0.0,
            "layers": found,
            "log": hole.well_log(parts[0], parts[1], parts[2]),
        }


def _is_plain(value: object) -> bool:
    return isinstance(value, bool | int | float | str | np.generic)


def _figures(values: np.ndarray, spark: np.ndarray) -> dict[str, Any]:
    return {
        "mean": float(values.mean()),
        "least": float(values.min()),
        "greatest": float(values.max()),
        "spark": spark[-_SPARK:].astype(np.float32),
    }
