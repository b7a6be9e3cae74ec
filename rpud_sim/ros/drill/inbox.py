"""Commands on their way from the executor's threads to the pacing thread; refusals counted."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from rpud_sim.simulation.commands import Drive, WeightOnBit

_LOGGED_PER_SECOND = 10
_MALFORMED_PERIOD = 10.0  # between two log lines about malformed commands [s]


class Inbox:
    """Checked commands in the order in which they came.

    One thread puts in, another takes out; each of these is one atomic operation of a deque.
    Requests of services are refused by any thread.

    Attributes:
        accepted: commands that were taken, since the start.
        rejected: commands that were refused, since the start.
        requests_refused: requests of services that were refused, since the start.
        last_refusal: why the latest of both was refused.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._waiting: deque[WeightOnBit | Drive] = deque()
        self._second = 0
        self._logged = 0
        self._notify: Callable[[], None] = lambda: None
        self._counting = threading.Lock()
        self.accepted = 0
        self.rejected = 0
        self.requests_refused = 0
        self.last_refusal = ""

    def notify(self, notify: Callable[[], None]) -> None:
        """Call this from now on whenever there is news."""
        self._notify = notify

    def begin(self) -> None:
        """Count from zero again, and forget what waits: it was meant for what was before."""
        self._waiting.clear()
        self.accepted = 0
        self.rejected = 0
        self.requests_refused = 0
        self.last_refusal = ""

    def accept(self, command: WeightOnBit | Drive) -> None:
        """Queue a command for the next block boundary."""
        self._waiting.append(command)
        self._notify()

    def refuse(self, reason: str) -> None:
        """Count a command that cannot be used and log why."""
        self._reject(reason)
        self._log(f"command refused: {reason}")

    def refuse_malformed(self, reason: str) -> None:
        """Count a command that cannot be read; log one in ten seconds."""
        self._reject(reason)
        self._logger.warning(f"command refused: {reason}", throttle_duration_sec=_MALFORMED_PERIOD)

    def refuse_request(self, reason: str) -> None:
        """Count a service's request that cannot be met and log why; its client hears of it."""
        with self._counting:
            self.requests_refused += 1
            self.last_refusal = reason
            self._log(f"request refused: {reason}")

    def _reject(self, reason: str) -> None:
        self.rejected += 1
        self.last_refusal = reason
        self._notify()

    def _log(self, text: str) -> None:
        """Log a refusal; of a flood, only the first ones."""
        second = int(time.monotonic())
        if second != self._second:
            self._second = second
            self._logged = 0
        self._logged += 1
        if self._logged <= _LOGGED_PER_SECOND:
            self._logger.warning(text)
        elif self._logged == _LOGGED_PER_SECOND + 1:
            self._logger.warning("more is refused in this second, and counted")

    def drain(self) -> list[WeightOnBit | Drive]:
        """Return the commands that wait, in order; from now on they count as accepted."""
        commands = []
        while self._waiting:
            commands.append(self._waiting.popleft())
        self.accepted += len(commands)
        return commands
