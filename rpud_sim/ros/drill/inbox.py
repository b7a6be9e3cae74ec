"""Inbox of commands from the executor to the pacing thread, and what became of each."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable

from rclpy.impl.rcutils_logger import RcutilsLogger
from rpud_msgs.msg import CommandResult

from rpud_sim.ros.delay_histogram import DelayHistogram
from rpud_sim.simulation.commands import Drive, Feed, WeightOnBit

Command = WeightOnBit | Drive | Feed

_LOGGED_PER_SECOND = 10
_MOST_RESULTS = 1000  # that wait to be published: more are counted only
_MALFORMED_PERIOD = 10.0  # between two log lines about malformed commands [s]


class Inbox:
    """Queue of checked commands in the order in which they came.

    One thread appends, another drains, and any may refuse requests of services. ``notify`` is
    called when a command is accepted or refused.
    """

    def __init__(self, logger: RcutilsLogger, notify: Callable[[], None] = lambda: None) -> None:
        self._logger = logger
        self.notify = notify
        self._waiting: deque[tuple[int, Command, CommandResult]] = deque()
        self._results: deque[CommandResult] = deque(maxlen=_MOST_RESULTS)  # not published yet
        # By kind and whether it was accepted.
        self._latest: dict[tuple[str, bool], CommandResult] = {}
        self._results_changed = False
        self._delays = DelayHistogram()
        self._second = 0
        self._logged = 0
        self._counting = threading.Lock()
        self.accepted = 0  # commands that were drained, since the start
        self.rejected = 0  # commands that were refused, since the start
        # commands that were overwritten before they were taken, since the start
        self.discarded = 0
        self.requests_refused = 0  # requests of services that were refused, since the start
        self.last_refusal = ""  # why the latest command or request was refused

    def begin(self) -> None:
        """Count from zero, and discard waiting commands: they were meant for the run before."""
        self._delays = DelayHistogram()
        with self._counting:
            self.discarded = len(self._waiting)
            self._latest.clear()
            self._results.clear()
            why = "the drill began again before it could act"
            for _, _, result in self._waiting:
                result.reason = why
                self._results.append(result)
            self._results_changed = True
            self._waiting.clear()
            self.accepted = 0
            self.rejected = 0
            self.requests_refused = 0
            self.last_refusal = ""

    def take_delays(self) -> DelayHistogram:
        """Return the delays from arrival to ``drain``, since the last call."""
        delays, self._delays = self._delays, DelayHistogram()
        return delays

    def accept(self, command: Command, result: CommandResult, arrived: int | None = None) -> None:
        """Queue a command for the next block boundary.

        ``arrived`` is when the middleware received it, on the monotonic clock [ns]; None for now.
        """
        arrived = time.monotonic_ns() if arrived is None else arrived
        with self._counting:
            self._waiting.append((arrived, command, result))
        self.notify()

    def discard(self, count: int) -> None:
        """Count commands that the middleware overwrote before they were taken."""
        with self._counting:
            self.discarded += count
        self.notify()

    def refuse(self, result: CommandResult, reason: str, *, malformed: bool = False) -> None:
        """Count an invalid command, and log why; of malformed ones, one in ten seconds."""
        result.reason = reason
        text = f"command refused: {reason}"
        with self._counting:
            self.rejected += 1
            self.last_refusal = reason
            self._results.append(result)
            if not malformed:
                self._log(text)
        self.notify()
        if malformed:
            self._logger.warning(text, throttle_duration_sec=_MALFORMED_PERIOD)

    def refuse_request(self, reason: str) -> None:
        """Count a service's request that is refused, and log why."""
        with self._counting:
            self.requests_refused += 1
            self.last_refusal = reason
            self._log(f"request refused: {reason}")

    def take_results(self) -> tuple[list[CommandResult], list[CommandResult]] | None:
        """Return what became of the commands since the last call; None if nothing did.

        Before them it returns those that were accepted and refused last until then, of each kind.
        """
        with self._counting:
            if not (self._results or self._results_changed):
                return None
            former, found = list(self._latest.values()), list(self._results)
            self._latest.update(((result.kind, result.accepted), result) for result in found)
            self._results.clear()
            self._results_changed = False
            return former, found

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
            for _, _, result in waiting:
                result.accepted = True
                self._results.append(result)
        now = time.monotonic_ns()
        for arrived, _, _ in waiting:
            self._delays.add(now - arrived)
        return [command for _, command, _ in waiting]
