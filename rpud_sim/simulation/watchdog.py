"""Command watchdog: makes the drill safe when commands stop arriving."""

from __future__ import annotations

from rpud_sim.foundation.time import SECOND


class CommandWatchdog:
    """Share of the commands that acts, by the time of the last one.

    The share is 1 while commands arrive. When none arrived for the timeout, it falls linearly to 0
    within the ramp, and stays there until the next command. Times are integer nanoseconds of
    simulation time.

    Args:
        timeout: time without a command after which commands are lost [s]; 0 for never.
        ramp: time in which the share falls from 1 to 0 [s].
        time: at which it starts.
    """

    def __init__(self, timeout: float, ramp: float, time: int = 0) -> None:
        self._last = time
        self.set(timeout, ramp)

    def set(self, timeout: float, ramp: float) -> None:
        """Set another timeout and ramp [s]."""
        # In nanoseconds, so that the end of the ramp is exact. At least 1: 0 would be no timeout.
        self._timeout = max(1, round(timeout * SECOND)) if timeout > 0.0 else 0
        self._ramp = round(ramp * SECOND)

    def reset(self, time: int) -> None:
        """Wait again from the time of a command on."""
        self._last = time

    def lost(self, time: int) -> bool:
        """Return whether commands are lost."""
        return self._overdue(time) > 0

    def share(self, time: int) -> float:
        """Return the share of the commands that acts, from 1 to 0."""
        overdue = self._overdue(time)
        if overdue <= 0:
            return 1.0
        return max(0.0, 1.0 - overdue / self._ramp) if self._ramp else 0.0

    def _overdue(self, time: int) -> int:
        return time - self._last - self._timeout if self._timeout else 0
