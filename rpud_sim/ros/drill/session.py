"""Session of the drill: its run and the publishers, from the node's configuration to clean-up."""

from __future__ import annotations

import dataclasses
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path

from ament_index_python.packages import get_package_share_directory
from rclpy.node import Node

from rpud_sim.foundation.options import SEED_OR_NONE
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import NEVER, SECOND
from rpud_sim.ros.drill.commands import Inbox
from rpud_sim.ros.drill.drawn_order import ShuffledOrder
from rpud_sim.ros.drill.health import StatusReporter
from rpud_sim.ros.drill.managed_node import DuplicateNodes
from rpud_sim.ros.drill.publishers import DrillPublishers, Encoded
from rpud_sim.ros.drill.timeline import Reached, Timeline
from rpud_sim.ros.process import robot_description
from rpud_sim.ros.threads import schedule_thread
from rpud_sim.simulation.block import Block, boundaries_until, boundary
from rpud_sim.simulation.changes import Clear, Configure, SetOrigin
from rpud_sim.simulation.configuration import CHANGEABLE, Settings
from rpud_sim.simulation.plan import Beginning, Journal, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.topics import offered_topics

_PART = 0.0002  # that a part of the work without a deadline takes [s]
_STANDSTILL_PERIOD = 0.1  # of /clock while time is paused [s]
_STEP_PART = SECOND // 10  # of a step with subscribers: commands act between two parts [ns]


