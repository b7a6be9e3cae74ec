"""Any range of time of a bag, as fine as a screen shows it: bins, messages, or the waveform."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.impacts import Impacts, Spread
from rpud_sim.viewer.recorded.lines import Layer, binned, thinned, with_gaps
from rpud_sim.viewer.recorded.overview import Overview
from rpud_sim.viewer.recorded.recording import Recording
from rpud_sim.viewer.recorded.signals import IMPACTS, PEAK_FORCE, Signal
from rpud_sim.viewer.recorded.waveforms import CHANNELS, Waveform, Waveforms

OVERVIEW, MESSAGES, WAVEFORM = "overview", "messages", "waveform"  # what a view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the rebuilt waveform [s]

_MOST_PIECES = 80  # parts of the bag that one view reads
_TIMELINE = 1000  # bins of the timeline
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
        sources = QUANTITIES[quantity].sources if quantity in QUANTITIES else ()
        for source in sources:
            for signal in self._signals.values():
                if signal.drill == drill and signal.source == source and self.has_values(signal):
                    return signal
        return None

    def has_values(self, signal: Signal) -> bool:
        return self._overview.bins.has(signal.name)

    def has(self, drill: str, quantity: str) -> bool:
        """Whether there is anything of a quantity."""
        if quantity in _IMPACTS:
            return self._overview.impacts[drill].total > 0
        if quantity in CHANNELS and self._waveforms.has(drill):
            return True
        return self.signal(drill, quantity) is not None

    def view(
        self, drill: str, start: float, end: float, width: int, quantities: Iterable[str]
    ) -> dict[str, Any]:
        """Return the field ``view`` of a frame with layers of some quantities."""
        signals = {name: self.signal(drill, name) for name in quantities if name not in _IMPACTS}
        wanted = {name: signal for name, signal in signals.items() if signal is not None}
        peaks = bool(set(_IMPACTS) & set(quantities))
        numbers = self._parts(drill, wanted.values(), start, end)
        found: dict[str, Any] = {"start": start, "end": end, "band": "least-greatest"}
        if numbers is None:
            known = self._overview.known
            layers = {name: self.bins(signal, start, end, width) for name, signal in wanted.items()}
            if peaks and self._overview.impacts[drill].total:
                spread = self._overview.impacts[drill].spread(start, end, width)
                layers |= _spread_layers(spread, known)
            complete = self._overview.complete
            return found | {"detail": OVERVIEW, "complete": complete, "layers": layers}
        series = self.series(wanted.values(), numbers, start, end)
        layers = {
            name: _message_layer(*series[signal], start, end, width)
            for name, signal in wanted.items()
        }
        if peaks:
            layers |= self._impact_layers(drill, start, end, width)
        found["complete"] = not any(number in self._recording.damages for number in numbers)
        found["detail"] = MESSAGES
        if end - start < 1.001 * WAVEFORM_RANGE and self._waveforms.has(drill):
            waveform = self._waveforms.between(drill, start, end)
            if len(waveform.times):
                found["detail"] = WAVEFORM
                for quantity, channel in CHANNELS.items():
                    layers[quantity] = _waveform_layer(waveform, channel, width)
        return found | {"layers": layers}

    def timeline(self, drill: str) -> dict[str, np.ndarray]:
        """Return the field ``timeline`` of a frame: peak force, else the first signal."""
        signal = self.signal(drill, "peak_force")
        signals = [each for each in self._signals.values() if each.drill == drill]
        signal = signal or next(filter(self.has_values, signals), None)
        if signal is None:
            return {}
        return self.bins(signal, 0.0, self._overview.end, _TIMELINE)

    def bins(self, signal: Signal, start: float, end: float, width: int) -> Layer:
        """Return a signal in the overview's bins."""
        found = self._overview.bins.view(signal.name, start, end, width)
        layer = {"t": found.times, "mean": found.mean, "low": found.low, "high": found.high}
        length = float(found.times[1] - found.times[0]) if len(found.times) > 1 else 0.0
        return with_gaps(layer, length, self._overview.known)

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
            times = np.concatenate([np.empty(0), *(each for each, _ in parts)])
            values = np.concatenate([np.empty(0), *(each for _, each in parts)])
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
            if len(found) > _MOST_PIECES:
                return None
        return sorted(found)

    def _impact_layers(
        self, drill: str, start: float, end: float, width: int
    ) -> dict[str, dict[str, Any]]:
        """Return rate and peak forces: each impact if a screen has room for it, else bins."""
        found = self._waveforms.impacts(drill, start, end)
        times, peaks = found["time"], found["peak_force"]
        valid = np.isfinite(peaks)
        if not valid.any():
            return {}
        impacts = Impacts()
        impacts.add(times[valid], peaks[valid])
        layers = _spread_layers(impacts.spread(start, end, width), math.inf)
        if 2 * len(times) <= width:
            layers["peak_force"] = {"t": times[valid], "mean": peaks[valid]}
        return layers


def is_drill(recording: Recording, drill: str) -> bool:
    """Whether a namespace has topics of a drill."""
    return any(
        reader.summary.topic.type.startswith("rpud_msgs/") and name.rpartition("/")[0] == drill
        for name, reader in recording.readers.items()
    )


def peak_forces(recording: Recording, drill: str) -> list[Signal]:
    return [
        signal
        for signal in recording.signals
        if (signal.type, signal.column, signal.drill) == (IMPACTS, PEAK_FORCE, drill)
    ]


def _spread_layers(spread: Spread, known: float) -> dict[str, dict[str, Any]]:
    width = float(spread.times[1] - spread.times[0]) if len(spread.times) > 1 else 0.0
    layer = {"t": spread.times, "mean": spread.mean, "low": spread.low, "high": spread.high}
    outliers = {"t": spread.outlier_times, "v": spread.outliers, "more": spread.more}
    return {
        "peak_force": {
            **with_gaps(layer, width, known),
            "outliers": outliers,
            "band": "5-95 %",
        },
        "impact_rate": {"t": spread.times, "mean": spread.rate},
    }


def _message_layer(
    times: np.ndarray, values: np.ndarray, start: float, end: float, width: int
) -> Layer:
    if len(times) > width:
        return with_gaps(binned(times, values, start, end, width))
    return with_gaps({"t": times, "mean": values})


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
    names: Mapping[str, Any] = parts[0]
    return {name: np.concatenate([part[name] for part in parts]) for name in names}
