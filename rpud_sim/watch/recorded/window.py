"""Answers to a zoom: the traces of a range of time, as fine as it needs."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.trajectory_pieces import TrajectoryPiece, trajectory_pieces
from rpud_sim.simulation.rebuilding import end_sample, first_sample, sample_between
from rpud_sim.watch.recorded.contents import Layer
from rpud_sim.watch.recorded.overview import Overview
from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.signals import IMPACTS, TRAJECTORY, Signal
from rpud_sim.watch.recorded.trace import EMPTY, Trace, held, thinned, with_gaps

OVERVIEW, MESSAGES, WAVEFORM = "overview", "messages", "waveform"  # what an answer was made of
MESSAGES_RANGE = 10.0  # longest range of time that is drawn from the messages themselves [s]
WAVEFORM_RANGE = 0.05  # longest range of time that is drawn from the rebuilt waveform [s]

# Samples of a rebuilt waveform, before those that no screen can show are left out.
SAMPLES = 100_000
"""Samples of a rebuilt waveform, before those that no screen can show are left out."""

HIGHEST_RATE = 1_000_000_000
"""Greatest rate of a rebuilt waveform [Hz], that of ``rpud export --rate``."""

HIGHEST_RATE = 1_000_000_000  # greatest rate of a rebuilt waveform [Hz], that of ``rpud rebuild``
_MOST_PIECES = 80  # parts of the bag that one answer reads
_PER_PIXEL = 2  # points of a line


@dataclass(frozen=True)
class Request:
    """Range of time to be shown."""

    drill: str  # namespace whose waveform is rebuilt
    start: float  # since the bag began [s]
    end: float  # since the bag began [s]
    width: int  # of the plots [pixels]
    layers: Mapping[tuple[int, int], Layer]  # by plot and number of the layer


@dataclass(frozen=True)
class Answer:
    """Traces of a range of time."""

    request: Request  # that it answers
    detail: str  # ``OVERVIEW``, ``MESSAGES`` or ``WAVEFORM``
    complete: bool  # whether all of the bag in this range was read
    traces: Mapping[tuple[int, int], Trace]  # of the layers, by the keys of the request
    rate: int = 0  # of the rebuilt samples [Hz]; 0 without any


@dataclass(frozen=True)
class Impact:
    """Impact on the drill tool."""

    time: float  # since the bag began [s]
    duration: float  # of its contact [s]
    peak_force: float  # [N]


@dataclass(frozen=True)
class Waveform:
    """Exact samples of the channels of a trajectory."""

    rate: int  # of the samples [Hz]; sample n is n / rate after simulation time zero
    numbers: np.ndarray  # of the samples, shape (n,)
    times: np.ndarray  # since the bag began [s], shape (n,)
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)  # by name, shape (n,)
    cuts: tuple[int, ...] = ()  # places before which samples are missing


class Windows:
    """Answers about one recording; several threads may ask."""

    def __init__(self, recording: Recording, overview: Overview) -> None:
        self._recording = recording
        self._overview = overview
        self._codec = Codec(TRAJECTORY, find_definition(TRAJECTORY))

    def answer(self, request: Request) -> Answer:
        """Return the traces of a range: of the overview, of messages, or of the waveform."""
        numbers: list[int] | None = None
        if request.end - request.start <= MESSAGES_RANGE:
            numbers = self._pieces(request)
        if numbers is None:
            complete = self._overview.progress.complete
            return Answer(request, OVERVIEW, complete, self._overview_traces(request))
        wanted = {layer.signal for layer in request.layers.values() if layer.signal}
        series = self._series(wanted, numbers, request.start, request.end)
        most = _PER_PIXEL * 2 * request.width
        traces = {
            key: _message_trace(layer, *series[layer.signal], request, most)
            for key, layer in request.layers.items()
            if layer.signal
        }
        channels = {key: layer for key, layer in request.layers.items() if layer.channel}
        traces |= dict.fromkeys(channels, EMPTY)
        whole = not any(number in self._recording.damages for number in numbers)
        if not channels or request.end - request.start > WAVEFORM_RANGE:
            return Answer(request, MESSAGES, whole, traces)
        waveform = self.waveform(request.drill, request.start, request.end, numbers=numbers)
        for key, layer in channels.items():
            traces[key] = _waveform_trace(waveform, layer.channel, _PER_PIXEL * request.width)
        if not len(waveform.times):
            return Answer(request, MESSAGES, whole, traces, waveform.rate)
        sampled = [key for key, layer in request.layers.items() if layer.sampled]
        traces |= dict.fromkeys(sampled, EMPTY)
        return Answer(request, WAVEFORM, whole, traces, waveform.rate)

    def waveform(
        self,
        drill: str,
        start: float,
        end: float,
        rate: int | None = None,
        numbers: Sequence[int] | None = None,
    ) -> Waveform:
        """Return the exact samples between two times since the bag began [s].

        ``rate`` is whole [Hz]; None for one that gives about ``SAMPLES``. ``numbers`` are those of
        the parts to read, if they are known.
        """
        if rate is None:
            rate = int(min(max(SAMPLES / max(end - start, 1e-9), 1.0), HIGHEST_RATE))
        topic = self._recording.trajectory(drill)
        if topic is None:
            return _joined([], rate)
        if numbers is None:
            numbers = [*self._recording.pieces_between(drill, start, end)]
        parts = []
        for zero, segments in self._stretches(drill, topic, numbers):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample_between(segments, first, last, rate)
                counted = np.arange(first, last, dtype=np.int64)
                parts.append((counted, counted / rate + zero, vars(samples)))
        return _joined(parts, rate)

    def impact(self, drill: str, time: float, *, back: bool = False) -> Impact | None:
        """Return the first impact after a time since the bag began [s], or the last before it."""
        recording = self._recording
        for number in recording.pieces_from(drill, time, back=back):
            found = []
            for topic, rows in recording.rows(number).items():
                reader = recording.readers[topic]
                if reader.summary.topic.type != IMPACTS or topic.rpartition("/")[0] != drill:
                    continue
                times = recording.elapsed(topic, rows)
                later = np.flatnonzero(times < time if back else times > time)
                if len(later):
                    place = later[times[later].argmax() if back else times[later].argmin()]
                    values = {name: float(each[place]) for name, each in rows.values.items()}
                    found.append(
                        Impact(
                            float(times[place]),
                            values.get("contact_duration", math.nan),
                            values.get("peak_force", math.nan),
                        )
                    )
            if found:
                nearest = max if back else min
                return nearest(found, key=lambda each: each.time)
        return None

    def _pieces(self, request: Request) -> list[int] | None:
        """Return the parts of a range; None for more than one answer reads."""
        found: set[int] = set()
        drills = {layer.signal.drill for layer in request.layers.values() if layer.signal}
        for drill in drills | {request.drill}:
            numbers = self._recording.pieces_between(drill, request.start, request.end)
            found.update(itertools.islice(numbers, _MOST_PIECES + 1))
            if len(found) > _MOST_PIECES:
                return None
        return sorted(found)

    def _overview_traces(self, request: Request) -> dict[tuple[int, int], Trace]:
        view = self._overview.view
        return {
            key: view(layer.signal, request.start, request.end, request.width)
            if layer.signal and not layer.points
            else EMPTY
            for key, layer in request.layers.items()
        }

    def _series(
        self, wanted: set[Signal], numbers: Sequence[int], start: float, end: float
    ) -> dict[Signal, tuple[np.ndarray, np.ndarray]]:
        parts: dict[Signal, list[tuple[np.ndarray, np.ndarray]]] = {each: [] for each in wanted}
        for number in numbers:
            for topic, rows in self._recording.rows(number).items():
                signals = [each for each in wanted if each.topic == topic]
                if not signals:
                    continue
                times = self._recording.elapsed(topic, rows)
                for signal in signals:
                    values = rows.values[signal.column]
                    valid = np.isfinite(values)
                    parts[signal].append((times[valid], values[valid]))
        series = {}
        for signal, found in parts.items():
            none = np.empty(0)
            times = np.concatenate([none, *(each for each, _ in found)])
            values = np.concatenate([none, *(each for _, each in found)])
            order = np.argsort(times, kind="stable")
            times, values = times[order], values[order]
            first = max(int(np.searchsorted(times, start)) - 1, 0)
            last = int(np.searchsorted(times, end, "right")) + 1
            series[signal] = times[first:last], values[first:last]
        return series

    def _stretches(
        self, drill: str, topic: str, numbers: Sequence[int]
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Yield gapless stretches of a trajectory, and when in the bag their time zero was [s]."""
        clock = self._recording.clocks[drill]
        held: list[TrajectoryPiece] = []
        zero = 0.0
        for piece in self._trajectory(topic, numbers):
            begin = (piece.origin - clock.offset(piece.log_time)) / SECOND
            if held and not (piece.follows and begin == zero):
                yield zero, np.concatenate([each.segments for each in held])
                held = []
            held.append(piece)
            zero = begin
        if held:
            yield zero, np.concatenate([each.segments for each in held])

    def _trajectory(self, topic: str, numbers: Sequence[int]) -> Iterator[TrajectoryPiece]:
        for _, adjacent in itertools.groupby(
            enumerate(numbers), lambda each: each[1] - each[0]
        ):  # parts of the bag that follow each other
            messages = [
                message
                for _, number in adjacent
                for message in self._recording.messages(number, (topic,))
            ]
            messages.sort(key=lambda message: message.log_time)
            try:
                yield from trajectory_pieces(messages, self._codec, self._recording.path)
            except BagError:
                continue  # what came before the damage is drawn


