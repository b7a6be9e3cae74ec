"""Overview of a whole bag: least and greatest value of each signal in equal parts of the time."""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass

import numpy as np

from rpud_sim.watch.recorded.jump_finder import JumpFinder
from rpud_sim.watch.recorded.recording import Recording
from rpud_sim.watch.recorded.signals import Signal
from rpud_sim.watch.recorded.trace import EMPTY, GAP, Trace, envelope, usual

BINS = 2**18  # greatest number of bins of a signal
MEMORY = 256 * 2**20  # greatest size of the bins of all signals [bytes]

_LEAST_BINS = 2**10
_LEAST_GAP = 0.1  # s
_LEAST_STEPS = 10  # fewer messages have no usual distance
_SPARE = 1.02  # of the time, for what is later than the last log time


@dataclass(frozen=True)
class Progress:
    """How much of a bag the overview has seen."""

    read: int  # parts of the bag that were read in their order
    sampled: int  # further parts that were read before
    total: int  # parts of the bag
    until: float  # time up to which the parts that were read reach [s]

    @property
    def complete(self) -> bool:
        return self.read >= self.total

    @property
    def share(self) -> float:
        """Part of the bag that was read, from 0 to 1; 1 only if all of it was."""
        return 1.0 if self.complete else min((self.read + self.sampled) / self.total, 0.999)


class Overview:
    """Bins of all signals over the whole time of a recording.

    ``sample`` fills them from parts that are spread over the bag, ``read_next`` one part after the
    other. They hold at most ``MEMORY``. A time that exceeds the bins doubles their width.
    """

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._lock = threading.Lock()
        self._signals = {signal: place for place, signal in enumerate(recording.signals)}
        fitting = MEMORY // (16 * max(1, len(self._signals)))
        self._bins = min(BINS, max(_LEAST_BINS, 2 ** int(math.log2(fitting))))
        self._finder = JumpFinder(recording)
        self._sampled: set[int] = set()
        self._read = 0
        self._restarted = False
        self._until = self.end = 0.0
        self._clear()

    @property
    def progress(self) -> Progress:
        with self._lock:
            ahead = sum(1 for number in self._sampled if number >= self._read)
            return Progress(self._read, ahead, len(self._recording.pieces), self._until)

    def sample(self) -> None:
        """Read parts that are spread over the bag."""
        for number in self._recording.sample:
            self._add(number)
            with self._lock:
                self._sampled.add(number)

    def read_next(self) -> bool:
        """Read the next part; return whether there are more."""
        recording = self._recording
        if self._read >= len(recording.pieces):
            return False
        if not self._finder.add(self._read) and not self._restarted:
            # A clock that was set between the sampled parts: all later times change.
            while self._read + 1 < len(recording.pieces):
                self._read += 1
                self._finder.add(self._read)
            for drill, jumps in self._finder.jumps.items():
                recording.set_jumps(drill, jumps)
            self._restarted = True
            with self._lock:
                self._sampled.clear()
                self._read = 0
                self._clear()
            self._finder = JumpFinder(recording)
            return True
        until = self._add(self._read)
        with self._lock:
            self._read += 1
            self._until = max(self._until, until)
        return self._read < len(recording.pieces)

    def view(self, signal: Signal, start: float, end: float, parts: int) -> Trace:
        """Return the envelope of a signal, in about so many parts of a range of time [s].

        Every value between ``start`` and ``end`` in what was read lies within it.
        """
        place = self._signals.get(signal)
        if place is None:
            return EMPTY
        with self._lock:
            first = min(max(math.floor(start / self.width), 0), self._bins)
            last = min(max(math.floor(end / self.width) + 1, first), self._bins)
            least = self._least[place, first:last].copy()
            greatest = self._greatest[place, first:last].copy()
            width = self.width
            known = np.inf if self._read >= len(self._recording.pieces) else self._until
        if not len(least):
            return EMPTY
        # Parts begin at multiples of their length, so that they stay when the view moves.
        joined = max(1, 2 ** int(math.log2(max(1, len(least) // max(1, parts)))))
        starts = np.unique(np.maximum(np.arange(first - first % joined, last, joined), first))
        least = np.minimum.reduceat(least, starts - first)
        greatest = np.maximum.reduceat(greatest, starts - first)
        used = greatest >= least
        times = starts[used] * width
        return envelope(times, least[used], greatest[used], joined * width, known)

    def has(self, signal: Signal) -> bool:
        least, greatest = self.extremes(signal, 0.0, self.end)
        return least <= greatest

    def extremes(self, signal: Signal, start: float, end: float) -> tuple[float, float]:
        """Return the least and the greatest value of the bins of a range; infinite without any."""
        place = self._signals[signal]
        with self._lock:
            first = max(math.floor(start / self.width), 0)
            last = max(math.floor(end / self.width) + 1, first)
            least, greatest = self._least[place, first:last], self._greatest[place, first:last]
            return float(least.min(initial=np.inf)), float(greatest.max(initial=-np.inf))

    def gaps(self) -> list[tuple[float, float]]:
        """Return where no signal has messages for much longer than usual, from and to [s].

        Only a complete overview knows it: of an incomplete one it returns nothing.
        """
        if not self.progress.complete or not self._signals:
            return []
        with self._lock:
            used = np.flatnonzero((self._greatest >= self._least).any(axis=0))
            width = self.width
        steps = np.diff(used)
        if len(steps) < _LEAST_STEPS:
            return []
        longest = max(GAP * usual(steps), _LEAST_GAP / width)
        return [
            ((int(used[place]) + 1) * width, int(used[place + 1]) * width)
            for place in np.flatnonzero(steps > longest)
        ]

    def _clear(self) -> None:
        duration = max(self._recording.duration, 1e-3)
        if self._recording.pieces:
            duration = max(duration, self._recording.end_of(len(self._recording.pieces) - 1))
        self.width = duration * _SPARE / self._bins  # of a bin [s]
        shape = len(self._signals), self._bins
        self._least = np.full(shape, np.inf)
        self._greatest = np.full(shape, -np.inf)
        self._until = 0.0
        self.end = duration

    def _add(self, number: int) -> float:
        """Add the rows of a part; return their greatest time [s]."""
        recording = self._recording
        until = 0.0
        for topic, rows in recording.rows(number).items():
            if not len(rows.stamps):
                continue
            times = recording.elapsed(topic, rows)
            until = max(until, float(times.max()))
            with self._lock:
                while until >= self.width * self._bins:
                    self._double()
                self.end = max(self.end, until)
                bins = np.clip((times / self.width).astype(np.intp), 0, self._bins - 1)
                for signal in recording.readers[topic].signals:
                    values = rows.values[signal.column]
                    valid = np.isfinite(values)
                    place = self._signals[signal]
                    np.minimum.at(self._least[place], bins[valid], values[valid])
                    np.maximum.at(self._greatest[place], bins[valid], values[valid])
        return until

    def _double(self) -> None:
        half = self._bins // 2
        self.width *= 2.0
        for bins, merge, none in (
            (self._least, np.minimum, np.inf),
            (self._greatest, np.maximum, -np.inf),
        ):
            bins[:, :half] = merge(bins[:, ::2], bins[:, 1::2])
            bins[:, half:] = none
