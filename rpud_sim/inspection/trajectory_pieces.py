"""Pieces of a trajectory from the messages of a bag: runs, gaps and segments."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from rpud_sim.bag import BagFormatError, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.foundation.time import join_seconds
from rpud_sim.simulation.rebuilding import to_segments

# Rounding of the times of consecutive segments [s]; at a reset, time steps back further.
_ROUNDING = 1e-6


@dataclass(frozen=True)
class TrajectoryPiece:
    """Segments of one message."""

    run: int  # number of the simulation, from 1; a reset begins the next one
    follows: bool  # whether they follow those of the piece before without a gap
    origin: int  # stamp of simulation time zero [ns]
    segments: np.ndarray  # ``SEGMENT`` records; at least one
    log_time: int  # of the message [ns]


def trajectory_pieces(
    messages: Iterable[Message], codec: Codec, path: object
) -> Iterator[TrajectoryPiece]:
    """Yield the pieces of a trajectory, one for each message with segments, from any one on."""
    run, following, end = 0, -1, 0.0
    for recorded in messages:
        message = codec.decode(recorded.data)
        try:
            segments = to_segments(message)
        except ValueError as error:
            raise BagFormatError(f"{path}: a trajectory is damaged: {error}") from None
        if not len(segments):
            continue
        start = int(segments["start_seconds"][0]) + float(segments["start_fraction"][0])
        if message.sequence < following or start < end - _ROUNDING or not run:
            run += 1
            following = -1
        origin = join_seconds(message.origin.sec, message.origin.nanosec)
        follows = message.sequence == following
        yield TrajectoryPiece(run, follows, origin, segments, recorded.log_time)
        following = message.sequence + len(segments)
        last = segments[-1]
        end = int(last["start_seconds"]) + float(last["start_fraction"] + last["duration"])
