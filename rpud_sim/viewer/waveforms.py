"""Waveforms of any part of a bag, rebuilt from the trajectory or as recorded, and sections."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.rebuild import TrajectoryPiece, trajectory_pieces
from rpud_sim.simulation.rebuilding import end_sample, first_sample, sample_between
from rpud_sim.viewer.picture import MOTION, SECTION
from rpud_sim.viewer.recording import Recording
from rpud_sim.viewer.signals import IMPACTS, TRAJECTORY, WAVEFORM

# Samples of a rebuilt waveform, before those that no screen can show are left out.
SAMPLES = 100_000

HIGHEST_RATE = 1_000_000_000  # greatest rate of a rebuilt waveform [Hz], that of ``rpud export``
SECTION_RATE = 60_000  # of its samples [Hz]

# Channels by the quantities that they show.
CHANNELS = {
    "nodal_plane": "nodal_plane_position",
    "actuator": "actuator_position",
    "free_mass": "free_mass_position",
    "drill_tool": "drill_tool_displacement",
    "contact_force": "contact_force",
    "reacting_force": "reacting_force",
}


@dataclass(frozen=True)
class Waveform:
    """Samples of all channels."""

    rate: int  # of the samples [Hz]
    numbers: np.ndarray  # of the samples since simulation time zero, shape (n,)
    times: np.ndarray  # since the bag began [s], shape (n,)
    channels: Mapping[str, np.ndarray] = field(default_factory=dict)  # by name, shape (n,)

    @property
    def cuts(self) -> list[int]:
        """Places before which samples are missing, or another run begins."""
        return (np.flatnonzero(np.diff(self.numbers) != 1) + 1).tolist()


class Waveforms:
    """Waveforms of one recording."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._codec = Codec(TRAJECTORY, find_definition(TRAJECTORY))

    def has(self, drill: str) -> bool:
        """Whether the waveform of a drill can be rebuilt, or was recorded."""
        return any(self._recording.topic(drill, kind) for kind in (TRAJECTORY, WAVEFORM))

    def between(self, drill: str, start: float, end: float, rate: int | None = None) -> Waveform:
        """Return the exact samples between two times since the bag began [s].

        ``rate`` is whole [Hz]; None for one that gives about ``SAMPLES``.
        """
        if rate is None:
            rate = int(min(max(SAMPLES / max(end - start, 1e-9), 1.0), HIGHEST_RATE))
        parts = []
        for zero, segments in self._stretches(drill, start, end):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample_between(segments, first, last, rate)
                counted = np.arange(first, last, dtype=np.int64)
                parts.append((counted, counted / rate + zero, vars(samples)))
        return _joined(parts, rate)

    def section(self, drill: str, end: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the motion until a time [s]; None without any.

        It is rebuilt from the trajectory. Without one it has the samples of the waveform's topic.
        """
        waveform = self.between(drill, end - SECTION, end, SECTION_RATE)
        exact = len(waveform.times) > 0
        if not exact:
            waveform = self.recorded(drill, end - SECTION, end)
        if not len(waveform.times):
            return None
        # Of two runs it is the later one; what is missing is NaN.
        newest = int(np.flatnonzero(np.diff(waveform.numbers, prepend=0) <= 0)[-1:].sum())
        numbers = waveform.numbers[newest:] - waveform.numbers[newest]
        step = -(-int(numbers[-1] + 1) // round(SECTION * SECTION_RATE + 1))
        found: dict[str, Any] = {"exact": exact, "period": step / waveform.rate}
        found["time"] = time = float(waveform.times[newest])
        for name in MOTION:
            values = np.full(int(numbers[-1]) + 1, np.nan, np.float32)
            values[numbers] = waveform.channels[CHANNELS[name]][newest:]
            found[name] = values[::step]
        impacts = self.impacts(drill, time, end)
        rows = impacts["time"] - time, impacts["peak_force"], impacts["contact_duration"]
        return found | {"impacts": np.column_stack(rows).tolist()}

    def impacts(self, drill: str, start: float, end: float) -> dict[str, np.ndarray]:
        """Return ``time``, ``peak_force`` and ``contact_duration`` of impacts in a range."""
        recording = self._recording
        names, topic = ("peak_force", "contact_duration"), recording.topic(drill, IMPACTS)
        found = []
        for number in recording.pieces_between(drill, start, end) if topic else ():
            if (rows := recording.rows(number).get(topic)) is not None:
                times = recording.elapsed(topic, rows)
                inside = (times >= start) & (times <= end)
                values = [rows.values.get(name, np.full(len(times), np.nan)) for name in names]
                found.append(np.array([times, *values])[:, inside])
        rows_ = np.concatenate([np.empty((3, 0)), *found], axis=1)
        return dict(zip(("time", *names), rows_[:, np.argsort(rows_[0])], strict=True))

    def next_impact(
        self, drill: str, time: float, *, back: bool = False
    ) -> dict[str, float] | None:
        """Return the first impact after a time since the bag began [s], or the last before it."""
        recording = self._recording
        for number in recording.pieces_from(drill, time, back=back):
            if recording.topic(drill, IMPACTS) not in recording.pieces[number].topics:
                continue
            begin, end = recording.span(drill, number) or (0.0, -1.0)
            found = self.impacts(drill, begin, end)
            later = np.flatnonzero(found["time"] < time if back else found["time"] > time)
            if len(later):
                place = later[-1 if back else 0]
                return {name: float(values[place]) for name, values in found.items()}
        return None

    def recorded(self, drill: str, start: float, end: float, beyond: int = 0) -> Waveform:
        """Return the samples of the waveform's topic between two times [s], and some beyond."""
        recording, topic = self._recording, self._recording.topic(drill, WAVEFORM)
        parts, rate = [], SECTION_RATE
        for number in recording.pieces_between(drill, start, end) if topic else ():
            for message, block in recording.decoded(number, topic):
                try:
                    channels = {
                        name: np.asarray(getattr(block, name), float) for name in CHANNELS.values()
                    }
                    period, sequence = float(block.sample_period), int(block.sequence)
                    begin = recording.time_of(message, block.header.stamp)
                except (AttributeError, TypeError, ValueError):
                    continue  # another program wrote it
                length = len(channels["contact_force"])
                alike = all(values.shape == (length,) for values in channels.values())
                if not (alike and 1e-9 <= period <= SECTION):
                    continue
                rate = round(1.0 / period)
                times = begin + np.arange(length) * period
                inside = (times >= start - beyond * period) & (times <= end + beyond * period)
                if inside.any():
                    channels = {name: values[inside] for name, values in channels.items()}
                    numbers = (sequence % 2**62) + np.flatnonzero(inside)
                    parts.append((numbers, times[inside], channels))
        return _joined(parts, rate)

    def _stretches(
        self, drill: str, start: float, end: float
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Yield gapless stretches of the trajectory, and when in the bag their time zero was [s].

        They cover a range, and begin before it and end after it.
        """
        recording, topic = self._recording, self._recording.topic(drill, TRAJECTORY)
        if not topic:
            return
        clock, zero = recording.clocks[drill], 0.0
        held: list[TrajectoryPiece] = []
        for piece in self._trajectory(topic, [*recording.pieces_between(drill, start, end)]):
            begin = (piece.origin - clock.offset(piece.log_time)) / SECOND
            if held and not (piece.follows and begin == zero):
                yield zero, np.concatenate([each.segments for each in held])
                held = []
            held.append(piece)
            zero = begin
        if held:
            yield zero, np.concatenate([each.segments for each in held])

    def _trajectory(self, topic: str, numbers: Sequence[int]) -> Iterator[TrajectoryPiece]:
        recording = self._recording
        # Parts of the bag that follow each other.
        for _, adjacent in itertools.groupby(enumerate(numbers), lambda each: each[1] - each[0]):
            messages = [
                message
                for _, number in adjacent
                for message in recording.messages(number, (topic,))
            ]
            messages.sort(key=lambda message: message.log_time)
            try:
                yield from trajectory_pieces(messages, self._codec, recording.path)
            except BagError:
                continue  # what came before the damage is drawn


def _joined(
    parts: Sequence[tuple[np.ndarray, np.ndarray, Mapping[str, np.ndarray]]], rate: int
) -> Waveform:
    parts = sorted(parts, key=lambda part: float(part[1][0]))
    names = parts[0][2] if parts else ()
    return Waveform(
        rate,
        np.concatenate([np.empty(0, np.int64), *(numbers for numbers, _, _ in parts)]),
        np.concatenate([np.empty(0), *(times for _, times, _ in parts)]),
        {name: np.concatenate([each[name] for _, _, each in parts]) for name in names},
    )
