"""The command watchdog: makes the drill safe when commands stay out."""

from __future__ import annotations

from rpud_sim.foundation.time import SECOND


class CommandWatchdog:
    """How much of the commands is in force, given when the last one came.

    While commands come it is all of them. When none has come for the timeout, it goes down
    linearly to nothing within the ramp, and stays there until one comes again. Times are integer
    nanoseconds of simulation time.

    Args:
        timeout: without a command, after which they are lost [s]; 0 for never.
        ramp: from all to nothing [s].
        time: at which it begins to wait.
    """

    def __init__(self, timeout: float, ramp: float, time: int = 0) -> None:
        self._last = time
        self.set(timeout, ramp)

    def set(self, timeout: float, ramp: float) -> None:
        """Take another timeout and ramp [s]."""
        # In nanoseconds, so that the end of the ramp is exact; the shortest timeout is not never.
        self._timeout = max(1, round(timeout * SECOND)) if timeout > 0.0 else 0
        self._ramp = round(ramp * SECOND)

    def heard(self, time: int) -> None:
        """Note that a command came."""
        self._last = time

    def lost(self, time: int) -> bool:
        """Whether commands are lost."""
        return self._overdue(time) > 0

    def share(self, time: int) -> float:
        """Share of the commands that is in force, from 1 to 0."""
        overdue = self._overdue(time)
        if overdue <= 0:
            return 1.0
        return max(0.0, 1.0 - overdue / self._ramp) if self._ramp else 0.0

    def _overdue(self, time: int) -> int:
        return time - self._last - self._timeout if self._timeout else 0
