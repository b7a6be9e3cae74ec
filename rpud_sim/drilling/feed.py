"""Feed: motion that the drive of the mount is to make."""

from __future__ import annotations

import dataclasses

from rpud_sim.foundation.quantities import ParameterError, Quantity, shown, suggestion

RATE = "rate"
POSITION = "position"
# Modes, in the order of the MODE constants of ``rpud_msgs/Feed``
FEED_MODES = (RATE, POSITION)

FEED_RATE = Quantity("m/s", "rate of the feed toward the rock", -1.0, 1.0)
FEED_POSITION = Quantity("m", "position of the feed along the drill axis", -1.0, 1.0)


@dataclasses.dataclass(frozen=True)
class Feed:
    """Motion that the drive of the feed, which carries the mount, is to make."""

    mode: str  # ``rate`` or ``position``
    value: float  # rate toward the rock [m/s], or position along the drill axis [m]

    def __post_init__(self) -> None:
        if not (isinstance(self.mode, str) and self.mode in FEED_MODES):
            raise ParameterError(
                f"feed mode = {shown(self.mode)} is not one of {', '.join(FEED_MODES)}"
                f"{suggestion(self.mode, FEED_MODES)}"
            )
        quantity = FEED_RATE if self.mode == RATE else FEED_POSITION
        object.__setattr__(self, "value", quantity.check(f"feed {self.mode}", self.value))

    def reduced(self, share: float) -> Feed:
        """Return what is left of it while commands are lost.

        A rate falls with the share; a position is given up, and the feed stops.

        Args:
            share: of the commands that acts, 0 to 1.
        """
        if share == 1.0:
            return self
        return Feed(RATE, self.value * share if self.mode == RATE else 0.0)


STOPPED = Feed(RATE, 0.0)