def _joined(
    parts: Sequence[tuple[np.ndarray, np.ndarray, Mapping[str, np.ndarray]]], rate: int
) -> Waveform:
    parts = sorted(parts, key=lambda part: float(part[1][0]))
    names = parts[0][2] if parts else ()
    cuts = np.cumsum([len(numbers) for numbers, _, _ in parts])[:-1]
    return Waveform(
        rate,
        np.concatenate([np.empty(0, np.int64), *(numbers for numbers, _, _ in parts)]),
        np.concatenate([np.empty(0), *(times for _, times, _ in parts)]),
        {name: np.concatenate([each[name] for _, _, each in parts]) for name in names},
        tuple(int(cut) for cut in cuts),
    )


def _message_trace(
    layer: Layer, times: np.ndarray, values: np.ndarray, request: Request, most: int
) -> Trace:
    assert layer.signal is not None
    if layer.spread:
        return EMPTY
    if layer.points:
        inside = (times >= request.start) & (times <= request.end)
        return thinned(times[inside], values[inside], most)
    if layer.signal.held:
        return (
            held(*_points(thinned(times, values, most)), end=min(request.end, times[-1] + 1.0))
            if len(times)
            else EMPTY
        )
    return with_gaps(*_points(thinned(times, values, most)))


def _points(trace: Trace) -> tuple[np.ndarray, np.ndarray]:
    return trace.x, trace.y


def _waveform_trace(waveform: Waveform, channel: str, most: int) -> Trace:
    """Return a channel with every peak, and NaN where samples are missing."""
    if not len(waveform.times):
        return EMPTY
    edges = [0, *waveform.cuts, len(waveform.times)]
    traces = [
        thinned(waveform.times[first:last], waveform.channels[channel][first:last], most)
        for first, last in itertools.pairwise(edges)
    ]
    x: list[np.ndarray] = []
    y: list[np.ndarray] = []
    for trace in traces:
        x += [trace.x, trace.x[-1:]]
        y += [trace.y, np.array([np.nan])]
    return Trace(np.concatenate(x[:-1]), np.concatenate(y[:-1]))
