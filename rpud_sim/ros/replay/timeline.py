"""Where in the bag a replay is, and when what is there is due. No ROS, no clock of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Timeline:
    """Lays the time of a bag on a monotonic clock; all times are integer nanoseconds.

    It stands at `position` of the bag until the clock says `since`, and from then on moves `rate`
    times as fast as the clock, unless it is paused. Every change but a seek keeps the position.
    """

    position: int
    since: int
    rate: float = 1.0
    paused: bool = False

    def position_at(self, now: int) -> int:
        """Give the bag's time at the clock's time `now`."""
        if self.paused:
            return self.position
        return self.position + round(max(0, now - self.since) * self.rate)

    def due(self, position: int) -> float:
        """Give the clock's time at which the bag's time is `position` [ns]; infinite if paused."""
        if self.paused:
            return float("inf")
        return self.since + (position - self.position) / self.rate

    def seek(self, now: int, position: int) -> Timeline:
        """Go to `position`, at the clock's time `now`."""
        return replace(self, position=position, since=now)

    def pause(self, now: int) -> Timeline:
        """Stand still from `now` on."""
        return replace(self._held(now), paused=True)

    def resume(self, now: int) -> Timeline:
        """Go on from `now` on."""
        return replace(self._held(now), paused=False)

    def with_rate(self, now: int, rate: float) -> Timeline:
        """Move `rate` times as fast as the clock from `now` on."""
        return replace(self._held(now), rate=rate)

    def _held(self, now: int) -> Timeline:
        return self.seek(max(now, self.since), self.position_at(now))
