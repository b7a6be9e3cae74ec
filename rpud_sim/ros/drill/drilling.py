"""The pacing thread: everything that moves the simulation, or changes it, happens here."""

from __future__ import annotations

import dataclasses
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future
from time import monotonic
from typing import TypeVar

from rclpy.node import Node

from rpud_sim.ros.drill.account import Account
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.namesakes import Namesakes
from rpud_sim.ros.drill.pacing import Pacer
from rpud_sim.ros.drill.parameters import Settings
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.drill.scheduling import schedule_thread
from rpud_sim.ros.drill.time_source import TimeSource
from rpud_sim.ros.requests import Requests
from rpud_sim.simulation.block import boundaries_until, boundary
from rpud_sim.simulation.control import Control
from rpud_sim.simulation.ensemble import initial_phases
from rpud_sim.simulation.journal import Journal
from rpud_sim.simulation.scenario import Scenario
from rpud_sim.simulation.simulation import Simulation

Result = TypeVar("Result")

_CLOCK_PERIOD = 0.1  # of /clock while time stands still [s]
_LONGEST_WAIT = 0.5  # so that a stop is noticed whatever happens to the event [s]


class InterruptedStepError(RuntimeError):
    """A step ended before its time; its text says why."""


class Drilling:
    """One drill in soft real time, from its activation to its end.

    Other threads have something done by ``request``; it is done between two blocks. Commands come
    through the inbox and take effect at block boundaries.

    Args:
        node: for its clock, its logger and the graph.
        settings: to begin with.
        outputs: to publish with.
        inbox: of commands.
        restored: takes the settings to which a reset went back.
        namesakes: of the node.
        end: simulation time after which it has finished [ns].
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        outputs: DrillPublishers,
        inbox: Inbox,
        restored: Callable[[Settings], None],
        namesakes: Namesakes,
        end: int = sys.maxsize,
    ) -> None:
        self._settings = self._first_settings = settings
        self._restored = restored
        self._outputs = outputs
        self._inbox = inbox
        self._end = end
        self._logger = node.get_logger()
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._failure: BaseException | None = None
        self._requests = Requests(self._wake.set)
        self._seed = settings.seed
        self._journal = Journal()
        self._playing = False
        self._at_start = False
        self._clock_due = 0.0
        self._goal: int | None = None
        self._step: Future[int] = Future()
        self._source = TimeSource(node, settings.publish_clock, self._wake.set)
        self._account = Account(node, settings, outputs, inbox, namesakes)
        self._thread = threading.Thread(target=self._run, name="pacing")
        inbox.notify(self._wake.set)
        self._begin(self._fresh(self._seed, settings), active=False)

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
        """Whether it has ended, for whatever reason."""
        return self._finished.is_set()

    @property
    def failure(self) -> BaseException | None:
        """What ended it before it was asked to stop, if anything did."""
        return self._failure

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
        self._outputs.begin(self._source.begin())
        self._account.report("inactive", self._simulation, self._control)

    def start(self, settings: Settings) -> None:
        """Begin, active, with settings that may have changed: simulation time zero is now."""
        self._settings = self._first_settings = settings
        self._journal = Journal()  # nobody has heard of what was before
        self._begin(self._fresh(self._seed, settings))
        self._journal.note(0, "origin", origin=self._outputs.origin)
        self._thread.start()

    def close(self) -> None:
        """Stop listening to the clock."""
        self._source.close()

    def stop(self) -> None:
        """End the drilling, and publish the last status."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def request(self, action: Callable[[], Result]) -> Result:
        """Have something done between two blocks; return what it returns, raise what it raises.

        The pacing thread does what it asks for itself at once.

        Raises:
            StoppedError: if the drilling has ended.
        """
        if threading.current_thread() is self._thread:
            return action()
        return self._requests.do(action)

    def wait(self, step: Future[int]) -> int:
        """Wait for the end of a step and return the simulation time that was reached [ns].

        Raises:
            InterruptedStepError: if it ended before its time.
            StoppedError: if the drilling has ended.
        """
        return self._requests.wait(step)

    # What follows is for the pacing thread, by way of request().

    @property
    def simulation(self) -> Simulation:
        """The simulation."""
        return self._simulation

    @property
    def control(self) -> Control:
        """What is commanded."""
        return self._control

    def play(self) -> None:
        """Let time go on by itself, from here on."""
        self._interrupt("the simulation was set to play")
        self._playing, self._at_start = True, False
        self._pace()
        self._report()

    def pause(self) -> None:
        """Let time stand still."""
        self._interrupt("the simulation was paused")
        self._playing = self._at_start = False
        self._pace()
        self._report()

    def halt(self) -> None:
        """Begin anew and let time stand still."""
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

    def activate(self, active: bool) -> None:
        """Let commands act, or make drive and weight on bit zero."""
        self._control.activate(active, self._simulation.time)
        self._control.act(self._simulation)
        self._report()

    def act_on_faults(self, act: Callable[[Simulation], None]) -> None:
        """Do something to the faults, and publish what came of it."""
        act(self._simulation)
        self._publish_faults()
        self._report()

    def configure(self, settings: Settings) -> None:
        """Take settings that differ in what may change while the drill runs."""
        before, self._settings = self._factor(), settings
        if self._factor() != before:
            self._pace()
        self._control.set(settings.command_timeout, settings.command_loss_ramp)
        self._simulation.configure(settings.configuration)
        self._report()

    def reset(self, time: bool, state: bool, seed: int | None = None) -> None:
        """Begin anew.

        Args:
            time: whether stamps begin anew.
            state: whether the drill begins anew: its motion, commands, faults, and parameters as
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
        fresh = self._fresh(seed, settings) if state else None
        self._interrupt("the simulation was reset")
        self._seed, self._settings = seed, settings
        now = self._simulation.time
        self._flush("flush")
        if fresh:
            self._begin(fresh, self._control.active)
            self._outputs.begin(self._source.begin(None if time else self._outputs.origin + now))
            self._note_origin()
            self._account.begin()
            self._restored(settings)
        elif time:
            self._outputs.move(self._source.begin() - now)
            self._note_origin()
        self._pace()
        self._publish_faults()
        self._report()

    def _fresh(self, seed: int, settings: Settings) -> tuple[Simulation, float, Scenario | None]:
        """A simulation, with the phase and the scenario with which it begins."""
        phase = initial_phases(1, seed or None)[0]
        scenario = settings.read_scenario(seed)
        return (
            Simulation(settings.configuration, phase, scenario, self._journal),
            phase,
            scenario,
        )

    def _begin(self, fresh: tuple[Simulation, float, Scenario | None], active: bool = True) -> None:
        settings = self._settings
        self._simulation, phase, scenario = fresh
        self._journal.begin(settings.values(), phase, self._seed, scenario)
        self._pacer = Pacer(settings.telemetry_rate, self._factor(), schedule=self._source.schedule)
        self._control = Control(
            self._simulation.applied, settings.command_timeout, settings.command_loss_ramp, active
        )
        self._control.act(self._simulation)
        self._outputs.reseed(self._seed)

    def _run(self) -> None:
        # Whatever ends the thread must end the process too, or it would go on in silence.
        try:
            self._drill()
        except Exception as error:
            self._failure = error
        finally:
            self._finished.set()
            self._interrupt("the drill has stopped")
            self._requests.close()

    def _drill(self) -> None:
        settings = self._settings
        # The first line that a process logs takes tens of milliseconds: before time zero, then.
        parameters = settings.configuration.parameters
        self._logger.info(
            f"drilling: regime {parameters.regime}, weight on bit {parameters.weight_on_bit:g} N, "
            f"drive {'on' if settings.configuration.drive_enabled else 'off'}"
        )
        self._outputs.begin(self._source.wait(self._stop, self._requests.serve))
        self._note_origin()
        self._playing = self._source.follows or not settings.start_paused
        self._pace()
        self._account.finish()
        self._publish_faults()
        self._report()
        while not self._stop.is_set() and self._simulation.time < self._end:
            self._serve()
            self._publish_journal()
            until = self._next_block()
            remaining = self._pacer.remaining(until) if self._goal is None else 0.0
            if self._goal is None and not self._playing:
                self._stand_still()
            elif remaining > 0.0:
                if self._account.due():
                    self._report()
                self._wait(remaining)
            else:
                self._advance(until)
        self._flush("end")
        self._account.finish()
        self._report("stopped")

    def _serve(self) -> None:
        self._requests.serve()
        if self._source.went_back():
            self._logger.warning("/clock went back: the drill begins anew")
            self.reset(time=True, state=True)

    def _next_block(self) -> int:
        rate = self._settings.telemetry_rate
        until = boundary(boundaries_until(self._simulation.time, rate) + 1, rate)
        return until if self._goal is None else min(until, self._goal)

    def _stand_still(self) -> None:
        if self._take_commands() or self._account.due():
            self._report()
        now = monotonic()
        if now >= self._clock_due:
            self._outputs.publish_clock(self._simulation.time)
            self._clock_due = now + _CLOCK_PERIOD
        self._wait(_CLOCK_PERIOD)

    def _wait(self, seconds: float) -> None:
        self._wake.wait(min(seconds, _LONGEST_WAIT))
        self._wake.clear()

    def _factor(self) -> float:
        return 1.0 if self._source.follows else self._settings.real_time_factor

    def _pace(self) -> None:
        """Begin a schedule here and now if time goes on by itself, and hold it otherwise."""
        if self._playing:
            now = self._simulation.time
            self._pacer.start(now, self._source.resume(now), self._factor())
        else:
            self._pacer.stop()
        # A drill in a hurry takes all that it can get, and others must have their share.
        punctual = self._playing and 0.0 < self._factor() <= 1.0
        priority = self._settings.thread_priority if punctual else 0
        self._account.scheduling = schedule_thread(priority)

    def _advance(self, until: int) -> None:
        block = self._simulation.advance_to(until)
        rate = self._settings.telemetry_rate
        if boundary(boundaries_until(until, rate), rate) != until:
            self._journal.note(until, "stop")
            self._publish_journal()
        # Where nothing paces it, its listeners do.
        self._outputs.patient = self._goal is not None or self._factor() == 0.0
        self._outputs.publish_block(block, self._simulation.faults.since(block.start))
        self._publish_faults()
        commanded = self._take_commands()
        self._pacer.finish(until)
        # What nobody waits for takes its time behind the block.
        self._outputs.publish_streams(block)
        self._account.add(block)
        for refusal in self._simulation.take_refusals():
            self._logger.warning(refusal)
        reached = self._goal is not None and until >= self._goal
        if reached:
            self._goal = None
        if commanded or reached or self._account.due():
            self._report()
        if reached:
            self._step.set_result(until)

    def _take_commands(self) -> bool:
        """Let waiting commands act; tell whether anything changed that the status shows."""
        commands = self._inbox.take()
        for command in commands:
            self._control.take(command, self._simulation)
        changed = self._control.act(self._simulation)
        return bool(commands) or changed or self._account.refused_more()

    def _interrupt(self, reason: str) -> None:
        if self._goal is not None:
            self._goal = None
            self._step.set_exception(InterruptedStepError(reason))

    def _flush(self, kind: str) -> None:
        """Publish all that there is until now, and before that what it comes of."""
        self._journal.note(self._simulation.time, kind)
        self._publish_journal()
        self._outputs.flush()

    def _note_origin(self) -> None:
        self._journal.note(self._simulation.time, "origin", origin=self._outputs.origin)

    def _publish_journal(self) -> None:
        self._outputs.publish_journal(self._journal.take())

    def _publish_faults(self) -> None:
        self._outputs.publish_faults(self._simulation.faults, self._simulation.time)

    def _report(self, state: str = "") -> None:
        if not state:
            state = "running" if self._playing or self._goal is not None else "paused"
            state = "stopped" if self._at_start else state
            state = state if self._control.active else "inactive"
        self._account.report(state, self._simulation, self._control, self._pacer)
