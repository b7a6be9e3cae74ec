"""Live run: the drill's run and its time, from the node's configuration to its clean-up."""

from __future__ import annotations

import dataclasses
import sys
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import NamedTuple

from rclpy.node import Node

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.ros.drill.commands import Inbox
from rpud_sim.ros.drill.duplicate_nodes import DuplicateNodes
from rpud_sim.ros.drill.pacer import Pacer, TimeSource
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.report import StatusReporter
from rpud_sim.ros.threads import schedule_thread
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.plans import Agenda, apply_change
from rpud_sim.simulation.rerun import Start
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.topics import offered_topics

_FORK = "fork"  # name of the state of a fork at its instant, to which a reset goes back
LONGEST_STEP = 1e6  # [s]; longer than any mission

_PART = 0.0002  # that a part of the work without a deadline takes [s]
_STANDSTILL_PERIOD = 0.1  # of /clock while time stands still [s]


class InterruptedStepError(RuntimeError):
    """A step that ended before its goal; the text says why."""


class Reached(NamedTuple):
    """End of a step."""

    stamp: int  # of the simulation time that was reached [ns]
    published: Mapping[str, int]  # messages by topic until then, since its publisher exists


class LiveRun:
    """Run of the drill under commands, and those after resets; their time, publishers and reports.

    Nothing moves until ``begin``. From then on every method is for the pacing loop: others reach it
    by ``PacingLoop.request``, and act between two blocks. Any thread may read the attributes.

    Time plays, stands still (paused, or stopped at its start), or goes on to the goal of a step.
    The run begins in the state ``start``, at time zero without one, and is over at ``end`` in
    simulation time [ns]. ``restored`` is called with the settings to which a reset went back.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        inbox: Inbox,
        namesakes: DuplicateNodes,
        restored: Callable[[Settings], None] = lambda settings: None,
        end: int = sys.maxsize,
        start: Start | None = None,
    ) -> None:
        self.settings = self._first_settings = settings  # in force
        self.playing = False  # whether time goes on by itself
        self.at_start = False  # whether it was stopped, and neither paused nor played since
        self.goal: int | None = None  # simulation time at which the present step ends [ns]
        self._step: Future[Reached] = Future()
        self._seed = settings.seed
        self._journal: Journal | None = None
        self._inbox = inbox
        self._restored = restored
        self._end = end
        self._start = start
        self._fork: Run | None = None  # state of a fork at its instant
        self._unreported = False  # whether the status lacks changes
        self._clock_due = 0.0
        self._logger = node.get_logger()
        offered = offered_topics(settings.values())
        self.publishers = DrillPublishers(node, settings.publish_clock, offered)
        self.reporter = StatusReporter(
            node, settings.telemetry_rate, self.publishers, inbox, namesakes
        )
        try:
            run = self._copy(start, Journal()) if start else self._new_run(settings, active=False)
        except Exception:
            self.publishers.destroy()  # or the next configuration would have each topic twice
            raise
        self._source = TimeSource(node, settings.publish_clock, inbox.notify)
        self.follows_clock = self._source.follows  # whether its time is that of another's /clock
        self.pacer = Pacer(settings.telemetry_rate, self._source.schedule)
        self._switch(run, 0, active=True if start else None)

    @property
    def stamp(self) -> int:
        """Stamp of the present simulation time [ns]."""
        return self.run.origin + self.run.time

    @property
    def state(self) -> str:
        """State, as ``rpud_msgs/Status`` names it."""
        if not self.run.control.active:
            return "inactive"
        if self.playing or self.goal is not None:
            return "running"
        return "stopped" if self.at_start else "paused"

    @property
    def finished(self) -> bool:
        """Whether simulation time has reached its end."""
        return self.run.time >= self._end

    def announce(self) -> None:
        """Publish status and diagnostics before the beginning."""
        self.run.place(self._source.origin(self.run.time))
        self.reporter.end_period()
        self.reporter.report("inactive", self.run, self.pacer)
        self.reporter.publish_diagnostics()

    def begin(self, settings: Settings) -> None:
        """Begin, active and with a journal, with settings that may have changed."""
        self.settings = self._first_settings = settings
        start, origin = self._start, self.run.origin
        if start is None:
            self._journal = Journal()
            self._switch(self._new_run(settings, active=True), origin)
            return
        self._journal = start.next_journal()
        run = self._copy(start, self._journal)
        self._seed = run.beginning.seed
        self.publishers.publish((run.time, "journal", fields) for fields in start.journal)
        if settings != start.settings:  # set since the node was made
            run.configure(settings)
        self._fork = run.copy()
        run.note("save", name=_FORK, forked_from=dict(start.forked_from))
        self._switch(run, origin, active=True)
        run.note_state()  # a late subscriber gets the last entries only

    def start_time(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Let simulation time begin, now or with the first ``/clock``.

        ``stop`` ends the wait for ``/clock``; ``serve`` is called again and again meanwhile.
        """
        configuration = self.settings.configuration
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        self._logger.info(
            f"drilling: regime {configuration.parameters.regime}, "
            f"weight on bit {configuration.parameters.weight_on_bit:g} N, "
            f"drive {'on' if configuration.drive_enabled else 'off'}"
        )
        self._source.wait(stop, serve)
        self.run.place(self._source.origin(self.run.time))
        self.reporter.end_period()
        if self.follows_clock or not self.settings.start_paused:
            self.play()
        else:
            self.pause()

    def finish(self) -> None:
        """Publish what is left, and the last status."""
        self._flush("end")
        self.reporter.end_period()
        self.report("stopped")

    def close(self) -> None:
        """Stop listening to the clock, and destroy the publishers."""
        self._source.close()
        self.publishers.destroy()

    # What the pacing loop does again and again.

    def turn(self) -> float:
        """Do what is due now; return for how long nothing more is due [s].

        Blocks are computed ahead of their deadlines and published at them. Waveform, trajectory and
        diagnostics have no deadline: they fill the time between those of blocks. Commands act at
        the end of the block in which they come.
        """
        if self._source.went_back:
            self._logger.warning("/clock went back: the drill restarts")
            self.reset(time=True, state=True)
        pacer, publishers = self.pacer, self.publishers
        if not self.playing and self.goal is None:
            self._read_commands()
            self._report_if_due()
            if time.monotonic() >= self._clock_due:
                publishers.publish_clock(self.stamp)
                self._clock_due = time.monotonic() + _STANDSTILL_PERIOD
            return _STANDSTILL_PERIOD
        # The block ends at its boundary, a planned change or a goal.
        until = min(self.run.next_boundary, self._planned.next, self.goal or NEVER)
        if self.playing and (idle := pacer.idle(until)) > 0.0:
            self._report_if_due()
            self._publish_deferred(until)
            return idle
        entries = list(self.run.advance_to(until, publishers.defer))
        messages = publishers.encode(entries)
        publishers.patient = not pacer.paces  # without deadlines its subscribers set the pace
        if pacer.ahead:
            self._publish_deferred(until)
        pacer.wait(until)
        publishers.publish_clock(self.stamp)
        publishers.send(messages)
        pacer.finish(until)
        if pacer.paces:
            for struck in (time for time, name, _ in entries if name == "contact_force"):
                self.reporter.impact_delays.add(pacer.delay_since(struck))
        self._read_commands()
        if not pacer.ahead:
            self._publish_deferred()
        self._report_if_due()
        return 0.0

    def _read_commands(self) -> None:
        """Let planned changes that are due and waiting commands act; publish what changed."""
        changed = False
        for change in self._planned.due(self.run.time):
            changed = True
            try:
                apply_change(self.run.control, change)
            except ParameterError as error:
                self._logger.warning(f"planned change refused: {error}")
        for command in self._inbox.drain():
            changed = True
            self.run.control.apply(command)
            self.run.note_state(due=True)
        changed |= self.run.control.act()
        if changed or self.reporter.refused_more():
            self._unreported = True
            self.publishers.publish(self.run.changes())
        for refusal in self.run.simulation.drain_refusals():
            self._logger.warning(refusal)

    def _publish_deferred(self, until: int | None = None) -> None:
        """Publish what has no deadline: all of it, or what there is time for.

        ``until`` is the simulation time of the next deadline [ns].
        """

        def has_time() -> bool:
            return until is None or self.pacer.remaining(until) > _PART

        if has_time():
            self.reporter.publish_diagnostics()
        self.publishers.publish_deferred(has_time)

    def _report_if_due(self) -> None:
        """Report what changed, and at every second; end a step at its goal.

        In a step a test waits for each change, and what is published must not depend on the speed
        of the machine. While time plays, a stream of commands would have a report in each block,
        and its readers would be late.
        """
        stepping = self.goal is not None
        due = self.run.time % SECOND == 0 if stepping else self.reporter.due()
        due |= self._unreported and (not self.playing or self.reporter.rested)
        reached = self.goal is not None and self.run.time >= self.goal
        if reached:
            self.goal = None
        if due or reached:
            self.report()
        if reached:
            self._step.set_result(Reached(self.stamp, self.publishers.published))

    def report(self, state: str = "") -> None:
        """Publish changes and the status, in the present state or another one."""
        self._unreported = False
        self.publishers.publish(self.run.changes())
        self.reporter.report(state or self.state, self.run, self.pacer)
        if state or not self.pacer.ahead:
            self.reporter.publish_diagnostics()

    # What services and parameters do.

    def play(self) -> None:
        """Let time go on by itself, from here on."""
        self._hold("the simulation was set to play", playing=True)

    def pause(self) -> None:
        """Let time stand still."""
        self._hold("the simulation was paused")

    def halt(self) -> None:
        """Begin again and let time stand still."""
        self.reset(time=True, state=True)
        self._hold("the simulation was stopped", at_start=True)

    def step(self, goal: int) -> Future[Reached]:
        """Let a paused simulation go on to a simulation time [ns], or raise a ParameterError."""
        for holds, state in (
            (self.playing, "playing"),
            (self.at_start, "stopped"),
            (self.goal is not None, "stepping already"),
        ):
            if holds:
                raise ParameterError(f"it is {state}, not paused")
        ahead = (goal - self.run.time) / SECOND
        if not 0.0 < ahead <= LONGEST_STEP:
            raise ParameterError(f"step = {ahead:g} s is outside its range (0, {LONGEST_STEP:g}] s")
        self._read_commands()  # they were given before
        if self._unreported:
            self.report()
        self.goal, self._step = goal, Future()
        return self._step

    def interrupt(self, reason: str) -> None:
        """End a step that is under way before its goal, with an ``InterruptedStepError``."""
        if self.goal is not None:
            self.goal = None
            self._step.set_exception(InterruptedStepError(f"interrupted: {reason}"))

    def activate(self, active: bool) -> None:
        """Let commands act, or make drive and weight on bit zero."""
        self.run.control.activate(active)
        self.report()

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ in what may change while the drill runs."""
        before, self.settings = self.settings.real_time_factor, settings
        self.run.configure(settings)
        if settings.real_time_factor != before:
            self._pace()
        else:
            self.report()

    def _return_to_fork(self, fork: Run, *, continues: bool) -> None:
        """Go back to the instant of a fork.

        With ``continues`` stamps continue even where the node is the source of ``/clock``.
        """
        old, new = self.run, fork.copy()
        new.begin_streams()  # what was pending is of the time before the fork
        self.interrupt("the simulation was reset")
        self._flush()
        old.note("restore", name=_FORK)
        self.publishers.publish(old.entries())
        settings = self._with_present_pace(self._first_settings)
        own = self.stamp - new.time if continues else new.origin
        self._replace(new, settings, self._source.origin(new.time, own), old.control.active)

    def reset(self, time: bool, state: bool, seed: int | None = None) -> None:
        """Begin again; a fork goes back to its instant, and cannot have another seed.

        ``time`` says whether stamps begin again. ``state`` is the motion, commands, faults, and
        parameters as they were when it started, but for its pace. A ParameterError changes nothing.
        """
        if state and self._fork is not None:
            if seed not in (None, self._seed):
                raise ParameterError(f"seed = {seed}: a fork keeps its seed {self._seed}")
            self._return_to_fork(self._fork, continues=not time)
            return
        seed = self._seed if seed is None else seed
        settings = self._with_present_pace(self._first_settings)
        # First what can fail, as the scenario's file may be another one by now.
        new = self._new_run(settings, self.run.control.active, seed) if state else None
        self.interrupt("the simulation was reset")
        self._seed = seed
        self._flush()
        if new is not None:
            self._replace(new, settings, self._source.origin() if time else self.stamp)
            return
        if time:
            self.run.place(self._source.origin(self.run.time, -self.run.time))
        self._pace()

    def _hold(self, reason: str, playing: bool = False, at_start: bool = False) -> None:
        self.interrupt(reason)
        self.playing, self.at_start = playing, at_start
        self._pace()

    def _pace(self) -> None:
        """Begin a schedule if time goes on by itself, hold it otherwise; report."""
        self._publish_deferred()
        factor = 1.0 if self.follows_clock else self.settings.real_time_factor
        if self.playing:
            self.pacer.start(self.run.time, factor, self.stamp if self.follows_clock else None)
        else:
            self.pacer.stop()
        # A drill in a hurry takes all that it can get, and others must have their share.
        punctual = self.playing and 0.0 < factor <= 1.0
        priority = self.settings.thread_priority if punctual else 0
        self.reporter.scheduling = schedule_thread(priority)
        self.report()

    def _flush(self, kind: str = "flush") -> None:
        """Publish what the streams still hold: ``flush`` to go on, or ``end``."""
        self._publish_deferred()
        # One by one: the journal's entry arrives before the short blocks that follow from it, or a
        # recorder that ends in between has blocks which nothing explains.
        for message in self.run.flush(kind):
            self.publishers.publish([message])

    def _replace(
        self, run: Run, settings: Settings, origin: int, active: bool | None = None
    ) -> None:
        """Go on with another run after a reset, as ``_switch`` does, and with its settings."""
        self.settings = settings
        self._switch(run, origin, active)
        if active is not None:
            run.note_state()  # a recorder that came after the checkpoint cannot go back to it
        self.reporter.begin()
        self._restored(self.settings)
        self._pace()

    def _switch(self, run: Run, origin: int, active: bool | None = None) -> None:
        """Go on with a run whose simulation time zero has this stamp [ns].

        ``active`` is of a copied run, which goes on; None for one that begins.
        """
        self.run = run
        self.pacer.reset()
        planned = self._start.planned if self._start else ()
        self._planned = Agenda(change for change in planned if change.delay > run.time)
        if active is None:
            run.begin(origin)
        else:
            run.place(origin)
            run.control.activate(active)

    def _copy(self, start: Start, journal: Journal) -> Run:
        return start.run.copy(journal, self.publishers.wanted, self.reporter.add)

    def _new_run(self, settings: Settings, active: bool, seed: int | None = None) -> Run:
        beginning = Beginning.drawn(settings, self._seed if seed is None else seed)
        return Run(beginning, self._journal, self.publishers.wanted, active, self.reporter.add)

    def _with_present_pace(self, settings: Settings) -> Settings:
        return dataclasses.replace(settings, real_time_factor=self.settings.real_time_factor)
