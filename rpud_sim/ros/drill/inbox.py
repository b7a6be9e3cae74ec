"""Inbox of commands from the executor to the pacing thread, with counts of refusals."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from typing import TYPE_CHECKING

from rpud_sim.ros.lateness import Lateness

if TYPE_CHECKING:
    from rclpy.impl.rcutils_logger import RcutilsLogger

    from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit

    Command = WeightOnBit | Drive | Feed

_LOGGED_PER_SECOND = 10
_MALFORMED_PERIOD = 10.0  # between two log lines about malformed commands [s]


class Inbox:
    """Queue of checked commands in the order in which they came.

    One thread appends, another drains, and any may refuse requests of services.
    """

    def __init__(self, logger: RcutilsLogger) -> None:
        self._logger = logger
        self._waiting: deque[tuple[int, Command]] = deque()
        # of commands, from their arrival until they were drained, since ``begin_delays``
        self.delays = Lateness()
        self._second = 0
        self._logged = 0
        self._notify: Callable[[], None] = lambda: None
        self._counting = threading.Lock()
        self.accepted = 0  # commands that were drained, since the start
        self.rejected = 0  # commands that were refused, since the start
        # commands that were overwritten before they were taken, since the start
        self.discarded = 0
        self.requests_refused = 0  # requests of services that were refused, since the start
        self.last_refusal = ""  # why the latest command or request was refused

    def notify(self, notify: Callable[[], None]) -> None:
        """Call this from now on when a command is accepted or refused."""
        self._notify = notify

    def begin(self) -> None:
        """Count from zero, and discard waiting commands: they were meant for the run before."""
        self.begin_delays()
        with self._counting:
            self.discarded = len(self._waiting)
            self._waiting.clear()
            self.accepted = 0
            self.rejected = 0
            self.requests_refused = 0
            self.last_refusal = ""

    def begin_delays(self) -> None:
        self.delays = Lateness()

    def accept(self, command: Command, arrived: int | None = None) -> None:
        """Queue a command for the next block boundary.

        ``arrived`` is when the middleware received it, on the monotonic clock [ns]; None for now.
        """
        with self._counting:
            self._waiting.append((time.monotonic_ns() if arrived is None else arrived, command))
        self._notify()

    def discard(self, count: int) -> None:
        """Count commands that the middleware overwrote before they were taken."""
        with self._counting:
            self.discarded += count
        self._notify()

    def refuse(self, reason: str) -> None:
        """Count an invalid command, and log why."""
        self._reject(reason)
        with self._counting:
            self._log(f"command refused: {reason}")

    def refuse_malformed(self, reason: str) -> None:
        """Count a malformed command; log one in ten seconds."""
        self._reject(reason)
        self._logger.warning(f"command refused: {reason}", throttle_duration_sec=_MALFORMED_PERIOD)

    def refuse_request(self, reason: str) -> None:
        """Count a service's request that is refused, and log why."""
        with self._counting:
            self.requests_refused += 1
            self.last_refusal = reason
            self._log(f"request refused: {reason}")

    def _reject(self, reason: str) -> None:
        with self._counting:
            self.rejected += 1
            self.last_refusal = reason
        self._notify()

    def _log(self, text: str) -> None:
        second = int(time.monotonic())
        if second != self._second:
            self._second = second
            self._logged = 0
        self._logged += 1
        if self._logged <= _LOGGED_PER_SECOND:
            self._logger.warning(text)
        elif self._logged == _LOGGED_PER_SECOND + 1:
            self._logger.warning("more is refused in this second, and counted")

    def drain(self) -> list[Command]:
        """Return the waiting commands in order, and count them as accepted."""
        with self._counting:
            waiting = list(self._waiting)
            self._waiting.clear()
            self.accepted += len(waiting)
        now = time.monotonic_ns()
        for arrived, _ in waiting:
            self.delays.add(now - arrived)
        return [command for _, command in waiting]
