"""Any range of time of a bag, as fine as a screen shows it: bins, messages, or the waveform."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.history import Bins, Layer, part_length
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.picture import IMPACTS, Picture, with_gaps
from rpud_sim.viewer.recording import Recording
from rpud_sim.viewer.signals import STATUS, Signal, is_stranger
from rpud_sim.viewer.waveforms import CHANNELS, Waveform, Waveforms

MESSAGES, WAVEFORM = "messages", "waveform"  # what a near view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the waveform [s]

_MOST_PIECES = 80  # parts of the bag that one view reads
_MOST_BACK = 50  # parts of the bag that are searched for the latest status
_TIMES = ("weight_on_bit_applied", "drive_applied", "feed_applied")


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
        if quantity in IMPACTS:
            return self._overview.impacts[drill].total > 0
        known = quantity in CHANNELS and self._waveforms.has(drill)
        return known or self.signal(drill, quantity) is not None

    def picture(self, drill: str) -> Picture:
        """Return what the overview has of a drill."""
        overview = self._overview

        def name(quantity: str) -> str | None:
            signal = self.signal(drill, quantity)
            return signal.name if signal else None

        samples = len(self._recording.sample) / max(overview.end, 1e-9)
        impacts = overview.impacts[drill]
        return Picture(overview.bins, impacts, name, 0.0, overview.end, overview.known, samples)

    def view(
        self, drill: str, start: float, end: float, width: int, kinds: Mapping[str, str]
    ) -> dict[str, Any]:
        """Return the field ``view`` of a frame with layers of quantities by their kinds."""
        signals = {name: self.signal(drill, name) for name in kinds if name not in IMPACTS}
        wanted = {name: signal for name, signal in signals.items() if signal is not None}
        numbers = self._parts(drill, wanted.values(), start, end)
        if numbers is None:
            return self.picture(drill).view(start, end, width, kinds)
        self._overview.look(numbers)
        layers = self.picture(drill).impact_layers(start, end, width, kinds)
        times, peaks = self._overview.impacts[drill].between(start, end)
        if "peak_force" in layers and len(times) <= width // 2:
            layers["peak_force"] = {"t": times, "mean": peaks}
        for name, signal in wanted.items():
            times, values = self.series(signal, numbers, start, end)
            if len(times) > width:
                bins = Bins([name], part_length(start, end, width // 2), 2 * width, newest=True)
                bins.add(name, times, values)
                layers[name] = with_gaps(bins.view(name, start, end, width))
            else:
                layers[name] = with_gaps({"t": times, "mean": values})
        detail = MESSAGES
        if end - start < 1.001 * WAVEFORM_RANGE:
            waveform = self._waveforms.between(drill, start, end)
            if not len(waveform.times):
                waveform = self._waveforms.recorded(drill, start, end, beyond=1)
            if len(waveform.times):
                detail = WAVEFORM
                struck = "peak_force" in layers and len(layers["peak_force"]["t"]) > 0
                for quantity, channel in CHANNELS.items():
                    silent = channel == "contact_force" and not waveform.channels[channel].any()
                    if silent and struck:
                        continue  # before drilling an impact has no duration, and so no waveform
                    layers[quantity] = _waveform_layer(waveform, channel, width)
        complete = not any(number in self._recording.damages for number in numbers)
        found = {"start": start, "end": end, "detail": detail, "complete": complete}
        return {**found, "band": "least-greatest", "layers": layers}

    def timeline(self, drill: str) -> Layer:
        """Return the field ``timeline`` of a frame: peak force, else the first signal."""
        signals = [each for each in self._signals.values() if each.drill == drill]
        first = next(filter(self.has_values, signals), None)
        signal = self.signal(drill, "peak_force") or first
        end = self._overview.end
        return self.picture(drill).line(signal.name, 0.0, end) if signal else {}

    def moment(self, drill: str, time: float, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return status, values, numbers and hole of a frame at a time [s]."""
        self._overview.look(self._recording.pieces_between(drill, time - 1.0, time))
        picture, values = self.picture(drill), dict[str, dict[str, float]]()
        for signal in self._signals.values():
            if signal.drill == drill and (value := picture.latest(signal.name, time)) is not None:
                values.setdefault(signal.topic.rpartition("/")[2], {})[signal.column] = value
        found = {"status": self.status(drill, time), "values": values}
        found["numbers"] = picture.numbers(time)
        hole = picture.hole(time, parameters)
        return found | ({"hole": hole} if hole else {})

    def series(
        self, signal: Signal, numbers: Sequence[int], start: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of a signal in a range, with the one before and the one after."""
        recording, parts = self._recording, [np.empty((2, 0))]
        for number in numbers:
            if (rows := recording.rows(number).get(signal.topic)) is not None:
                both = recording.elapsed(signal.topic, rows), rows.values[signal.column]
                parts.append(np.array(both)[:, np.isfinite(both[1])])
        times, values = np.concatenate(parts, axis=1)
        order = np.argsort(times, kind="stable")
        first, last = np.searchsorted(times, [start, np.nextafter(end, np.inf)], sorter=order)
        chosen = order[max(first - 1, 0) : last + 1]
        return times[chosen], values[chosen]

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
                        with suppress(AttributeError, TypeError):  # another program wrote it
                            fields[name] = recording.time_of(message, getattr(status, name))
                    return fields
        return {}

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


def thinned(times: np.ndarray, values: np.ndarray, most: int) -> Layer:
    """Return the least and the greatest value of equal parts of the points, at their own times.

    So no peak is lost, and every point is one of those given. ``times`` ascend [s] and ``values``
    have no NaN, both of shape (n,). The result has at most ``most`` points.
    """
    if len(times) <= most:
        return {"t": times, "mean": values}
    edges = np.linspace(0, len(times), max(1, most // 2) + 1).astype(np.intp)
    width = int(np.diff(edges).max())
    places = np.minimum(edges[:-1, None] + np.arange(width), edges[1:, None] - 1)
    parts = values[places]
    rows = np.arange(len(places))
    both = np.column_stack([places[rows, parts.argmin(1)], places[rows, parts.argmax(1)]])
    kept = np.unique(np.concatenate([[0], both.ravel(), [len(times) - 1]]))
    return {"t": times[kept], "mean": values[kept]}


def _is_plain(value: object) -> bool:
    return isinstance(value, bool | int | float | str | np.generic)


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
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}
