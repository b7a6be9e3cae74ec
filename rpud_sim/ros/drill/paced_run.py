"""A run in soft real time: blocks are computed ahead of their deadlines, and published at them."""

from __future__ import annotations

import time
from concurrent.futures import Future

from rclpy.impl.rcutils_logger import RcutilsLogger

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.account import Account
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.pacer import Pacer, schedule_thread
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.time_control import TimeControl
from rpud_sim.simulation.run import Run

_STANDSTILL_PERIOD = 0.1  # of /clock while time stands still [s]
_STREAMS = ("waveform", "trajectory")


class PacedRun:
    """Moves a run under its time control, publishes its messages, and reports on it.

    Commands act at the end of the block in which they come. For use by one thread.

    Args:
        run: to move.
        publishers: to publish with.
        account: of what it does.
        inbox: of commands.
        pacer: of the deadlines.
        logger: of the node.
    """

    def __init__(
        self,
        run: Run,
        publishers: DrillPublishers,
        account: Account,
        inbox: Inbox,
        pacer: Pacer,
        logger: RcutilsLogger,
    ) -> None:
        self.time_control = TimeControl()
        self._publishers = publishers
        self._account = account
        self._inbox = inbox
        self._pacer = pacer
        self._logger = logger
        self._clock_due = 0.0
        self.replace(run, 0)

    @property
    def run(self) -> Run:
        """The present run."""
        return self._run

    def replace(self, run: Run, origin: int) -> None:
        """Go on with another run, whose simulation time zero has this stamp [ns]."""
        self._run = run
        self._pacer.reset()
        run.begin(origin)

    def pace(self, factor: float, priority: int, due: int | None = None) -> None:
        """Begin a schedule if time goes on by itself, hold it otherwise; report.

        Args:
            factor: simulated time over elapsed time; 0 for as fast as possible.
            priority: of the thread while it has deadlines in real time or slower.
            due: when the present simulation time is due on the pacer's schedule [ns]; None for now.
        """
        playing = self.time_control.playing
        if playing:
            self._pacer.start(self._run.time, due, factor)
        else:
            self._pacer.stop()
        # A drill in a hurry takes all that it can get, and others must have their share.
        punctual = playing and 0.0 < factor <= 1.0
        self._account.scheduling = schedule_thread(priority if punctual else 0)
        self.report()

    def advance(self) -> float:
        """Do what is due now; return for how long nothing more is due [s]."""
        until = self._run.next_boundary
        if self.time_control.goal is not None:
            self._advance_to(min(until, self.time_control.goal))
        elif not self.time_control.playing:
            self._stand_still()
            return _STANDSTILL_PERIOD
        elif (idle := self._pacer.idle(until)) > 0.0:
            if self._account.due():
                self.report()
            return idle
        else:
            self._advance_to(until)
        return 0.0

    def step(self, goal: int) -> Future[int]:
        """Begin a step to a simulation time [ns]; the result is that time."""
        if self._apply_commands():  # they were given before
            self.report()
        return self.time_control.step(goal)

    def flush(self, kind: str = "flush") -> None:
        """Publish what the streams still hold: ``flush`` to go on, or ``end``."""
        # One by one: the journal's entry arrives before the short blocks that follow from it, or a
        # recorder that ends in between has blocks which nothing explains.
        for message in self._run.flush(kind):
            self._publishers.publish([message])

    def report(self, state: str = "") -> None:
        """Publish changes and the status; its state is that of the time control if empty."""
        if not state:
            state = self.time_control.state if self._run.control.active else "inactive"
        self._publishers.publish(self._run.changes())
        self._account.report(state, self._run, self._pacer)

    def _advance_to(self, until: int) -> None:
        """Compute a block, publish it at its deadline, and let commands act at its end."""
        messages = self._publishers.encode(self._run.advance_to(until))
        # Without deadlines its subscribers set the pace.
        self._publishers.patient = not self._pacer.paces
        self._pacer.wait(until)
        self._publishers.publish_clock(self._run.origin + until)
        self._publishers.send(each for each in messages if each[0] not in _STREAMS)
        changed = self._apply_commands()
        self._pacer.finish(until)
        # Streams are large, and have no deadline.
        self._publishers.send(each for each in messages if each[0] in _STREAMS)
        for refusal in self._run.simulation.drain_refusals():
            self._logger.warning(refusal)
        due = self._report_due(until)
        step = self.time_control.complete_step(until)
        if changed or step is not None or due:
            self.report()
        if step is not None:
            step.set_result(until)

    def _report_due(self, time: int) -> bool:
        """Return whether a report is due by itself at the end of a block.

        In a step it is at every second of simulation time: what is published must not depend on
        the speed of the machine.
        """
        return time % SECOND == 0 if self.time_control.stepping else self._account.due()

    def _apply_commands(self) -> bool:
        """Let waiting commands act; return whether anything changed that the status shows."""
        commands = self._inbox.drain()
        for command in commands:
            self._run.control.apply(command)
        changed = self._run.control.act()
        return bool(commands) or changed or self._account.refused_more()

    def _stand_still(self) -> None:
        if self._apply_commands() or self._account.due():
            self.report()
        now = time.monotonic()
        if now >= self._clock_due:
            if self._publishers.delivery_changed():  # a test waits for it
                self.report()
            self._publishers.publish_clock(self._run.origin + self._run.time)
            self._clock_due = now + _STANDSTILL_PERIOD
