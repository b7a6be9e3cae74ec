"""Jumps and beginning of a drill's clock, from the stamps of its messages."""

from __future__ import annotations

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.recorded_drill import Jump

_BACK = SECOND  # step back of a clock that lateness does not explain [ns]
_AHEAD = 60 * SECOND  # step ahead of a clock that passed time does not explain [ns]

# Stamps and log times of messages in the order of their log times, each of shape (n,) [ns].
Series = tuple[np.ndarray, np.ndarray]


def find_jumps(stamps: np.ndarray, log_times: np.ndarray) -> list[Jump]:
    """Return the jumps in a series of messages, in the order of log times; shapes (n,), [ns]."""
    steps, passed = np.diff(stamps), np.maximum(np.diff(log_times), 0)
    return [
        Jump(int(log_times[place + 1]), int(steps[place] - passed[place]))
        for place in np.flatnonzero((steps < -_BACK) | (steps - passed > _AHEAD)).tolist()
    ]


def zero_stamp(stamps: np.ndarray, log_times: np.ndarray, begin: int) -> int:
    """Return the stamp of a clock at the bag's beginning [ns], from a topic's first message.

    ``stamps`` and ``log_times`` have the shape (n,) [ns]; ``begin`` is a log time [ns].
    """
    others = np.flatnonzero(log_times != log_times[0])
    last = int(others[0]) - 1 if len(others) else -1  # a block is logged after its last row
    return int(stamps[last]) - (int(log_times[0]) - begin)
