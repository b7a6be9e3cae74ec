"""The drill in soft real time: blocks, commands, steps, resets and reports, without a thread."""

from __future__ import annotations

import dataclasses
import sys
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future

from rclpy.node import Node

from rpud_sim.ros.drill.account import Account
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.scheduling import schedule_thread
from rpud_sim.ros.drill.time_source import TimeSource
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.run import Beginning, Run
from rpud_sim.simulation.simulation import Simulation

# A block is computed this long before its deadline, at most half a block [s]. Until then requests
# and parameters still act at the beginning of the block, so that services answer at once.
_LEAD = 0.005
_STANDSTILL_PERIOD = 0.1  # of /clock while time stands still [s]
_STREAMS = ("waveform", "trajectory")


class InterruptedStepError(RuntimeError):
    """A step ended before its time; its text says why."""


class Drilling:
    """One drill, from its activation to its end, as the pacing thread moves it.

    Every method is for that thread; others reach it by ``PacingThread.request``. Commands come
    through the inbox and take effect at block boundaries.

    Args:
        node: for its clock, its logger and the graph.
        settings: to begin with.
        publishers: to publish with.
        account: of what it does.
        inbox: of commands.
        wake: called when the time source has moved.
        restored: called with the settings to which a reset went back.
        end: simulation time after which it has finished [ns].

    Raises:
        ParameterError: if the scenario cannot be used.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        publishers: DrillPublishers,
        account: Account,
        inbox: Inbox,
        wake: Callable[[], None],
        restored: Callable[[Settings], None],
        end: int = sys.maxsize,
    ) -> None:
        self._settings = self._first_settings = settings
        self._restored = restored
        self._publishers = publishers
        self._account = account
        self._inbox = inbox
        self._end = end
        self._logger = node.get_logger()
        self._seed = settings.seed
        self._journal: Journal | None = None
        self._playing = False
        self._at_start = False
        self._clock_due = 0.0
        self._goal: int | None = None
        self._step: Future[int] = Future()
        self._source = TimeSource(node, settings.publish_clock, wake)
        self._use(self._new_run(self._seed, settings, active=False), 0)

    @property
    def run(self) -> Run:
        """The run."""
        return self._run

    @property
    def account(self) -> Account:
        """What it has done so far."""
        return self._account

    @property
    def settings(self) -> Settings:
        """What it runs with."""
        return self._settings

    @property
    def finished(self) -> bool:
        """Whether simulation time has reached its end."""
        return self._run.time >= self._end

    @property
    def playing(self) -> bool:
        """Whether time goes on by itself."""
        return self._playing

    @property
    def at_start(self) -> bool:
        """Whether it was stopped, and neither paused nor played since."""
        return self._at_start

    @property
    def stepping(self) -> bool:
        """Whether a step is under way."""
        return self._goal is not None

    @property
    def follows_clock(self) -> bool:
        """Whether its time is that of another source of ``/clock``."""
        return self._source.follows

    def announce(self) -> None:
        """Publish status and diagnostics of a drilling that has not started."""
        self._run.place(self._source.begin())
        self._account.report("inactive", self._run)

    def begin(self, settings: Settings) -> None:
        """Begin, active and with a journal, with settings that may have changed.

        Raises:
            ParameterError: if the scenario cannot be used; nothing changes then.
        """
        origin = self._run.origin
        self._journal = Journal()
        run = self._new_run(self._seed, settings, active=True)
        self._settings = self._first_settings = settings
        self._use(run, origin)

    def start(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Let simulation time begin, now or with the first ``/clock``.

        Args:
            stop: ends the wait for ``/clock``.
            serve: called again and again during that wait.
        """
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        configuration = self._settings.configuration
        self._logger.info(
            f"drilling: regime {configuration.parameters.regime}, "
            f"weight on bit {configuration.parameters.weight_on_bit:g} N, "
            f"drive {'on' if configuration.drive_enabled else 'off'}"
        )
        self._run.place(self._source.wait(stop, serve))
        self._playing = self._source.follows or not self._settings.start_paused
        self._pace()
        self._account.finish()
        self._report()

    def advance(self) -> float:
        """Do what is due now; return for how long nothing more is due [s]."""
        if self._source.went_back():
            self._logger.warning("/clock went back: the drill begins again")
            self.reset(time=True, state=True)
        until = self._run.next_boundary
        if self._goal is not None:
            self._advance_to(min(until, self._goal))
        elif not self._playing:
            self._stand_still()
            return _STANDSTILL_PERIOD
        elif (early := self._pacer.remaining(until) - self._lead()) > 0.0:
            if self._account.due():
                self._report()
            return early
        else:
            self._advance_to(until)
        return 0.0

    def finish(self) -> None:
        """Publish what is left, and the last status."""
        self._publishers.publish(self._run.flush("end"))
        self._account.finish()
        self._report("stopped")

    def close(self) -> None:
        """Stop listening to the clock."""
        self._source.close()

    def play(self) -> None:
        """Let time go on by itself, from here on."""
        self.interrupt("the simulation was set to play")
        self._playing, self._at_start = True, False
        self._pace()
        self._report()

    def pause(self) -> None:
        """Let time stand still."""
        self.interrupt("the simulation was paused")
        self._playing = self._at_start = False
        self._pace()
        self._report()

    def halt(self) -> None:
        """Begin again and let time stand still."""
        self.reset(time=True, state=True)
        self._playing, self._at_start = False, True
        self._pace()
        self._report()

    def step(self, until: int) -> Future[int]:
        """Let a paused simulation go on to a simulation time [ns]; the result is that time."""
        if self._take_commands():  # they were given before
            self._report()
        self._goal = until
        self._step = Future()
        return self._step

    def interrupt(self, reason: str) -> None:
        """End a step that is under way before its time."""
        if self._goal is not None:
            self._goal = None
            self._step.set_exception(InterruptedStepError(reason))

    def activate(self, active: bool) -> None:
        """Let commands act, or make drive and weight on bit zero."""
        self._run.control.activate(active)
        self._report()

    def act_on_faults(self, act: Callable[[Simulation], None]) -> None:
        """Inject or clear faults, and publish the change."""
        act(self._run.simulation)
        self._report()

    def configure(self, settings: Settings) -> None:
        """Put settings into force that differ in what may change while the drill runs."""
        before, self._settings = self._factor(), settings
        if self._factor() != before:
            self._pace()
        self._run.configure(settings)
        self._report()

    def reset(self, time: bool, state: bool, seed: int | None = None) -> None:
        """Begin again.

        Args:
            time: whether stamps begin again.
            state: whether the drill begins again: its motion, commands, faults, and parameters as
                they were when it started, but for its pace.
            seed: in place of the present one.

        Raises:
            ParameterError: if the scenario cannot be used; nothing changes then.
        """
        seed = self._seed if seed is None else seed
        settings = self._settings
        if state:
            settings = dataclasses.replace(
                self._first_settings, real_time_factor=settings.real_time_factor
            )
        # First what can fail, as the scenario's file may be another one by now.
        new = self._new_run(seed, settings, self._run.control.active) if state else None
        self.interrupt("the simulation was reset")
        self._seed, self._settings = seed, settings
        old = self._run
        self._publishers.publish(old.flush())
        if new is not None:
            self._use(new, self._source.begin(None if time else old.origin + old.time))
            self._account.begin()
            self._restored(settings)
        elif time:
            old.place(self._source.begin() - old.time)
        self._pace()
        self._report()

    def _new_run(self, seed: int, settings: Settings, active: bool) -> Run:
        return Run(
            Beginning.drawn(settings, seed),
            self._journal,
            self._publishers.wanted,
            active,
            self._account.add,
        )

    def _use(self, run: Run, origin: int) -> None:
        self._run = run
        self._pacer = Pacer(
            self._settings.telemetry_rate, self._factor(), schedule=self._source.schedule
        )
        run.begin(origin)

    def _stand_still(self) -> None:
        if self._take_commands() or self._account.due():
            self._report()
        now = time.monotonic()
        if now >= self._clock_due:
            self._publishers.publish_clock(self._run.origin + self._run.time)
            self._clock_due = now + _STANDSTILL_PERIOD

    def _factor(self) -> float:
        return 1.0 if self._source.follows else self._settings.real_time_factor

    def _lead(self) -> float:
        """How long before its deadline a block is computed [s].

        Not with the time of another source: it may stand still just then, and requests with it.
        """
        factor = self._factor()
        if self._source.follows or factor == 0.0:
            return 0.0
        return min(_LEAD, 0.5 / (self._settings.telemetry_rate * factor))

    def _pace(self) -> None:
        """Begin a schedule here and now if time goes on by itself, and hold it otherwise."""
        if self._playing:
            now = self._run.time
            self._pacer.start(now, self._source.resume(now), self._factor())
        else:
            self._pacer.stop()
        # A drill in a hurry takes all that it can get, and others must have their share.
        punctual = self._playing and 0.0 < self._factor() <= 1.0
        priority = self._settings.thread_priority if punctual else 0
        self._account.scheduling = schedule_thread(priority)

    def _advance_to(self, until: int) -> None:
        """Compute a block, publish it at its deadline, and let commands act at its end."""
        messages = self._publishers.encode(self._run.advance_to(until))
        # Where nothing paces it, its subscribers do.
        self._publishers.patient = self._goal is not None or self._factor() == 0.0
        if self._goal is None and (early := self._pacer.remaining(until)) > 0.0:
            time.sleep(early)
        self._publishers.publish_clock(self._run.origin + until)
        self._publishers.send(each for each in messages if each[0] not in _STREAMS)
        commanded = self._take_commands()
        self._pacer.finish(until)
        # Streams are large, and wait for no deadline.
        self._publishers.send(each for each in messages if each[0] in _STREAMS)
        for refusal in self._run.simulation.drain_refusals():
            self._logger.warning(refusal)
        reached = self._goal is not None and until >= self._goal
        if reached:
            self._goal = None
        if commanded or reached or self._account.due():
            self._report()
        if reached:
            self._step.set_result(until)

    def _take_commands(self) -> bool:
        """Let waiting commands act; return whether anything changed that the status shows."""
        commands = self._inbox.drain()
        for command in commands:
            self._run.control.apply(command)
        changed = self._run.control.act()
        return bool(commands) or changed or self._account.refused_more()

    def _report(self, state: str = "") -> None:
        if not state:
            state = "running" if self._playing or self._goal is not None else "paused"
            state = "stopped" if self._at_start else state
            state = state if self._run.control.active else "inactive"
        self._publishers.publish(self._run.changes())
        self._account.report(state, self._run, self._pacer)
