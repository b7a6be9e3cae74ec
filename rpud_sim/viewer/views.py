"""Any range of time of a bag, as fine as a screen shows it: bins, messages, or waveforms."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.quantities import QUANTITIES
from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.rebuild import TrajectoryPiece, trajectory_pieces
from rpud_sim.simulation.sampling import Times, end_sample, first_sample, sample
from rpud_sim.viewer.history import Bins, Layer, part_length
from rpud_sim.viewer.overview import Overview
from rpud_sim.viewer.picture import IMPACTS, MOTION, SECTION, TIMES, Picture, with_gaps
from rpud_sim.viewer.recording import (
    IMPACTS_TYPE,
    STATUS_TYPE,
    TRAJECTORY_TYPE,
    RecordedBag,
    RecordedSignal,
    is_stranger,
)

# Samples of a rebuilt waveform, before those that no screen can show are left out.
SAMPLES = 100_000

HIGHEST_RATE = 1_000_000_000  # greatest rate of a rebuilt waveform [Hz], that of ``rpud export``
SECTION_RATE = 60_000  # of the samples of a section [Hz]

# Channels by the quantities that they show.
CHANNELS = {
    "nodal_plane": "nodal_plane_position",
    "actuator": "actuator_position",
    "free_mass": "free_mass_position",
    "drill_tool": "drill_tool_displacement",
    "contact_force": "contact_force",
    "reacting_force": "reacting_force",
}

MESSAGES, WAVEFORM = "messages", "waveform"  # what a near view is made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the waveform [s]

_MOST_PIECES = 80  # parts of the bag that one view reads
_MOST_BACK = 50  # parts of the bag that are searched for the latest status


class Stretch(NamedTuple):
    """Samples of the waveform without a gap; those of before and after it are missing."""

    times: np.ndarray  # since the bag began, shape (n,), at least one [s]
    channels: Mapping[str, np.ndarray]  # by name, shape (n,)


class Waveforms:
    """Waveforms of one recording."""

    def __init__(self, recording: RecordedBag) -> None:
        self._recording = recording
        self._codec = Codec(TRAJECTORY_TYPE, find_definition(TRAJECTORY_TYPE))

    def has(self, drill: str) -> bool:
        return bool(self._recording.topic(drill, TRAJECTORY_TYPE))

    def between(
        self, drill: str, start: float, end: float, rate: int | None = None
    ) -> list[Stretch]:
        """Return the exact samples between two times since the bag began [s], in their order.

        ``rate`` is whole [Hz]; None for one that gives about ``SAMPLES``.
        """
        if rate is None:
            rate = int(min(max(SAMPLES / max(end - start, 1e-9), 1.0), HIGHEST_RATE))
        found = []
        for zero, segments in self._stretches(drill, start, end):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample(segments, Times.from_grid(first, last - first, rate))
                times = np.arange(first, last, dtype=np.int64) / rate + zero
                found.append(Stretch(times, vars(samples)))
        return sorted(found, key=lambda stretch: float(stretch.times[0]))

    def section(self, drill: str, end: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the motion until a time [s]; None without any.

        It begins after the last gap.
        """
        found = self.between(drill, end - SECTION, end, SECTION_RATE)
        if not found:
            return None
        times, channels = found[-1]
        arrays = {name: channels[CHANNELS[name]].astype(np.float32) for name in MOTION}
        struck, *rest = self.impacts(drill, float(times[0]), end)
        impacts = np.column_stack([struck - times[0], *rest]).tolist()
        return {"period": 1.0 / SECTION_RATE, "time": times[0], "impacts": impacts, **arrays}

    def impacts(self, drill: str, start: float, end: float) -> np.ndarray:
        """Return times [s], peak forces [N] and durations [s] of impacts in a range: (3, n)."""
        recording, topic = self._recording, self._recording.topic(drill, IMPACTS_TYPE)
        found = [np.empty((3, 0))]
        for number in recording.pieces_between(drill, start, end) if topic else ():
            if (rows := recording.rows(number).get(topic)) is not None:
                times = recording.elapsed(topic, rows)
                none = np.full(len(times), np.nan)
                values = [
                    rows.values.get(each, none) for each in ("peak_force", "contact_duration")
                ]
                found.append(np.array([times, *values])[:, (times >= start) & (times <= end)])
        impacts = np.concatenate(found, axis=1)
        return impacts[:, np.argsort(impacts[0])]

    def next_impact(
        self, drill: str, time: float, *, back: bool = False
    ) -> dict[str, float] | None:
        """Return the first impact after a time since the bag began [s], or the last before it."""
        recording, topic = self._recording, self._recording.topic(drill, IMPACTS_TYPE)
        for number in recording.pieces_from(drill, time, back=back):
            if topic in recording.pieces[number].topics:
                found = self.impacts(drill, *(recording.span(drill, number) or (0.0, -1.0)))
                found = found[:, found[0] < time if back else found[0] > time]
                if found.size:
                    names = ("time", "peak_force", "contact_duration")
                    return dict(zip(names, found[:, -1 if back else 0].tolist(), strict=True))
        return None

    def _stretches(
        self, drill: str, start: float, end: float
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Yield gapless stretches of the trajectory, and when in the bag their time zero was [s].

        They cover a range, and begin before it and end after it.
        """
        recording, topic = self._recording, self._recording.topic(drill, TRAJECTORY_TYPE)
        held: list[np.ndarray] = []
        zero = 0.0
        for piece in self._pieces(topic, drill, start, end) if topic else ():
            clock = recording.clocks[drill]
            offset = clock.offset(piece.stamp, piece.published) if clock else recording.begin
            begin = (piece.origin - offset) / SECOND
            if held and not (piece.follows and begin == zero):
                yield zero, np.concatenate(held)
                held = []
            held.append(piece.segments)
            zero = begin
        if held:
            yield zero, np.concatenate(held)

    def _pieces(
        self, topic: str, drill: str, start: float, end: float
    ) -> Iterator[TrajectoryPiece]:
        recording = self._recording
        numbers = enumerate(recording.pieces_between(drill, start, end))
        # Parts of the bag that follow each other.
        for _, adjacent in itertools.groupby(numbers, lambda each: each[1] - each[0]):
            parts = (recording.messages(number, topic) for _, number in adjacent)
            messages = sorted(itertools.chain(*parts), key=lambda message: message.log_time)
            try:
                yield from trajectory_pieces(messages, self._codec, recording.path)
            except BagError:
                continue  # what came before the damage is drawn


class Views:
    """Open bag: its recording, what was read of it so far, and what a screen shows of it."""

    def __init__(self, path: Path) -> None:
        self.recording = RecordedBag(path)
        try:
            self.overview = Overview(self.recording)
        except BaseException:
            self.recording.close()
            raise
        self.waveforms = Waveforms(self.recording)
        self._signals = {signal.name: signal for signal in self.recording.signals}

    def signal(self, drill: str, quantity: str) -> RecordedSignal | None:
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

    def has_values(self, signal: RecordedSignal) -> bool:
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
        exact = end - start < 1.001 * WAVEFORM_RANGE
        near = self.waveforms.between(drill, start, end) if exact else []
        if near:
            struck = "peak_force" in layers and len(layers["peak_force"]["t"]) > 0
            for quantity, channel in CHANNELS.items():
                silent = not any(stretch.channels[channel].any() for stretch in near)
                # Before drilling an impact has no duration.
                if not (channel == "contact_force" and silent and struck):
                    layers[quantity] = _waveform_layer(near, channel, width)
        found = {"start": start, "end": end, "detail": WAVEFORM if near else MESSAGES}
        return {**found, "band": "least-greatest", "layers": layers}

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
        self, signal: RecordedSignal, numbers: Sequence[int], start: float, end: float
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

    def _status(self, drill: str, time: float) -> dict[str, Any]:
        """Return the fields of the last status at a time [s] or before; none before the first."""
        recording = self.recording
        topic = recording.topic(drill, STATUS_TYPE)
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
        self, drill: str, signals: Iterable[RecordedSignal], start: float, end: float
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


def _waveform_layer(stretches: Sequence[Stretch], channel: str, most: int) -> Layer:
    """Return a channel with every peak, and NaN where samples are missing."""
    parts = []
    for times, channels in stretches:
        part = thinned(times, channels[channel], most)
        parts += [part, {"t": part["t"][-1:], "mean": np.full(1, np.nan)}]
    return {name: np.concatenate([part[name] for part in parts[:-1]]) for name in ("t", "mean")}
