"""Stamps of a drill as times of its simulation, by the origins that its journal tells."""

from __future__ import annotations

from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND

GREATEST = 2**61  # size of a time with which all calculations fit int64 [ns]


class RunClock:
    """Times since the stamp ``zero``, of any stamps [ns].

    Time is that of the simulation: it stands during a pause. A run begins when the one before ends.
    """

    def __init__(self, zero: int) -> None:
        zero = zero if abs(zero) <= GREATEST else 0  # another program wrote it
        self.zero = zero  # stamp of time zero, until there is an entry [ns]
        self.origin: int | None = None  # stamp of simulation time zero, by the latest entry [ns]
        # Spans between which stamps may go back. Each has the publishing time from which on it
        # counts, and ascending stamps from which on each of its offsets does [ns].
        self._spans: list[tuple[int, list[int], list[int]]] = [(-GREATEST, [zero], [zero])]
        self._shift = 0  # of these times to those of the simulation in the present run [ns]
        self._end = 0  # time of the latest entry [ns]
        self._restored = False  # whether the next entry is the first of a run

    def add(self, kind: str, stamp: int, time: Any, published: int = 0) -> bool:
        """Take in an entry of the journal, in order; return whether time goes on otherwise now.

        It has a simulation time and a publishing time [ns].
        """
        if not isinstance(time, int) or abs(time) > GREATEST:  # another program wrote it
            return False
        begins = (kind == "begin" or self._restored) and self.origin is not None
        self._restored, origin = kind == "restore", stamp - time
        if origin == self.origin and not begins:
            self._end = time + self._shift
            return False
        _, stamps, offsets = self._spans[-1]
        if self.origin is None:
            self._shift = origin - offsets[-1]
        elif begins:
            self._shift = self._end - time
        offset = origin - self._shift
        if abs(offset) > GREATEST:
            return False
        # Time may be reset to the same stamp again.
        if begins or stamp < stamps[-1] or (stamp == stamps[-1] and offset != offsets[-1]):
            self._spans.append((published, [stamp], [offset]))
        elif offset != offsets[-1]:
            stamps.append(stamp)
            offsets.append(offset)
        changed = self.origin is not None
        self.origin, self._end = origin, time + self._shift
        return changed

    def run(self, published: int) -> int:
        """Return a number that messages of one run share, by their publishing time [ns]."""
        return sum(begin <= published for begin, *_ in self._spans)

    def offsets(self, stamps: np.ndarray, published: np.ndarray) -> np.ndarray:
        """Return the stamps of time zero that messages have; all (n,), int64 [ns]."""
        spans = np.searchsorted([begin for begin, *_ in self._spans[1:]], published, "right")
        found = np.empty(len(stamps), np.int64)
        for number in np.unique(spans):
            chosen, (_, edges, offsets) = spans == number, self._spans[number]
            places = np.searchsorted(edges, stamps[chosen], "right") - 1
            found[chosen] = np.array(offsets)[np.maximum(places, 0)]
        return found

    def elapsed(self, stamps: np.ndarray, published: np.ndarray) -> np.ndarray:
        """Return the times of messages by their stamps and publishing times [ns]; all (n,) [s]."""
        return (stamps - self.offsets(stamps, published)) / SECOND

    def offset(self, stamp: int, published: int = GREATEST) -> int:
        """Return the stamp of time zero that one message has [ns]."""
        return int(self.offsets(np.array([stamp]), np.array([published]))[0])

    def seconds(self, stamp: int, published: int = GREATEST) -> float:
        """Return the time of one stamp [s]."""
        return (stamp - self.offset(stamp, published)) / SECOND
