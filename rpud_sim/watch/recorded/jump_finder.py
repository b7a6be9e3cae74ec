"""Finder of all jumps of the clocks in a bag, one part after another."""

from __future__ import annotations

import numpy as np

from rpud_sim.watch.recorded.clock import Jump, find_jumps
from rpud_sim.watch.recorded.recording import Recording


class JumpFinder:
    """Finder of all jumps of the clocks of a recording, part by part from its beginning."""

    def __init__(self, recording: Recording) -> None:
        self._recording = recording
        self._last: dict[str, tuple[int, int]] = {}
        # found so far, by drill
        self.jumps: dict[str, list[Jump]] = {drill: [] for drill in recording.clocks}

    def add(self, number: int) -> bool:
        """Read the next part; return whether the clocks of the recording know its jumps."""
        found = self._recording.rows(number)
        known = True
        for drill, jumps in self.jumps.items():
            stamps, logs = self._recording.series(drill, found)
            if not len(stamps):
                continue
            if drill in self._last:
                before = self._last[drill]
                stamps, logs = np.append(before[0], stamps), np.append(before[1], logs)
            new = find_jumps(stamps, logs)
            known &= self._recording.clocks[drill].knows(new)
            jumps += new
            self._last[drill] = int(stamps[-1]), int(logs[-1])
        return known
