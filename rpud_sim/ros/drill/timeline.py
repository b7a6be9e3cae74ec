"""Timeline of the drill: simulation time plays, stands still, or steps to a goal."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import NamedTuple

from rclpy.clock import JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.drill.pacer import Pacer
from rpud_sim.simulation.configuration import Settings

LONGEST_STEP = 1e6  # [s]; longer than any mission


class InterruptedStepError(RuntimeError):
    """A step that ended before its goal; the text says why."""


class Reached(NamedTuple):
    """End of a step."""

    stamp: int  # of the simulation time that was reached [ns]
    published: Mapping[str, int]  # messages by topic until then, since its publisher exists


class TimeSource:
    """Clock that gives simulation time zero its stamp, and what comes after it a schedule.

    The node's clock follows ``/clock`` with its parameter ``use_sim_time``. With ``publishes`` the
    node itself is the source of ``/clock``. ``notify`` is called when another's ``/clock`` moves.
    """

    def __init__(
        self, node: Node, publishes: bool, notify: Callable[[], None] = lambda: None
    ) -> None:
        self._clock = node.get_clock()
        self._logger = node.get_logger()
        self._publishes = publishes
        self._notify = notify
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        # Whether the time is that of another source of ``/clock``.
        self.follows = simulated and not publishes
        # The time that a schedule follows [ns]; None for the monotonic clock.
        self.schedule = self._now if self.follows else None
        self.went_back = False  # whether another's ``/clock`` did, since the latest origin
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
        """Return the stamp of simulation time zero if a simulation time is now [ns].

        It is ``own`` where the node is the source.
        """
        self.went_back = False
        return own if self._publishes else self._now() - time

    def close(self) -> None:
        if self._jumps is not None:
            self._jumps.unregister()
            self._jumps = None

    def _now(self) -> int:
        return int(self._clock.now().nanoseconds)

    def _on_jump(self, jump: TimeJump) -> None:
        self.went_back |= jump.delta.nanoseconds < 0
        self._notify()


class Timeline:
    """Play, pause and steps of simulation time, and the schedule of its blocks.

    Time stands still at first. ``changed`` is called when it plays or pauses.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        notify: Callable[[], None],
        changed: Callable[[], None],
    ) -> None:
        self.playing = False  # whether time goes on by itself
        self.at_start = False  # whether it was stopped, and neither paused nor played since
        self.goal: int | None = None  # simulation time at which the present step ends [ns]
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
        """Let time go on by itself, from here on."""
        self._hold("the simulation was set to play", playing=True)

    def pause(self) -> None:
        """Let time stand still."""
        self._hold("the simulation was paused")

    def stop(self) -> None:
        """Let time stand still at its start."""
        self._hold("the simulation was stopped", at_start=True)

    def check_step(self, time: int, goal: int) -> None:
        """Raise a ParameterError unless paused time may go on to a goal [ns]."""
        for holds, state in (
            (self.playing, "playing"),
            (self.at_start, "stopped"),
            (self.goal is not None, "stepping already"),
        ):
            if holds:
                raise ParameterError(f"it is {state}, not paused")
        ahead = (goal - time) / SECOND
        if not 0.0 < ahead <= LONGEST_STEP:
            raise ParameterError(f"step = {ahead:g} s is outside its range (0, {LONGEST_STEP:g}] s")

    def step(self, goal: int) -> Future[Reached]:
        """Let time go on to a goal [ns]; return its end, or an ``InterruptedStepError``."""
        self.goal, self._step = goal, Future()
        return self._step

    def interrupt(self, reason: str) -> None:
        """End a step that is under way before its goal."""
        if self.goal is not None:
            self.goal = None
            self._step.set_exception(InterruptedStepError(f"interrupted: {reason}"))

    def reach(self, reached: Reached) -> None:
        """End a step whose goal is reached."""
        self._step.set_result(reached)

    def pace(self, time: int, stamp: int, factor: float) -> bool:
        """Begin a schedule at a simulation time, or hold it; return whether it is punctual.

        The factor is without effect where the schedule is that of another's ``/clock``.
        """
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
