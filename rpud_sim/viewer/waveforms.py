"""Waveforms of a drill in a bag, rebuilt from its trajectory, and the impacts in them."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping
from typing import Any, NamedTuple

import numpy as np

from rpud_sim.bag import BagError
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import to_float32
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.recorded.rebuild import RecordedSegments, recorded_segments
from rpud_sim.simulation.sampling import Times, end_sample, first_sample, sample
from rpud_sim.viewer.history import IMPACTS_TYPE, MOTION, SECTION
from rpud_sim.viewer.recording import TRAJECTORY_TYPE, RecordedBag

# Samples of a rebuilt waveform, before those that no screen can show are left out.
SAMPLES = 100_000

HIGHEST_RATE = 1_000_000_000  # greatest rate of a rebuilt waveform [Hz], as in ``rpud export``
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


class Waveform(NamedTuple):
    """Samples of the waveform without a gap; samples before and after it are missing."""

    times: np.ndarray  # since the bag began, shape (n,), at least one [s]
    channels: Mapping[str, np.ndarray]  # by name, shape (n,)


class Waveforms:
    """Waveforms of one drill in a bag, and the impacts in them."""

    def __init__(self, recording: RecordedBag, drill: str) -> None:
        self._recording, self._drill = recording, drill
        self._topic = recording.topic(drill, TRAJECTORY_TYPE)
        self._impacts = recording.topic(drill, IMPACTS_TYPE)
        self._codec = installed_codec(TRAJECTORY_TYPE)

    def __bool__(self) -> bool:
        """Whether there are any."""
        return bool(self._topic)

    def between(self, start: float, end: float, rate: int | None = None) -> list[Waveform]:
        """Return the exact samples between two times since the bag began [s], in their order.

        ``rate`` is whole [Hz]; None for one that gives about ``SAMPLES``.
        """
        if rate is None:
            rate = int(min(max(SAMPLES / max(end - start, 1e-9), 1.0), HIGHEST_RATE))
        found = []
        for zero, segments in self._gapless(start, end):
            first = max(math.ceil((start - zero) * rate), first_sample(segments[0], rate))
            last = min(math.floor((end - zero) * rate) + 1, end_sample(segments[-1], rate))
            if last > first:
                samples = sample(segments, Times.from_grid(first, last - first, rate))
                times = np.arange(first, last, dtype=np.int64) / rate + zero
                found.append(Waveform(times, vars(samples)))
        return sorted(found, key=lambda waveform: float(waveform.times[0]))

    def section(self, end: float) -> dict[str, Any] | None:
        """Return the field ``section`` of a frame: the motion until a time [s]; None without any.

        It begins after the last gap.
        """
        found = self.between(end - SECTION, end, SECTION_RATE)
        if not found:
            return None
        times, channels = found[-1]
        arrays = {name: to_float32(channels[CHANNELS[name]]) for name in MOTION}
        struck, *rest = self.impacts(float(times[0]), end)
        impacts = np.column_stack([struck - times[0], *rest]).tolist()
        return {"period": 1.0 / SECTION_RATE, "time": times[0], "impacts": impacts, **arrays}

    def impacts(self, start: float, end: float) -> np.ndarray:
        """Return times [s], peak forces [N] and durations [s] of impacts in a range: (3, n)."""
        numbers = self._recording.chunks_between(self._drill, start, end)
        columns = ("peak_force", "contact_duration")
        found = self._recording.series(self._impacts, columns, numbers)
        return found[:, (found[0] >= start) & (found[0] <= end)]

    def next_impact(self, time: float, *, back: bool = False) -> dict[str, float] | None:
        """Return the first impact after a time since the bag began [s], or the last before it."""
        recording = self._recording
        for number in recording.chunks_from(self._drill, time, back=back):
            if self._impacts in recording.chunks[number].topics:
                found = self.impacts(*(recording.span(self._drill, number) or (0.0, -1.0)))
                found = found[:, found[0] < time if back else found[0] > time]
                if found.size:
                    names = ("time", "peak_force", "contact_duration")
                    return dict(zip(names, found[:, -1 if back else 0].tolist(), strict=True))
        return None

    def _gapless(self, start: float, end: float) -> Iterator[tuple[float, np.ndarray]]:
        """Yield parts of the trajectory without a gap, and when in the bag their time zero was [s].

        They cover a range, and begin before it and end after it.
        """
        held: list[np.ndarray] = []
        zero = 0.0
        for each in self._segments(start, end) if self._topic else ():
            begin = (each.origin - each.zero) / SECOND
            if held and not (each.follows and begin == zero):
                yield zero, np.concatenate(held)
                held = []
            held.append(each.segments)
            zero = begin
        if held:
            yield zero, np.concatenate(held)

    def _segments(self, start: float, end: float) -> Iterator[RecordedSegments]:
        recording = self._recording
        numbers = enumerate(recording.chunks_between(self._drill, start, end))
        # Chunks that follow each other.
        for _, adjacent in itertools.groupby(numbers, lambda each: each[1] - each[0]):
            batches = recording.batches([number for _, number in adjacent], {self._topic})
            try:
                yield from recorded_segments(batches, self._codec, recording.path)
            except BagError:
                continue  # what came before the damage is drawn
