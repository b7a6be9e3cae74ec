"""Any range of time of a bag, as fine as a screen shows it: bins, messages, or the waveform."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.impacts import Impacts, Spread
from rpud_sim.viewer.recorded.lines import Layer, binned, joined, thinned, with_gaps
from rpud_sim.viewer.recorded.overview import Overview
from rpud_sim.viewer.recorded.recording import Recording
from rpud_sim.viewer.recorded.signals import Signal, is_stranger
from rpud_sim.viewer.recorded.waveforms import CHANNELS, Waveform, Waveforms

OVERVIEW, MESSAGES, WAVEFORM = "overview", "messages", "waveform"  # what a view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the rebuilt waveform [s]

_MOST_PIECES = 80  # parts of the bag that one view reads
_POINT = 2  # width of a part of a band [px]
_TIMELINE = 1000  # bins of the timeline
_LEAST_IMPACTS = 8  # in a part of the time that shows their spread
_IMPACTS = ("impact_rate", "peak_force")  # quantities of the impacts

Series = tuple[np.ndarray, np.ndarray]  # times since the bag began [s] and values, shape (n,)


class Views:
    """Views of one recording."""

    def __init__(self, recording: Recording, overview: Overview, waveforms: Waveforms) -> None:
        self._recording = recording
        self._overview = overview
        self._waveforms = waveforms
        self._signals = {signal.name: signal for signal in recording.signals}

    def signal(self, drill: str, quantity: str) -> Signal | None:
        """Return the signal that shows a quantity of a drill; None if there is none with values.

        Beyond the table of quantities, the name of a signal is a quantity.
        """
        if quantity in self._signals:
            return self._signals[quantity]
        for source in QUANTITIES[quantity].sources if quantity in QUANTITIES else ():
            found = [
                signal
                for signal in self._signals.values()
                if signal.drill == drill and signal.source == source and self.has_values(signal)
            ]
            if found:
                return min(found, key=lambda signal: is_stranger(signal.topic))
        return None

    def has_values(self, signal: Signal) -> bool:
        return self._overview.bins.has(signal.name)

    def has(self, drill: str, quantity: str) -> bool:
        """Whether there is anything of a quantity."""
        if quantity in _IMPACTS:
            return self._overview.impacts[drill].total > 0
        exact = quantity in CHANNELS and self._waveforms.has(drill)
        return exact or self.signal(drill, quantity) is not None

    def view(
        self, drill: str, start: float, end: float, width: int, quantities: Iterable[str]
    ) -> dict[str, Any]:
        """Return the field ``view`` of a frame with layers of some quantities."""
        parts = max(1, width // _POINT)
        signals = {name: self.signal(drill, name) for name in quantities if name not in _IMPACTS}
        wanted = {name: signal for name, signal in signals.items() if signal is not None}
        peaks = bool(set(_IMPACTS) & set(quantities)) and self.has(drill, "peak_force")
        found: dict[str, Any] = {"start": start, "end": end, "band": "least-greatest"}
        numbers = self._parts(drill, wanted.values(), start, end)
        if numbers is None:
            layers = {name: self.bins(signal, start, end, parts) for name, signal in wanted.items()}
            if peaks:
                impacts = self._overview.impacts[drill]
                ranges = self._ranges(start, end, parts)
                layers |= _impact_layers([_spread(impacts, *each) for each in ranges])
            complete = self._overview.complete
            return found | {"detail": OVERVIEW, "complete": complete, "layers": layers}
        series = self.series(wanted.values(), numbers, start, end)
        layers = {}
        for name, signal in wanted.items():
            times, values = series[signal]
            if len(times) > width:
                layers[name] = with_gaps(binned(times, values, start, end, parts))
            else:
                layers[name] = with_gaps({"t": times, "mean": values})
        if peaks:
            layers |= self._single_impacts(drill, start, end, parts)
        found["complete"] = not any(number in self._recording.damages for number in numbers)
        found["detail"] = MESSAGES
        if end - start < 1.001 * WAVEFORM_RANGE:
            waveform = self._waveforms.between(drill, start, end)
            if len(waveform.times):
                found["detail"] = WAVEFORM
                struck = peaks and len(layers["peak_force"]["t"]) > 0
                for quantity, channel in CHANNELS.items():
                    silent = channel == "contact_force" and not waveform.channels[channel].any()
                    if silent and struck:
                        continue  # before drilling an impact has no duration, and so no waveform
                    layers[quantity] = _waveform_layer(waveform, channel, width)
        return found | {"layers": layers}

    def timeline(self, drill: str) -> Layer:
        """Return the field ``timeline`` of a frame: peak force, else the first signal."""
        signals = [each for each in self._signals.values() if each.drill == drill]
        first = next(filter(self.has_values, signals), None)
        signal = self.signal(drill, "peak_force") or first
        return self.bins(signal, 0.0, self._overview.end, _TIMELINE) if signal else {}

    def bins(self, signal: Signal, start: float, end: float, width: int) -> Layer:
        """Return a signal in the overview's bins."""
        layers = []
        for begin, until, parts in self._ranges(start, end, width):
            found = self._overview.bins.view(signal.name, begin, until, parts)
            layer = {"t": found.times, "mean": found.mean, "low": found.low, "high": found.high}
            layers.append(with_gaps(layer))
        return joined(layers)

    def series(
        self, wanted: Iterable[Signal], numbers: Sequence[int], start: float, end: float
    ) -> dict[Signal, Series]:
        """Return signals from a time to another, with the value before and the one after."""
        recording = self._recording
        found: dict[Signal, list[Series]] = {signal: [] for signal in wanted}
        for number in numbers:
            for topic, rows in recording.rows(number).items():
                signals = [signal for signal in found if signal.topic == topic]
                times = recording.elapsed(topic, rows) if signals else np.empty(0)
                for signal in signals:
                    values = rows.values[signal.column]
                    valid = np.isfinite(values)
                    found[signal].append((times[valid], values[valid]))
        series = {}
        for signal, parts in found.items():
            times, values = np.concatenate([np.empty((2, 0)), *parts], axis=1)
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
            first = max(int(np.searchsorted(times, start)) - 1, 0)
            last = int(np.searchsorted(times, end, "right")) + 1
            series[signal] = times[first:last], values[first:last]
        return series

    def _parts(
        self, drill: str, signals: Iterable[Signal], start: float, end: float
    ) -> list[int] | None:
        """Return the parts of a range; None for more than one view reads."""
        if end - start > MESSAGES_RANGE:
            return None
        found: set[int] = set()
        for each in {signal.drill for signal in signals} | {drill}:
            numbers = self._recording.pieces_between(each, start, end)
            found.update(itertools.islice(numbers, _MOST_PIECES + 1))
        return sorted(found) if len(found) <= _MOST_PIECES else None

    def _ranges(self, start: float, end: float, width: int) -> list[tuple[float, float, int]]:
        """Return a range as far as all of it was read, and the rest, with numbers of parts.

        In the rest a part is so long that it holds something that was sampled.
        """
        known = min(max(self._overview.known, start), end)
        share = (end - known) / max(self._overview.end, 1e-9)
        ranges = [(start, known, width)] if known > start else []
        if known < end or not ranges:
            sampled = max(1, int(share * len(self._recording.sample)))
            ranges.append((known, end, min(sampled, width)))
        return ranges

    def _single_impacts(
        self, drill: str, start: float, end: float, parts: int
    ) -> dict[str, dict[str, Any]]:
        """Return rate and peak forces: each impact if a screen has room for it, else parts."""
        found = self._waveforms.impacts(drill, start, end)
        valid = np.isfinite(found["peak_force"])
        times, peaks = found["time"][valid], found["peak_force"][valid]
        impacts = Impacts()
        impacts.add(times, peaks)
        layers = _impact_layers([_spread(impacts, start, end, parts)])
        if len(times) <= parts:
            layers["peak_force"] = {"t": times, "mean": peaks}
        return layers


