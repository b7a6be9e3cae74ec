"""The drilling: what others can do with the drill's run, from its activation to its end."""

from __future__ import annotations

import dataclasses
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future

from rclpy.node import Node

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.paced_run import PacedRun
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.status_reporter import StatusReporter
from rpud_sim.ros.drill.time_control import Reached, TimeControl
from rpud_sim.ros.drill.time_source import TimeSource
from rpud_sim.simulation.checkpoints import Checkpoints
from rpud_sim.simulation.configuration import Configuration, Settings
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.resumption import Start
from rpud_sim.simulation.run import Beginning, Run

FORK = "fork"  # checkpoint of a fork at its instant, to which a reset goes back


class Drilling:
    """One drill, from its activation to its end: its run, and those after resets.

    Every method is for the pacing thread; others reach it by ``PacingThread.request``. Requests act
    between two blocks. It begins in the state ``start``, is over at ``end`` in simulation time
    [ns], and calls ``restored`` with the settings to which a reset went back.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        publishers: DrillPublishers,
        reporter: StatusReporter,
        inbox: Inbox,
        restored: Callable[[Settings], None],
        end: int = sys.maxsize,
        start: Start | None = None,
    ) -> None:
        self._settings = self._first_settings = settings
        self._seed = settings.seed
        self._journal: Journal | None = None
        self._publishers = publishers
        self._reporter = reporter
        self._inbox = inbox
        self._restored = restored
        self._end = end
        self._start = start
        self._checkpoints = Checkpoints()
        self._saved: dict[str, tuple[Settings, int]] = {}  # settings and seed of the checkpoints
        self._logger = node.get_logger()
        run = self._new_run(self._seed, settings, active=False)  # first what can fail
        self._source = TimeSource(node, settings.publish_clock)
        pacer = Pacer(settings.telemetry_rate, schedule=self._source.schedule)
        planned = start.planned if start else ()
        self._paced = PacedRun(run, publishers, reporter, inbox, pacer, self._logger, planned)
        if start is not None:
            self._paced.resume(self._copy(start, Journal()), 0, active=True)

    @property
    def run(self) -> Run:
        return self._paced.run

    @property
    def settings(self) -> Settings:
        return self._settings

    @property
    def time_control(self) -> TimeControl:
        """State of simulation time, to be read."""
        return self._paced.time_control

    @property
    def follows_clock(self) -> bool:
        """Whether its time is that of another source of ``/clock``."""
        return self._source.follows

    @property
    def finished(self) -> bool:
        """Whether simulation time has reached its end."""
        return self.run.time >= self._end

    def notify(self, wake: Callable[[], None]) -> None:
        """Call this from now on when a command comes or the time source moves."""
        self._inbox.notify(wake)
        self._source.notify(wake)

    def announce(self) -> None:
        """Publish status and diagnostics of a drilling that has not started."""
        self.run.place(self._source.return_to(self.run.time))
        self._reporter.report("inactive", self.run)
        self._reporter.publish_diagnostics()

    def begin(self, settings: Settings) -> None:
        """Begin, active and with a journal, with settings that may have changed."""
        if self._start is not None:
            self._begin_in_state(self._start, settings)
            return
        self._journal = Journal()
        run = self._new_run(self._seed, settings, active=True)
        self._settings = self._first_settings = settings
        self._paced.replace(run, self.run.origin)

    def start(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Let simulation time begin, now or with the first ``/clock``.

        ``stop`` ends the wait for ``/clock``; ``serve`` is called again and again meanwhile.
        """
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        self._logger.info(_first_line(self._settings.configuration))
        self._source.wait(stop, serve)
        self.run.place(self._source.return_to(self.run.time))
        self._reporter.finish()
        if self._source.follows or not self._settings.start_paused:
            self.play()
        else:
            self.pause()

    def advance(self) -> float:
        """Do what is due now; return for how long nothing more is due [s]."""
        if self._source.went_back():
            self._logger.warning("/clock went back: the drill restarts")
            self.reset(time=True, state=True)
        return self._paced.advance()

    def finish(self) -> None:
        """Publish what is left, and the last status."""
        self._paced.flush("end")
        self._reporter.finish()
        self._paced.report("stopped")

    def close(self) -> None:
        """Stop listening to the clock."""
        self._source.close()

    def play(self) -> None:
        """Let time go on by itself, from here on."""
        self.time_control.play()
        self._pace()

    def pause(self) -> None:
        """Let time stand still."""
        self.time_control.pause()
        self._pace()

    def halt(self) -> None:
        """Begin again and let time stand still."""
        self.reset(time=True, state=True)
        self.time_control.stop()
        self._pace()

    def step(self, until: int) -> Future[Reached]:
        """Let a paused simulation go on to a simulation time [ns]."""
        return self._paced.step(until)

    def act(self, action: Callable[[Run], None]) -> None:
        """Act on the run, and publish the change."""
        action(self.run)
        self._paced.report()

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ in what may change while the drill runs."""
        before, self._settings = self._settings.real_time_factor, settings
        self.run.configure(settings)
        if settings.real_time_factor != before:
            self._pace()
        else:
            self._paced.report()

    def save(self, name: str) -> tuple[int, tuple[str, ...]]:
        """Keep the present state as a checkpoint; return its stamp [ns] and all names."""
        self._checkpoints.save(name, self.run)
        self._saved[name] = self._settings, self._seed
        self.run.note("save", name=name)
        self._paced.report()
        return self.run.origin + self.run.time, self._checkpoints.names

    def restore(self, name: str, *, continues: bool = False) -> int:
        """Go back to a checkpoint; return the stamp at which it goes on [ns].

        With ``continues`` stamps continue even where the node is the source of ``/clock``.
        """
        old, new = self.run, self._checkpoints.find(name)
        settings, self._seed = self._saved[name]
        self._settings = dataclasses.replace(
            settings, real_time_factor=self._settings.real_time_factor
        )
        self.time_control.interrupt("a checkpoint was restored")
        self._paced.flush()
        old.note("restore", name=name)
        self._publishers.publish(old.entries())
        now = old.origin + old.time - new.time
        origin = self._source.return_to(new.time, now if continues else new.origin)
        self._paced.resume(new, origin, old.control.active)
        new.note_state()  # a recorder that came after the checkpoint cannot go back to it
        self._reporter.begin()
        self._restored(self._settings)
        self._pace()
        return origin + new.time

    def reset(self, time: bool, state: bool, seed: int | None = None) -> None:
        """Begin again; a fork goes back to its instant, and cannot have another seed.

        ``time`` says whether stamps begin again. ``state`` is the motion, commands, faults, and
        parameters as they were when it started, but for its pace. A ParameterError changes nothing.
        """
        if state and self._start is not None:
            if seed not in (None, self._seed):
                raise ParameterError(f"seed = {seed}: a fork keeps its seed {self._seed}")
            self.restore(FORK, continues=not time)
            return
        seed = self._seed if seed is None else seed
        old, new, settings = self.run, None, self._settings
        if state:
            settings = dataclasses.replace(
                self._first_settings, real_time_factor=settings.real_time_factor
            )
            # First what can fail, as the scenario's file may be another one by now.
            new = self._new_run(seed, settings, old.control.active)
        self.time_control.interrupt("the simulation was reset")
        self._seed, self._settings = seed, settings
        self._paced.flush()
        if new is not None:
            self._paced.replace(new, self._source.begin(None if time else old.origin + old.time))
            self._reporter.begin()
            self._restored(settings)
        elif time:
            old.place(self._source.begin() - old.time)
        self._pace()

    def _begin_in_state(self, start: Start, settings: Settings) -> None:
        self._journal = start.next_journal()
        run = self._copy(start, self._journal)
        self._seed = run.beginning.seed
        self._settings = self._first_settings = settings
        self._publishers.publish((run.time, "journal", fields) for fields in start.journal)
        if settings != start.settings:  # set since the node was made
            run.configure(settings)
        self._checkpoints.save(FORK, run)
        self._saved[FORK] = settings, self._seed
        run.note("save", name=FORK, forked_from=dict(start.forked_from))
        self._paced.resume(run, self.run.origin, active=True)
        run.note_state()  # a late subscriber gets the last entries only

    def _copy(self, start: Start, journal: Journal) -> Run:
        return start.run.copy(journal, self._publishers.wanted, self._reporter.add)

    def _pace(self) -> None:
        factor = 1.0 if self._source.follows else self._settings.real_time_factor
        due = self._source.resume(self.run.time)
        self._paced.pace(factor, self._settings.thread_priority, due)

    def _new_run(self, seed: int, settings: Settings, active: bool) -> Run:
        beginning = Beginning.drawn(settings, seed)
        return Run(beginning, self._journal, self._publishers.wanted, active, self._reporter.add)


def _first_line(configuration: Configuration) -> str:
    return (
        f"drilling: regime {configuration.parameters.regime}, "
        f"weight on bit {configuration.parameters.weight_on_bit:g} N, "
        f"drive {'on' if configuration.drive_enabled else 'off'}"
    )
