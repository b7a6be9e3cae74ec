"""Any range of time of a bag, as fine as a screen shows it: bins, messages, or the waveform."""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.pages.quantities import QUANTITIES
from rpud_sim.viewer.history import Bins, Layer, part_length
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.picture import IMPACTS, TIMES, Picture, with_gaps
from rpud_sim.viewer.recording import Recording
from rpud_sim.viewer.signals import STATUS, Signal, is_stranger
from rpud_sim.viewer.waveforms import CHANNELS, Waveform, Waveforms

MESSAGES, WAVEFORM = "messages", "waveform"  # what a near view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the waveform [s]

_MOST_PIECES = 80  # parts of the bag that one view reads
_MOST_BACK = 50  # parts of the bag that are searched for the latest status


class Views:
    """Open bag: its recording, what was read of it so far, and what a screen shows of it."""

    def __init__(self, path: Path) -> None:
        self.recording = Recording(path)
        try:
            self.overview = Overview(self.recording)
        except BaseException:
            self.recording.close()
            raise
        self.waveforms = Waveforms(self.recording)
        self._signals = {signal.name: signal for signal in self.recording.signals}

    def signal(self, drill: str, quantity: str) -> Signal | None:
        """Return the signal that shows a quantity of a drill; None if there is none with values.

        Beyond the table of quantities, the name of a signal is a quantity.
        """
        if quantity in self._signals:
            return self._signals[quantity]
        for source in QUANTITIES[quantity].sources if quantity in QUANTITIES else ():
            known = [each for each in self._signals.values() if each.source == source]
            found = [each for each in known if each.drill == drill and self.has_values(each)]
            if found:
                return min(found, key=lambda signal: is_stranger(signal.topic))
        return None

    def has_values(self, signal: Signal) -> bool:
        return self.overview.bins.has(signal.name)

    def has(self, drill: str, quantity: str) -> bool:
        """Whether there is anything of a quantity."""
        if quantity in IMPACTS:
            return self.overview.impacts[drill].total > 0
        known = quantity in CHANNELS and self.waveforms.has(drill)
        return known or self.signal(drill, quantity) is not None

    def picture(self, drill: str) -> Picture:
        """Return what the overview has of a drill."""
        overview = self.overview

        def name(quantity: str) -> str | None:
            signal = self.signal(drill, quantity)
            return signal.name if signal else None

        samples = len(self.recording.sample) / max(overview.end, 1e-9)
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
        self.overview.look(numbers)
        layers = self.picture(drill).impact_layers(start, end, width, kinds)
        times, peaks = self.overview.impacts[drill].between(start, end)
        if "peak_force" in layers and len(times) <= width // 2:
            layers["peak_force"] = {"t": times, "mean": peaks}
        for name, signal in wanted.items():
            times, values = self._series(signal, numbers, start, end)
            layer = {"t": times, "mean": values}
            if len(times) > width:
                bins = Bins([name], part_length(start, end, width // 2), 2 * width, newest=True)
                bins.add(name, times, values)
                layer = bins.view(name, start, end, width)
            layers[name] = with_gaps(layer)
        near = self._waveform(drill, start, end)
        if near is not None:
            struck = "peak_force" in layers and len(layers["peak_force"]["t"]) > 0
            for quantity, channel in CHANNELS.items():
                silent = channel == "contact_force" and not near.channels[channel].any()
                if not (silent and struck):  # before drilling an impact has no duration
                    layers[quantity] = _waveform_layer(near, channel, width)
        complete = self.recording.damages.keys().isdisjoint(numbers)
        found = {"start": start, "end": end, "detail": WAVEFORM if near else MESSAGES}
        return {**found, "complete": complete, "band": "least-greatest", "layers": layers}

    def timeline(self, drill: str) -> Layer:
        """Return the field ``timeline`` of a frame: peak force, else the first signal."""
        signals = [each for each in self._signals.values() if each.drill == drill]
        first = next(filter(self.has_values, signals), None)
        signal = self.signal(drill, "peak_force") or first
        return self.picture(drill).line(signal.name, 0.0, self.overview.end) if signal else {}

    def moment(self, drill: str, time: float) -> dict[str, Any]:
        """Return status, values, numbers and hole of a frame at a time [s]."""
        self.overview.look(self.recording.pieces_between(drill, time - 1.0, time))
        picture, values = self.picture(drill), dict[str, dict[str, float]]()
        for signal in self._signals.values():
            if signal.drill == drill and (value := picture.latest(signal.name, time)) is not None:
                values.setdefault(signal.topic.rpartition("/")[2], {})[signal.column] = value
        found = {"status": self._status(drill, time), "values": values}
        found["numbers"] = picture.numbers(time)
        hole = picture.hole(time, self.overview.commands[drill].parameters)
        return found | ({"hole": hole} if hole else {})

    def _series(
        self, signal: Signal, numbers: Sequence[int], start: float, end: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return times and values of a signal in a range, with the one before and the one after."""
        recording, parts = self.recording, [np.empty((2, 0))]
        for number in numbers:
            if (rows := recording.rows(number).get(signal.topic)) is not None:
                both = recording.elapsed(signal.topic, rows), rows.values[signal.column]
                parts.append(np.array(both)[:, np.isfinite(both[1])])
        times, values = np.concatenate(parts, axis=1)
        order = np.argsort(times, kind="stable")
        first, last = np.searchsorted(times, [start, np.nextafter(end, np.inf)], sorter=order)
        chosen = order[max(first - 1, 0) : last + 1]
        return times[chosen], values[chosen]

    def _waveform(self, drill: str, start: float, end: float) -> Waveform | None:
        """Return the samples of a short range; None of a longer one, or without any."""
        if end - start >= 1.001 * WAVEFORM_RANGE:
            return None
        found = self.waveforms.between(drill, start, end)
        if not len(found.times):
            found = self.waveforms.recorded(drill, start, end, beyond=1)
        return found if len(found.times) else None

    def _status(self, drill: str, time: float) -> dict[str, Any]:
        """Return the fields of the last status at a time [s] or before; none before the first."""
        recording = self.recording
        topic = recording.topic(drill, STATUS)
        if not topic or not recording.readers[topic].stamped:
            return {}
        for number in itertools.islice(recording.pieces_from(drill, time, back=True), _MOST_BACK):
            for message, status in reversed(recording.decoded(number, topic)):
                if recording.time_of(message, status.header.stamp) <= time + 1e-9:
                    plain = bool | int | float | str | np.generic
                    fields = {k: v for k, v in vars(status).items() if isinstance(v, plain)}
                    for name in TIMES:
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
            numbers = self.recording.pieces_between(each, start, end)
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


def _waveform_layer(waveform: Waveform, channel: str, most: int) -> Layer:
    """Return a channel with every peak, and NaN where samples are missing."""
    edges = [0, *waveform.cuts, len(waveform.times)]
    times, values = [], []
    for first, last in itertools.pairwise(edges):
        part = thinned(waveform.times[first:last], waveform.channels[channel][first:last], most)
        times += [part["t"], part["t"][-1:]]
        values += [part["mean"], [np.nan]]
    return {"t": np.concatenate(times[:-1]), "mean": np.concatenate(values[:-1])}
