"""Timeline of the drill: its time plays, pauses or steps; its source, and deadlines."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import NamedTuple

from rclpy.clock import JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node
from rpud_msgs.msg import Result

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Fields
from rpud_sim.ros.threads import DelayHistogram, RequestError
from rpud_sim.simulation.configuration import Settings

INTERRUPTED = Result.RESULT_OPERATION_FAILED  # result of a step that ends before its goal
LONGEST_STEP = 1e6  # [s]; longer than any mission
# Between two ticks of another's ``/clock``, as far as its time continues: more is another time [s].
LONGEST_TICK = 10.0
# Of another's ``/clock``: later stamps of the drill would not fit into messages [s].
LATEST_TICK = 2**31 - 1 - LONGEST_STEP
# A block is computed this long before its deadline, or right after the block before [s]. Requests
# and parameters wait for its end from then on: with a longer lead services would answer late.
LEAD = 0.01


class Reached(NamedTuple):
    """End of a step."""

    stamp: int  # of the simulation time that was reached [ns]
    published: Mapping[str, int]  # messages by topic until then, since its publisher exists
    status: Fields  # at the end
    failure: str = ""  # what was not delivered


class TimeSource:
    """Clock of the drill: this machine's, another's ``/clock``, or its own if it ``publishes``.

    ``notify`` is called when another's ``/clock`` moves.
    """

    def __init__(
        self, node: Node, publishes: bool, notify: Callable[[], None] = lambda: None
    ) -> None:
        self._clock = node.get_clock()
        self._logger = node.get_logger()
        self._publishes = publishes
        self._notify = notify
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        # Whether the time comes from another source of ``/clock``.
        self.follows = simulated and not publishes
        # The time that a schedule follows [ns]; None for the monotonic clock.
        self.schedule = self._now if self.follows else None
        # How another's ``/clock`` has jumped since the latest origin; empty if it has not.
        self.jumped = ""
        self._latest = 0  # time of its last tick [ns]
        self._noted = False  # whether a pause was noted
        self._jumps = None
        if self.follows:
            every = JumpThreshold(
                min_forward=Duration(nanoseconds=1),
                min_backward=Duration(nanoseconds=-1),
                on_clock_change=False,
            )
            self._jumps = self._clock.create_jump_callback(every, post_callback=self._on_jump)

    def wait(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Wait until there is a time; ``serve`` is called again and again meanwhile."""
        if self.follows and self._now() == 0:
            self._logger.info("waiting for /clock, as use_sim_time is set")
            while self._now() == 0 and not stop.wait(0.01):
                serve()

    def origin(self, time: int = 0, own: int = 0) -> int:
        """Return the stamp of time zero for a time now [ns]; ``own`` of a source of the clock."""
        self.jumped = ""
        return own if self._publishes else self._now() - time

    def note_pause(self) -> None:
        """Say at the first pause that stamps lag from now on, if they are of no ``/clock``."""
        if not (self._publishes or self.follows or self._noted):
            self._noted = True
            self._logger.info(
                "paused: from now on stamps are behind the clock of this machine, and tf and "
                "message filters may drop them; with publish_clock other nodes follow this time"
            )

    def close(self) -> None:
        if self._jumps is not None:
            self._jumps.unregister()
            self._jumps = None

    def _now(self) -> int:
        now = int(self._clock.now().nanoseconds)
        if now <= LATEST_TICK * SECOND:
            return now
        self._logger.warning(
            f"/clock = {now / SECOND:.10g} s is left out: allowed is [0, {LATEST_TICK:.10g}] s",
            throttle_duration_sec=10.0,
        )
        return self._latest

    def _on_jump(self, jump: TimeJump) -> None:
        before, self._latest = self._latest, self._now()
        ahead = (self._latest - before) / SECOND
        if jump.delta.nanoseconds < 0:
            self.jumped = self.jumped or "went back"
        elif before and ahead > LONGEST_TICK:
            self.jumped = self.jumped or f"jumped {ahead:.9g} s ahead"
        self._notify()


