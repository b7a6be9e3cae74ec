"""Runs in a recording: which messages belong to the last one."""

from __future__ import annotations

import dataclasses
import json
from collections.abc import Sequence

import numpy as np


@dataclasses.dataclass(frozen=True)
class Entry:
    """Entry of the journal, as far as it shows where a run begins."""

    sequence: int  # number of the entry
    kind: str  # of the entry
    stamp: int  # of its message [ns]
    published: int  # that increases in the order of publishing
    time: int  # simulation time [ns]


def entry_time(content: str) -> int:
    """Return the simulation time of a journal entry's content [ns]; 0 if it has none."""
    try:
        time = json.loads(content)["time"]
    except (LookupError, TypeError, ValueError):
        return 0
    return time if type(time) is int else 0


@dataclasses.dataclass(frozen=True)
class LastRun:
    """The last run of a recording."""

    runs: int = 0  # number of runs; 0 without a journal
    origin: int | None = None  # stamp of its simulation time zero [ns]; None without a journal
    published: int = 0  # of the entry that begins it
    stamp: int = 0  # of that entry [ns]
    before: Entry | None = None  # the entry before that; None if there is none

    def holds(self, stamps: np.ndarray, published: np.ndarray) -> np.ndarray:
        """Return which messages belong to the run.

        Messages shortly before the entry may belong to it as well, since topics are published one
        after the other: their stamps decide.
        """
        if self.origin is None:
            return np.ones(len(stamps), bool)
        after = published >= self.published
        if self.before is None:  # the first run: a message may overtake the journal
            return after | (stamps >= self.stamp)
        between = ~after & (published > self.before.published) & (stamps >= self.stamp)
        if self.before.stamp > self.stamp:
            between &= stamps < self.before.stamp
        elif self.before.stamp == self.stamp:
            between[:] = False
        return after | between


def last_run(entries: Sequence[Entry]) -> LastRun:
    """Return the last run that a journal shows.

    A run begins with an entry ``begin``, or with an ``origin`` that sets the stamps back. Entries
    of a beginning follow each other at one simulation time.
    """
    once = {(entry.sequence, entry.kind, entry.stamp, entry.time): entry for entry in entries[::-1]}
    numbers = [entry.sequence for entry in once.values()]
    if len(set(numbers)) == len(numbers):  # of one node: its numbers are the order
        ordered = sorted(once.values(), key=lambda entry: entry.sequence)
    else:
        ordered = sorted(once.values(), key=lambda entry: (entry.published, entry.sequence))
    found = LastRun()
    for number, entry in enumerate(ordered):
        if entry.kind not in ("begin", "origin"):
            continue
        before = ordered[number - 1] if number else None
        # Before a beginning's entry `origin`, nothing was simulated since its entry `begin`.
        joins = before is not None and before.kind == "begin" and before.time == entry.time
        back = before is None or entry.stamp < before.stamp
        origin = entry.stamp - entry.time
        if entry.kind == "origin" and joins and found.runs:
            found = dataclasses.replace(
                found, origin=origin, published=entry.published, stamp=entry.stamp
            )
        elif entry.kind == "begin" or back:
            found = LastRun(found.runs + 1, origin, entry.published, entry.stamp, before)
    return found
