"""A run in soft real time: blocks are computed ahead of their deadlines, and published at them.

Waveform, trajectory and diagnostics have no deadline: they fill the time between those of blocks.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future

from rclpy.impl.rcutils_logger import RcutilsLogger

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.status_reporter import StatusReporter
from rpud_sim.ros.drill.time_control import Reached, TimeControl
from rpud_sim.ros.scheduling import schedule_thread
from rpud_sim.simulation.changes import Planned, apply_change
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.telemetry import Stream

_STANDSTILL_PERIOD = 0.1  # of /clock while time stands still [s]
_PART = 0.0002  # that a part of other work between two deadlines takes [s]


class PacedRun:
    """Moves a run under its time control, publishes its messages, and reports on it.

    Commands act at the end of the block in which they come. For use by one thread. ``planned``
    changes come by themselves; their delays count from simulation time zero.
    """

    def __init__(
        self,
        run: Run,
        publishers: DrillPublishers,
        reporter: StatusReporter,
        inbox: Inbox,
        pacer: Pacer,
        logger: RcutilsLogger,
        planned: Sequence[Planned] = (),
    ) -> None:
        self.time_control = TimeControl()
        self._publishers = publishers
        self._reporter = reporter
        self._inbox = inbox
        self._pacer = pacer
        self._logger = logger
        self._clock_due = 0.0
        self._unreported = False  # whether the status lacks changes
        self._planned = planned
        self._streams: deque[Stream] = deque()
        self._switch(run)
        run.begin(0)

    @property
    def run(self) -> Run:
        return self._run

    def replace(self, run: Run, origin: int) -> None:
        """Go on with another run, whose simulation time zero has this stamp [ns]."""
        self._switch(run)
        run.begin(origin)

    def resume(self, run: Run, origin: int, active: bool) -> None:
        """Go on with a run that is past its beginning; see ``Run.resume``."""
        self._switch(run)
        run.resume(origin, active)

    def pace(self, factor: float, priority: int, due: int | None = None) -> None:
        """Begin a schedule if time goes on by itself, hold it otherwise; report.

        ``factor`` is simulated over elapsed time, 0 for as fast as possible. The priority is for
        deadlines in real time or slower. ``due`` is when the present time is on the pacer's
        schedule [ns]; None is now.
        """
        self._publish_rest()
        playing = self.time_control.playing
        if playing:
            self._pacer.start(self._run.time, due, factor)
        else:
            self._pacer.stop()
        # A drill in a hurry takes all that it can get, and others must have their share.
        punctual = playing and 0.0 < factor <= 1.0
        self._reporter.scheduling = schedule_thread(priority if punctual else 0)
        self.report()

    def advance(self) -> float:
        """Do what is due now; return for how long nothing more is due [s]."""
        until = min(self._run.next_boundary, self._next_planned)
        if self.time_control.goal is not None:
            self._advance_to(min(until, self.time_control.goal))
        elif not self.time_control.playing:
            self._stand_still()
            return _STANDSTILL_PERIOD
        elif (idle := self._pacer.idle(until)) > 0.0:
            if self._reporter.due() or (self._unreported and self._reporter.rested):
                self.report()
            self._fill_time(until)
            return idle
        else:
            self._advance_to(until)
        return 0.0

    def step(self, goal: int) -> Future[Reached]:
        """Begin a step to a simulation time [ns]."""
        if self._apply_commands():  # they were given before
            self.report()
        return self.time_control.step(goal)

    def flush(self, kind: str = "flush") -> None:
        """Publish what the streams still hold: ``flush`` to go on, or ``end``."""
        self._publish_rest()
        # One by one: the journal's entry arrives before the short blocks that follow from it, or a
        # recorder that ends in between has blocks which nothing explains.
        for message in self._run.flush(kind):
            self._publishers.publish([message])

    def report(self, state: str = "") -> None:
        """Publish changes and the status; its state is that of the time control if empty."""
        self._unreported = False
        later = self._pacer.ahead and not state
        if not state:
            state = self.time_control.state if self._run.control.active else "inactive"
        self._publishers.publish(self._run.changes())
        self._reporter.report(state, self._run, self._pacer)
        if not later:
            self._reporter.publish_diagnostics()

    def _advance_to(self, until: int) -> None:
        entries = list(self._run.advance_to(until, self._streams.append))
        messages = self._publishers.encode(entries)
        # Without deadlines its subscribers set the pace.
        self._publishers.patient = not self._pacer.paces
        if self._pacer.ahead:
            self._fill_time(until)
        self._pacer.wait(until)
        self._publishers.publish_clock(self._run.origin + until)
        self._publishers.send(messages)
        self._pacer.finish(until)
        if self._pacer.paces:
            struck = [time for time, name, _ in entries if name == "contact_force"]
            self._reporter.add_impact_delays(map(self._pacer.delay_since, struck))
        changed = self._apply_planned() | self._apply_commands()
        self._unreported |= changed
        if changed:
            self._publishers.publish(self._run.changes())
        if not self._pacer.ahead:
            self._publish_rest()
        for refusal in self._run.simulation.drain_refusals():
            self._logger.warning(refusal)
        # In steps a test waits for each of them. Otherwise a stream of commands would have one in
        # each block, and its readers would be late.
        due = self._report_due(until) or (
            self._unreported and (self.time_control.stepping or self._reporter.rested)
        )
        step = self.time_control.complete_step(until)
        if step is not None or due:
            self.report()
        if step is not None:
            step.set_result(Reached(self._run.origin + until, self._publishers.published))

    def _fill_time(self, until: int) -> None:
        """Publish what has no deadline, in parts, until a deadline is near.

        Without time to spare a stream that has waited for a period of streams goes on by a part in
        each block, and one that has waited for two is finished: so their number is bounded.
        """
        if self._pacer.remaining(until) > _PART:
            self._reporter.publish_diagnostics()
        if len(self._streams) > 1:
            self._publish_part()
        while self._streams and (len(self._streams) > 2 or self._pacer.remaining(until) > _PART):
            self._publish_part()

    def _publish_rest(self) -> None:
        while self._streams:
            self._publish_part()
        self._reporter.publish_diagnostics()

    def _publish_part(self) -> None:
        for entry in self._streams[0]:
            if entry is not None:
                self._publishers.publish([entry])
            return
        self._streams.popleft()

    def _report_due(self, time: int) -> bool:
        """Return whether a report is due by itself at the end of a block.

        In a step it is at every second of simulation time: what is published must not depend on
        the speed of the machine.
        """
        return time % SECOND == 0 if self.time_control.stepping else self._reporter.due()

    @property
    def _next_planned(self) -> int:
        return self._pending[0].delay if self._pending else NEVER

    def _switch(self, run: Run) -> None:
        self._run = run
        self._pacer.reset()
        self._pending = deque(planned for planned in self._planned if planned.delay > run.time)

    def _apply_planned(self) -> bool:
        """Make the planned changes that are due; return whether there were any."""
        any_due = False
        while self._next_planned <= self._run.time:
            any_due = True
            try:
                apply_change(self._run, self._pending.popleft().change)
            except ParameterError as error:
                self._logger.warning(f"planned change refused: {error}")
        return any_due

    def _apply_commands(self) -> bool:
        """Let waiting commands act; return whether anything changed that the status shows."""
        commands = self._inbox.drain()
        for command in commands:
            self._run.control.apply(command)
            self._run.note_state(due=True)
        changed = self._run.control.act()
        return bool(commands) or changed or self._reporter.refused_more()

    def _stand_still(self) -> None:
        if self._apply_commands() or self._reporter.due():
            self.report()
        now = time.monotonic()
        if now >= self._clock_due:
            self._publishers.publish_clock(self._run.origin + self._run.time)
            self._clock_due = now + _STANDSTILL_PERIOD