def _spread(impacts: Impacts, start: float, end: float, parts: int) -> Spread:
    """Return the spread of impacts in parts that hold enough of them to have one."""
    count = len(impacts.between(start, end)[0])
    return impacts.spread(start, end, min(parts, max(1, count // _LEAST_IMPACTS)))


def _impact_layers(spreads: Sequence[Spread]) -> dict[str, dict[str, Any]]:
    peaks = [
        with_gaps({"t": each.times, "mean": each.mean, "low": each.low, "high": each.high})
        for each in spreads
    ]
    outliers = [{"t": each.outlier_times, "v": each.outliers} for each in spreads]
    more = {"more": sum(each.more for each in spreads)}
    rate = joined([{"t": each.times, "mean": each.rate} for each in spreads])
    peak_force = {**joined(peaks), "outliers": {**joined(outliers), **more}, "band": "5-95 %"}
    return {"peak_force": peak_force, "impact_rate": rate}


def _waveform_layer(waveform: Waveform, channel: str, most: int) -> Layer:
    """Return a channel with every peak, and NaN where samples are missing."""
    edges = [0, *waveform.cuts, len(waveform.times)]
    parts = [
        thinned(waveform.times[first:last], waveform.channels[channel][first:last], most)
        for first, last in itertools.pairwise(edges)
    ]
    for part in parts[:-1]:
        part["t"] = np.append(part["t"], part["t"][-1])
        part["mean"] = np.append(part["mean"], np.nan)
    return joined(parts)
