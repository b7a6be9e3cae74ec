"""Times since a bag began, from the stamps of messages and the runs of a drill."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.recorded.runs import RecordedRun


class Rows(NamedTuple):
    """Messages of one topic in a part of a bag."""

    log_times: np.ndarray  # shape (n,) [ns]
    publish_times: np.ndarray  # shape (n,) [ns]
    stamps: np.ndarray  # shape (n,) [ns]; the log times of messages without stamps
    # of each signal, by column, shape (n,); NaN where a value cannot be drawn
    values: dict[str, np.ndarray]

    def since(self, place: int | np.intp) -> Rows:
        """Return the messages from a place on."""
        values = {name: each[place:] for name, each in self.values.items()}
        logs, published, stamps = (each[place:] for each in self[:3])
        return Rows(logs, published, stamps, values)


class StampTimes:
    """Times since a bag began of a drill's stamps: a run begins where the one before ended.

    Time is simulation time, which stops during a pause. ``first`` is the first message.
    """

    def __init__(self, runs: Sequence[RecordedRun], first: Rows, begin: int) -> None:
        stamp, published = int(first.stamps[0]), int(first.publish_times[0])
        late = int(first.log_times[0]) - begin  # a drill may begin after its bag
        if (start := runs[0].window[0]) > published:  # of a run whose beginning the bag lacks
            unknown = RecordedRun(runs[0].path, runs[0].journal, first_origin=stamp)
            runs = [replace(unknown, window=(0, start - 1), end=start - published), *runs]
        self.runs = [run for run in runs if run.window[1] >= published]
        self._starts = [run.window[0] for run in self.runs[1:]]
        self.shifts: list[int] = []  # from the time of each run to that of the bag [ns]
        begun = stamp - int(self.runs[0].origins(np.array([published]))[0])
        end = late if late > SECOND else 0
        for run in self.runs:
            self.shifts.append(end - begun)
            end += max(run.end - begun, 0)
            begun = 0
        # A forged origin is an OverflowError.
        self.offsets(np.array([e.publish_time for run in self.runs for e in run.entries], np.int64))

    def number(self, published: int) -> int:
        """Return the number of the run of a message by its publishing time [ns], from 0."""
        return int(np.searchsorted(self._starts, published, "right"))

    def offsets(self, published: np.ndarray) -> np.ndarray:
        """Return stamps of time zero that messages have by their publishing times [ns], (n,)."""
        numbers = np.searchsorted(self._starts, published, "right")
        found = np.empty(len(published), np.int64)
        for number in range(numbers.min(), numbers.max() + 1) if len(numbers) else ():
            chosen = numbers == number
            found[chosen] = self.runs[number].origins(published[chosen]) - self.shifts[number]
        return found

    def offset(self, published: int) -> int:
        """Return the stamp of time zero that one message has [ns]."""
        return int(self.offsets(np.array([published]))[0])
