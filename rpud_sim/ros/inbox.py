"""Commands on their way from the executor's thread to the pacing thread; refusals counted."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from rpud_sim.simulation.commands import Drive, WeightOnBit

_LOGGED_PER_SECOND = 10


class Inbox:
    """Checked commands in the order in which they came.

    One thread puts in, another takes out; each of these is one atomic operation of a deque.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._waiting: deque[WeightOnBit | Drive] = deque()
        self._second = 0
        self._logged = 0
        self.accepted = 0
        self.rejected = 0

    def accept(self, command: WeightOnBit | Drive) -> None:
        """Queue a command for the next block boundary."""
        self.accepted += 1
        self._waiting.append(command)

    def refuse(self, reason: str) -> None:
        """Count a command that cannot be used and log why; of a flood, only the first ones."""
        self.rejected += 1
        second = int(time.monotonic())
        if second != self._second:
            self._second = second
            self._logged = 0
        self._logged += 1
        if self._logged <= _LOGGED_PER_SECOND:
            self._logger.warning(f"command refused: {reason}")
        elif self._logged == _LOGGED_PER_SECOND + 1:
            self._logger.warning("more commands refused in this second; they are counted")

    def take(self) -> list[WeightOnBit | Drive]:
        """Return the commands that wait, in order."""
        commands = []
        while self._waiting:
            commands.append(self._waiting.popleft())
        return commands