class Session:
    """Run of the drill under commands, and those after resets; their timeline and messages.

    From ``begin`` on every method is for the pacing loop; any thread may read the attributes.
    The run begins at time zero, or where a ``plan`` continues live, and is over at ``end`` [ns].
    ``restored`` is called with the settings that a reset restored.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        inbox: Inbox,
        duplicates: DuplicateNodes,
        restored: Callable[[Settings], None] = lambda settings: None,
        end: int = sys.maxsize,
        plan: Plan | None = None,
    ) -> None:
        self.settings = self._first_settings = settings  # active
        self._seed: int | None = None  # that a reset gave
        self._journal: Journal | None = None  # from ``begin`` on
        self._inbox = inbox
        self._restored = restored
        self._end = end
        self._plan = plan
        self._computing = False  # whether a run is on its way to where its plan continues live
        self._unreported = False  # whether the status lacks changes
        self._lost = False  # whether commands were lost when they acted last
        self._shuffle = 0  # seed of the order among topics in the current step; 0 for their times
        self._clock_due = 0.0
        self._logger = node.get_logger()
        offered = offered_topics(settings.values())
        self.publishers = DrillPublishers(
            node, settings.publish_clock, offered, _description_of(settings)
        )
        self.reporter = StatusReporter(
            node, settings.telemetry_rate, self.publishers, inbox, duplicates
        )
        try:
            self.run = self._new_run(self._drawn(settings, self._seed), active=plan is not None)
            self._start_run(self.run)
        except Exception:
            self.publishers.destroy()  # or the next configuration would have each topic twice
            raise
        self.timeline = Timeline(node, settings, inbox.notify, self._pace)

    @property
    def stamp(self) -> int:
        """Stamp of the current simulation time [ns]."""
        return self.run.origin + self.run.time

    @property
    def state(self) -> str:
        """State, as ``rpud_msgs/Status`` names it."""
        return self.timeline.state if self.run.active else "inactive"

    @property
    def finished(self) -> bool:
        """Whether simulation time has reached its end."""
        return self.run.time >= self._end

    @property
    def next_end(self) -> int:
        """Simulation time up to which to advance next [ns]: the end of a block.

        In a step it is the end of many blocks, as far as nothing has to happen between: a status, a
        loss of commands, a planned change, or a tick of ``/clock``.
        """
        run, goal, rate = self.run, self.timeline.goal, self._first_settings.telemetry_rate
        end = run.next_boundary
        if goal is not None and not self.publishers.sets_pace:
            part = _STEP_PART if self.publishers.followed else SECOND
            full_second = (run.time // SECOND + 1) * SECOND
            limit = min(run.time + part, full_second, run.next_watch, goal)
            end = max(end, boundary(boundaries_until(limit, rate), rate))
        return min(end, run.next_change, NEVER if goal is None else goal)

    def announce(self) -> None:
        """Publish status and diagnostics before the beginning."""
        self._set_origin()
        self.reporter.report("inactive", self.run, self.timeline.pacer)
        self.reporter.publish_diagnostics()

    def begin(self, settings: Settings) -> None:
        """Begin, active and with a journal, with settings that may have changed."""
        self.settings = self._first_settings = settings
        self._journal = Journal()
        origin = self.run.origin
        run = self._new_run(self._drawn(settings, self._seed), active=True)
        self._start_run(run)
        self._change_parameters(run, settings)  # of a plan, set since the node was made
        self._switch(run, origin)

    def start_time(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Let simulation time begin, now or with the first ``/clock``, until a stop."""
        configuration, status = self.settings.configuration, self.run.status().fields
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        self._logger.info(
            f"drilling: regime {configuration.parameters.regime}, "
            f"weight on bit {status['weight_on_bit']:g} N, "
            f"drive {'on' if configuration.drive_enabled else 'off'}"
        )
        self.timeline.source.wait(stop, serve)
        self._set_origin()
        if self.timeline.source.follows or not self.settings.start_paused:
            self.timeline.play()
        else:
            self.timeline.pause()

    def finish(self) -> None:
        """Publish what is left, and the last status."""
        self._flush(ends=True)
        self.reporter.end_period()
        self.report("stopped")

    def deliver(self) -> None:
        """Wait until running subscribers have the last messages; log what one may lack."""
        for line in self.publishers.deliver():
            self._logger.warning(line)

    def close(self) -> None:
        """Stop listening to the clock, and destroy the publishers."""
        self.timeline.source.close()
        self.publishers.destroy()

    # What the pacing loop does again and again.

    def publish_clock_at_standstill(self) -> float:
        """Publish ``/clock`` now and then; return when to look again [s]."""
        if time.monotonic() >= self._clock_due:
            self.publishers.publish_clock(self.stamp)
            self._clock_due = time.monotonic() + _STANDSTILL_PERIOD
        return _STANDSTILL_PERIOD

    def follow_clock(self) -> None:
        """Restart where another's ``/clock`` has jumped.

        A jump cannot be rejected: if the scenario's file has become invalid, the run begins as
        it last did.
        """
        if jump := self.timeline.source.jumped:
            self._logger.warning(f"/clock {jump}: the drill restarts")
            try:
                self.reset(time=True, state=True)
            except ParameterError as error:
                self._logger.error(f"{error}: the drill restarts as it last began")
                self.reset(time=True, state=True, plan=Plan(self.run.beginning))

    def advance(self, until: int) -> tuple[list[Encoded], list[int]]:
        """Compute the block up to a time [ns]; return its messages, and the times of impacts."""
        planned, stepping = self.run.next_change, self.timeline.goal is not None
        # Without deadlines there is no better time for what may be deferred.
        batches = list(self.run.advance_to(until, None if stepping else self.publishers.defer))
        self._unreported |= self.run.next_change != planned
        # Without deadlines its subscribers set the pace.
        self.publishers.patient = not self.timeline.pacer.paces
        struck = [each.publish_times.tolist() for each in batches if each.topic == "contact_force"]
        return self.publishers.encode(batches), [time for times in struck for time in times]

    def publish(self, messages: list[Encoded], impacts: list[int]) -> None:
        """Publish the messages of a block at its deadline."""
        pacer = self.timeline.pacer
        if self.timeline.goal is not None and self._shuffle:
            order = ShuffledOrder(self._shuffle, self._first_settings.telemetry_rate)
            self.publishers.send_shuffled(messages, self.run.time, self.stamp, order)
        else:
            self.publishers.publish_clock(self.stamp)
            self.publishers.send(messages)
        pacer.finish(self.run.time)
        if pacer.paces:
            for struck in impacts:
                self.reporter.impact_delays.add(pacer.delay_since(struck))

    def act(self) -> None:
        """Let waiting commands act, and publish what changed."""
        taken = self._inbox.drain(self.run.apply)
        if taken or self.run.time >= self.run.next_action_time:
            self.run.watch()
        lost, self._lost = self._lost, self.run.commands_lost
        if self._lost and not lost:
            self._logger.warning("commands are lost: the drill is put into the safe state")
        if taken or lost is not self._lost or self.reporter.refused_more():
            self._unreported = True
            if not self.timeline.standing:
                self.publish_changes()

    def publish_deferred(self, until: int | None = None) -> None:
        """Publish what has no deadline, as far as there is time before a simulation time [ns]."""

        def has_time() -> bool:
            return until is None or self.timeline.pacer.remaining(until) > _PART

        if has_time():
            self.reporter.publish_diagnostics()
        self.publishers.publish_deferred(has_time)

    def report_if_due(self) -> None:
        """Report what changed, and at every second; end a step at its goal.

        In a step a test waits for each change. While time plays, reports of changes keep a
        distance.
        """
        timeline = self.timeline
        stepping = timeline.goal is not None
        due = self.run.time % SECOND == 0 if stepping else self.reporter.due()
        due |= self._unreported and (not timeline.playing or self.reporter.rested)
        reached = timeline.goal is not None and self.run.time >= timeline.goal
        if reached:
            timeline.goal = None
        if due or reached:
            self.report(waits=timeline.standing and not reached)
        if reached or (due and not stepping):
            undelivered = self.publishers.undelivered()
            for line in undelivered:
                self._logger.warning(line)
        if reached:
            status = self.reporter.last.status if self.reporter.last is not None else {}
            failure = "; ".join(line for line, fails in undelivered.items() if fails)
            timeline.reach(Reached(self.stamp, self.publishers.published, status, failure))

    def report(self, state: str = "", *, waits: bool = False) -> None:
        """Publish changes and the status, in the current state or another one.

        With ``waits`` the journal's entries are not published yet: at a standstill more commands
        may come for the same time, and their order must not depend on which arrives first.
        """
        self._unreported = False
        if not waits:
            self.publish_changes()
        self.reporter.report(state or self.state, self.run, self.timeline.pacer)
        if state or not self.timeline.pacer.ahead:
            self.reporter.publish_diagnostics()

    def publish_changes(self) -> None:
        """Publish the journal's entries so far, and faults that have changed."""
        self.publishers.publish(self.run.changes())

    # What services and parameters do.

    def halt(self) -> None:
        """Begin again and pause time."""
        self.reset(time=True, state=True)
        self.timeline.stop()

    def step(self, goal: int, shuffle: int = 0) -> Future[Reached]:
        """Let a paused simulation continue to a simulation time [ns], or raise a ParameterError.

        Unless ``shuffle`` is 0, it draws the order of the messages on different topics.
        """
        self.timeline.check_step(self.run.time, goal)
        self._shuffle = shuffle
        self.publishers.own.renew()
        self.act()  # commands were given before
        if self._unreported:
            self.report()
        return self.timeline.step(goal)

    def activate(self, active: bool) -> None:
        """Let commands act, or make drive and weight on bit zero."""
        self.run.activate(active)
        self.report()

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ in what may change while the drill runs."""
        before, self.settings = self.settings.real_time_factor, settings
        self._change_parameters(self.run, settings)
        if settings.real_time_factor != before:
            self._pace()
        else:
            self.report()

    def reset(
        self,
        time: bool,
        state: bool,
        faults: bool = False,
        seed: int | None = None,
        plan: Plan | None = None,
    ) -> None:
        """Begin again, stamps or state or both; a fork goes back to its instant, with its seed.

        Without ``state``, ``faults`` are cleared, and the next reset of the state has the seed.
        A ``plan`` replaces the one that settings and seed draw. The pace stays as it is. A
        ParameterError changes nothing.
        """
        if self._plan and seed not in (None, kept := self._plan.beginning.seed):
            raise ParameterError(f"seed = {seed}: a fork keeps its seed {kept}")
        seed = self._seed if seed is None else int(SEED_OR_NONE.check("seed", seed))
        pace = self.settings.real_time_factor
        settings = dataclasses.replace(self._first_settings, real_time_factor=pace)
        active, source = self.run.active, self.timeline.source
        # First what can fail, as the scenario's file may be another one by now.
        new = self._new_run(plan or self._drawn(settings, seed), active) if state else None
        if faults and not state:
            self.run.apply(Clear())
            self.report()
        self.timeline.interrupt("the simulation was reset")
        self._seed = seed
        self._flush()
        if new is not None:
            stamp = self.stamp
            self._start_run(new)
            self._change_parameters(new, settings)  # of a plan, whose parameters are older
            own = source.origin(new.time, new.origin) if time else stamp - new.time
            self._switch(new, own)
            self.settings = settings
            self.reporter.begin()
            self._restored(settings)
        elif time:
            self.run.apply(SetOrigin(source.origin(self.run.time, -self.run.time)))
        self._pace()

    def _set_origin(self) -> None:
        self.run.apply(SetOrigin(self.timeline.source.origin(self.run.time)))
        self.reporter.end_period()

    def _pace(self) -> None:
        """Begin a schedule if time continues by itself, hold it otherwise; report."""
        self.publish_deferred()
        punctual = self.timeline.pace(self.run.time, self.stamp, self.settings.real_time_factor)
        # Above real time it takes all that it can get, and others must get processor time.
        self.reporter.scheduling = schedule_thread(self.settings.thread_priority * punctual)
        self.report()

    def _flush(self, *, ends: bool = False) -> None:
        """Publish what the streams still hold, to continue or at the end."""
        self.publish_deferred()
        # One by one: the journal's entry arrives before the short blocks that follow from it, or a
        # recorder that ends in between has blocks which nothing explains.
        for batch in self.run.flush(ends=ends):
            self.publishers.publish([batch])

    def _drawn(self, settings: Settings, seed: int | None) -> Plan:
        return self._plan or Plan(Beginning.drawn(settings, seed))

    def _new_run(self, plan: Plan, active: bool) -> Run:
        return Run(
            plan,
            self._journal,
            lambda topic: not self._computing and topic in self.publishers.wanted,
            active=active,
            on_block=self._count,
            rejected=lambda change, error: self._logger.warning(
                f"planned change rejected: {error}"
            ),
        )

    def _start_run(self, run: Run) -> None:
        """Start the journal of a run, and compute it up to where its plan continues live."""
        active = run.active
        run.begin()
        if self._plan is not None:
            self._computing = True
            for batch in run.advance_to(self._plan.live_from):
                if batch.topic == "journal":
                    self.publishers.publish([batch])
            self._computing = False
        run.take_over()
        run.activate(active)

    def _change_parameters(self, run: Run, settings: Settings) -> None:
        """Give a run the values of settings that may change during it."""
        values, before = settings.values(), run.settings.values()
        changed = {name: values[name] for name in CHANGEABLE if values[name] != before[name]}
        if changed:
            run.apply(Configure(changed))

    def _switch(self, run: Run, origin: int) -> None:
        """Continue with a run at whose simulation time zero the stamp is ``origin`` [ns]."""
        self.run = run
        self.publishers.begin()
        self.timeline.pacer.reset()
        run.apply(SetOrigin(origin))

    def _count(self, block: Block) -> None:
        if not self._computing:
            self.reporter.add(block)


def _description_of(settings: Settings) -> str:
    """Return the URDF of a drill that publishes it; empty otherwise."""
    if not settings.publish_robot_description:
        return ""
    drill = settings.configuration
    folder = Path(get_package_share_directory("rpud_sim"), "urdf")
    return robot_description(folder, drill.has_feed, drill.rotates, settings.frame_prefix)
