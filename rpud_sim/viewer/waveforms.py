"""Waveforms of any part of a bag, rebuilt from the trajectory or as recorded, and sections."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.rebuild import TrajectoryPiece, trajectory_pieces
from rpud_sim.simulation.sampling import end_sample, first_sample, sample_between
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

_Samples = tuple[np.ndarray, np.ndarray, Mapping[str, np.ndarray]]  # numbers, times, channels


@dataclass(frozen=True)
class Waveform:
    """Samples of all channels."""

    rate: int  # of the samples [Hz]
    numbers: np.ndarray  # of the samples since simulation time zero, shape (n,)
    times: np.ndarray  # since the bag began [s], shape (n,)
    channels: Mapping[str, np.ndarray]  # by name, shape (n,); none without a sample

    @classmethod
    def of(cls, parts: Sequence[_Samples], rate: int) -> Waveform:
        """Return parts in the order of their times."""
        parts = sorted(parts, key=lambda part: float(part[1][0]))
        numbers = np.concatenate([np.empty(0, np.int64), *(part[0] for part in parts)])
        times = np.concatenate([np.empty(0), *(part[1] for part in parts)])
        names = parts[0][2] if parts else ()
        channels = {name: np.concatenate([part[2][name] for part in parts]) for name in names}
        return cls(rate, numbers, times, channels)

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
        parts: list[_Samples] = []
        for zero, segments in self._stretches(drill, start, end):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample_between(segments, first, last, rate)
                counted = np.arange(first, last, dtype=np.int64)
                parts.append((counted, counted / rate + zero, vars(samples)))
        return Waveform.of(parts, rate)

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
        time = float(waveform.times[newest])
        found: dict[str, Any] = {"exact": exact, "period": step / waveform.rate, "time": time}
        for name in MOTION:
            values = np.full(int(numbers[-1]) + 1, np.nan, np.float32)
            values[numbers] = waveform.channels[CHANNELS[name]][newest:]
            found[name] = values[::step]
        times, *rest = self.impacts(drill, time, end)
        return found | {"impacts": np.column_stack([times - time, *rest]).tolist()}

    def impacts(self, drill: str, start: float, end: float) -> np.ndarray:
        """Return times [s], peak forces [N] and durations [s] of impacts in a range: (3, n)."""
        recording, topic = self._recording, self._recording.topic(drill, IMPACTS)
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
        recording, topic = self._recording, self._recording.topic(drill, IMPACTS)
        for number in recording.pieces_from(drill, time, back=back):
            if topic in recording.pieces[number].topics:
                found = self.impacts(drill, *(recording.span(drill, number) or (0.0, -1.0)))
                found = found[:, found[0] < time if back else found[0] > time]
                if found.size:
                    names = ("time", "peak_force", "contact_duration")
                    return dict(zip(names, found[:, -1 if back else 0].tolist(), strict=True))
        return None

    def recorded(self, drill: str, start: float, end: float, beyond: int = 0) -> Waveform:
        """Return the samples of the waveform's topic between two times [s], and some beyond."""
        recording, topic = self._recording, self._recording.topic(drill, WAVEFORM)
        parts: list[_Samples] = []
        rate = SECTION_RATE
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
        return Waveform.of(parts, rate)

    def _stretches(
        self, drill: str, start: float, end: float
    ) -> Iterator[tuple[float, np.ndarray]]:
        """Yield gapless stretches of the trajectory, and when in the bag their time zero was [s].

        They cover a range, and begin before it and end after it.
        """
        recording, topic = self._recording, self._recording.topic(drill, TRAJECTORY)
        held: list[np.ndarray] = []
        zero = 0.0
        for piece in self._pieces(topic, drill, start, end) if topic else ():
            offset = recording.clocks[drill].offset(piece.log_time)
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
