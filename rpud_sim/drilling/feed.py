"""Feed: motion that the drive of the mount is to make."""

from __future__ import annotations

import dataclasses

RATE = "rate"
POSITION = "position"
# Modes, in the order of the MODE constants of ``rpud_msgs/Feed``
FEED_MODES = (RATE, POSITION)


@dataclasses.dataclass(frozen=True)
class Motion:
    """Motion that the drive of the feed is to make, immutable."""

    mode: str  # ``RATE`` or ``POSITION``
    value: float  # rate toward the rock [m/s], or position [m]


STANDSTILL = Motion(RATE, 0.0)
