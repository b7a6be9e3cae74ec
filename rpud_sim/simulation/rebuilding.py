"""Samples at any rate from the trajectory in a bag's messages."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np

from rpud_sim.model.segment import CONSTANTS, SEGMENT
from rpud_sim.simulation.fields import SEGMENT_ARRAYS
from rpud_sim.simulation.sampling import Samples, Times, sample

# Samples that are computed at once.
_MOST = 100_000


def to_segments(message: Any) -> np.ndarray:
    """Return the ``SEGMENT`` records that a ``rpud_msgs/Trajectory`` was made of, bit for bit.

    Raises:
        ValueError: if its arrays are not equally long.
    """
    count = len(message.duration)
    segments = np.zeros(count, SEGMENT)
    for name in SEGMENT_ARRAYS:
        values = getattr(message, name)
        if len(values) != count:
            raise ValueError(f"{name} has {len(values)} values, and duration {count}")
        segments[name] = values
    for name in CONSTANTS:
        segments[name] = getattr(message, name)
    return segments


def first_sample(segment: np.void, rate: int) -> int:
    """Number of the first sample at or after a segment's start, at a whole rate [Hz]."""
    return int(segment["start_seconds"]) * rate + math.ceil(float(segment["start_fraction"]) * rate)


def end_sample(segment: np.void, rate: int) -> int:
    """Number of the first sample at or after a segment's end, at a whole rate [Hz]."""
    end = float(segment["start_fraction"]) + float(segment["duration"])
    return int(segment["start_seconds"]) * rate + math.ceil(end * rate)


def sample_between(segments: np.ndarray, first: int, end: int, rate: int) -> Samples:
    """Return samples ``first`` to ``end - 1`` of consecutive segments, those of ``Rebuilder``.

    Args:
        segments: without a gap; they cover the samples.
        end: number of the first one that does not count.
    """
    return sample(segments, Times.from_grid(first, max(0, end - first), rate))


class Rebuilder:
    """Sampler of consecutive pieces of a trajectory.

    A piece is sampled up to the start of its last segment. The next piece shows where that ends.

    Args:
        rate: a whole rate [Hz]; sample number n is n / rate after simulation time zero.
    """

    def __init__(self, rate: int) -> None:
        self._rate = rate
        self._held = np.zeros(0, SEGMENT)
        self._next: int | None = None

    def add(self, segments: np.ndarray) -> Iterator[tuple[int, Samples]]:
        """Yield samples up to the last segment of the next piece, with the first one's number."""
        if not len(segments):
            return
        covering = np.concatenate([self._held, segments])
        if self._next is None:
            self._next = first_sample(covering[0], self._rate)
        yield from self._sample(covering, first_sample(covering[-1], self._rate))
        # One segment more than needed, because a number that is rounded up may be before a start.
        self._held = covering[-2:]

    def finish(self) -> Iterator[tuple[int, Samples]]:
        """Yield the samples of the last segment, with the first one's number."""
        if len(self._held):
            yield from self._sample(self._held, end_sample(self._held[-1], self._rate))
        self._held = self._held[:0]
        self._next = None

    def _sample(self, covering: np.ndarray, end: int) -> Iterator[tuple[int, Samples]]:
        first = self._next or 0
        while first < end:
            count = min(end - first, _MOST)
            yield first, sample(covering, Times.from_grid(first, count, self._rate))
            first += count
        self._next = first
