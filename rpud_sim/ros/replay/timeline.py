"""Timeline of a replay: where in the bag it is, and when a message is due. No ROS, no clock."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Timeline:
    """Position in a bag as a function of a monotonic clock; all times are integer nanoseconds.

    Every change but a seek keeps the position.
    """

    position: int  # in the bag until ``since``
    since: int  # time of the clock from which on it moves, unless it is paused
    rate: float = 1.0  # bag time over clock time
    paused: bool = False  # whether it stands still

    def position_at(self, now: int) -> int:
        if self.paused:
            return self.position
        return self.position + round(max(0, now - self.since) * self.rate)

    def due(self, position: int) -> float:
        """Return the time of the clock at which a position is reached; infinite if paused."""
        if self.paused:
            return float("inf")
        return self.since + (position - self.position) / self.rate

    def seek(self, now: int, position: int) -> Timeline:
        return replace(self, position=position, since=now)

    def pause(self, now: int) -> Timeline:
        """Return a timeline that stands still from now on."""
        return replace(self._held(now), paused=True)

    def resume(self, now: int) -> Timeline:
        return replace(self._held(now), paused=False)

    def with_rate(self, now: int, rate: float) -> Timeline:
        return replace(self._held(now), rate=rate)

    def _held(self, now: int) -> Timeline:
        return self.seek(max(now, self.since), self.position_at(now))