class Pacer:
    """Deadlines of simulation times, on an absolute schedule of blocks at a whole rate [Hz].

    Simulation time t is due t / factor after the start, so that it never drifts; 0 is as fast as
    possible. Another ``schedule`` [ns] than the monotonic ``clock`` [ns] goes in steps.
    """

    def __init__(
        self,
        rate: int,
        schedule: Callable[[], int] | None = None,
        clock: Callable[[], int] = time.monotonic_ns,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._rate = rate
        self._factor = 1.0
        self._clock = clock
        self._schedule = schedule or clock
        self._in_steps = schedule is not None
        self._sleep = sleep
        self.reset()

    @property
    def paces(self) -> bool:
        """Whether blocks have deadlines: it is started, and the factor is not zero."""
        return self._running and self._factor != 0.0

    @property
    def ahead(self) -> bool:
        """Whether blocks are computed ahead of their deadlines."""
        return self.paces and not self._in_steps

    def reset(self) -> None:
        """Count from zero, and hold the schedule until the next start."""
        self._running = False
        self._blocks = self._missed = 0
        self._lateness = self._lateness_max = 0.0
        self._all = DelayHistogram()  # latenesses
        self._start = self._start_time = self._time = self._read_time = 0
        self._begun = 0  # when the remaining time was asked for last, on the schedule
        self._read_at = self._clock()

    def start(self, time: int, factor: float, at: int | None = None) -> None:
        """Begin a schedule: simulation time [ns] is due at a time of the schedule, now if None."""
        self._running = True
        self._factor = factor
        self._start = self._schedule() if at is None else at
        self._time = self._start_time = time

    def stop(self) -> None:
        """Hold the schedule: until the next start nothing is due, late or behind."""
        self._running = False

    def remaining(self, time: int) -> float:
        """Time until a simulation time [ns] is due [s], zero or less if it is."""
        if self._factor == 0.0:
            return 0.0
        self._begun = self._schedule()
        return (self._due(time) - self._begun) / SECOND

    def idle(self, time: int) -> float:
        """Time until the block that ends at a simulation time [ns] is to be computed [s]."""
        lead = min(LEAD, 1.0 / (self._rate * self._factor)) if self.ahead else 0.0
        return self.remaining(time) - lead

    def wait(self, time: int) -> None:
        """Sleep until the deadline of a block that was computed ahead of it."""
        if self.ahead and (early := self.remaining(time)) > 0.0:
            self._sleep(early)

    def delay_since(self, time: int) -> int:
        """Return how long ago a simulation time [ns] was due [ns]."""
        return self._schedule() - self._due(time)

    def finish(self, time: int) -> None:
        """Count a block up to a simulation time [ns], all of which is published."""
        self._blocks += 1
        self._time = time
        if not self.paces:
            return
        due = max(self._due(time), self._begun) if self._in_steps else self._due(time)
        late = self._schedule() - due
        self._all.add(late)
        self._lateness = late / SECOND
        self._lateness_max = max(self._lateness_max, self._lateness)
        if self._lateness * self._rate * self._factor > 1.0:
            self._missed += 1

    def read(self) -> Fields:
        """Return the timing so far by name [s], and begin an interval for its rate and maximum."""
        now = self._clock()
        elapsed = now - self._read_at
        behind = 0.0
        if self.paces:
            scheduled = (self._schedule() - self._start) * self._factor
            behind = max(0.0, scheduled - (self._time - self._start_time)) / SECOND
        timing = {
            "blocks": self._blocks,
            "deadlines_missed": self._missed,  # blocks that were later than one period
            "lateness": self._lateness,  # of the last block
            "lateness_max": self._lateness_max,  # of the interval
            "lateness_p50": self._all.quantile(0.5),
            "lateness_p99": self._all.quantile(0.99),
            "lateness_p99.9": self._all.quantile(0.999),
            "lag": math.floor(behind * self._rate) / self._rate,
            # simulated over elapsed time in the interval
            "real_time_factor": (self._time - self._read_time) / elapsed if elapsed > 0 else 1.0,
        }
        self._read_at, self._read_time = now, self._time
        self._lateness_max = 0.0
        return timing

    def _due(self, time: int) -> int:
        return self._start + round((time - self._start_time) / self._factor)


class Timeline:
    """Play, pause and steps of simulation time, and its schedule; it is paused at first."""

    def __init__(
        self,
        node: Node,
        settings: Settings,
        notify: Callable[[], None],
        changed: Callable[[], None],
    ) -> None:
        self.playing = False  # whether time continues by itself
        self.at_start = False  # whether it was stopped, and neither paused nor played since
        self.goal: int | None = None  # simulation time at which the current step ends [ns]
        self.source = TimeSource(node, settings.publish_clock, notify)
        self.pacer = Pacer(settings.telemetry_rate, self.source.schedule)
        self._changed = changed
        self._step: Future[Reached] = Future()

    @property
    def standing(self) -> bool:
        return not self.playing and self.goal is None

    @property
    def state(self) -> str:
        """State of an active drill, as ``rpud_msgs/Status`` names it."""
        if not self.standing:
            return "running"
        return "stopped" if self.at_start else "paused"

    def play(self) -> None:
        """Let time continue by itself, from here on."""
        self._hold("the simulation was set to play", playing=True)

    def pause(self) -> None:
        """Pause time."""
        self.source.note_pause()
        self._hold("the simulation was paused")

    def stop(self) -> None:
        """Pause time at its start."""
        self._hold("the simulation was stopped", at_start=True)

    def check_step(self, time: int, goal: int) -> None:
        """Raise a ParameterError unless paused time may continue to a goal [ns]."""
        for holds, state in (
            (self.playing, "playing"),
            (self.at_start, "stopped"),
            (self.goal is not None, "stepping already"),
        ):
            if holds:
                raise ParameterError(f"it is {state}, not paused, as after `rpud pause`")
        ahead = (goal - time) / SECOND
        if not 0.0 < ahead <= LONGEST_STEP:
            raise ParameterError(f"step = {ahead:g} s is outside its range (0, {LONGEST_STEP:g}] s")

    def step(self, goal: int) -> Future[Reached]:
        """Let time continue to a goal [ns]; return its end, or an interrupted step's error."""
        self.goal, self._step = goal, Future()
        return self._step

    def interrupt(self, reason: str) -> None:
        """End a step that is under way before its goal."""
        if self.goal is not None:
            self.goal = None
            self._step.set_exception(RequestError(f"interrupted: {reason}", INTERRUPTED))

    def reach(self, reached: Reached) -> None:
        """End a step whose goal is reached."""
        self._step.set_result(reached)

    def pace(self, time: int, stamp: int, factor: float) -> bool:
        """Begin a schedule at a simulation time, or hold it; return whether it is punctual."""
        factor = 1.0 if self.source.follows else factor
        if self.playing:
            self.pacer.start(time, factor, stamp if self.source.follows else None)
        else:
            self.pacer.stop()
        return self.playing and 0.0 < factor <= 1.0

    def _hold(self, reason: str, playing: bool = False, at_start: bool = False) -> None:
        self.interrupt(reason)
        self.playing, self.at_start = playing, at_start
        self._changed()
