"""Source of the drill's time: this machine's clock, the drill itself, or another's ``/clock``."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.clock import JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node


class TimeSource:
    """Stamp of simulation time zero, and the schedule of what comes after it.

    The node's clock follows ``/clock`` with its parameter ``use_sim_time``. With ``publishes`` the
    node itself is the source of ``/clock``.
    """

    def __init__(self, node: Node, publishes: bool) -> None:
        self._clock = node.get_clock()
        self._logger = node.get_logger()
        self._publishes = publishes
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        self._follows = simulated and not publishes
        self._origin = 0
        self._notify: Callable[[], None] = lambda: None
        self._went_back = threading.Event()
        self._jumps = None
        if self._follows:
            self._jumps = self._clock.create_jump_callback(
                JumpThreshold(
                    min_forward=Duration(nanoseconds=1),
                    min_backward=Duration(nanoseconds=-1),
                    on_clock_change=False,
                ),
                post_callback=self._on_jump,
            )

    @property
    def follows(self) -> bool:
        """Whether the time is that of another source of ``/clock``."""
        return self._follows

    @property
    def schedule(self) -> Callable[[], int] | None:
        """The time that a schedule follows [ns]; None for the monotonic clock."""
        return self._now if self._follows else None

    def notify(self, notify: Callable[[], None]) -> None:
        """Call this from now on when another's ``/clock`` has moved."""
        self._notify = notify

    def wait(self, stop: threading.Event, serve: Callable[[], None]) -> int:
        """Wait, serving, until there is a time; return the stamp of simulation time zero [ns]."""
        if self._follows and self._now() == 0:
            self._logger.info("waiting for /clock, as use_sim_time is set")
            while self._now() == 0 and not stop.wait(0.01):
                serve()
        return self.begin()

    def begin(self, origin: int | None = None) -> int:
        """Begin again, and return the stamp of simulation time zero [ns].

        That is ``origin``; without one it is now, which is zero where the node is the source.
        """
        self._went_back.clear()
        if origin is None:
            origin = 0 if self._publishes else self._now()
        self._origin = origin
        return origin

    def return_to(self, time: int, origin: int = 0) -> int:
        """Go on at a simulation time [ns], and return the stamp of simulation time zero [ns].

        ``time`` has the stamp of now. Where the node is the source, the stamp to return is
        ``origin``, which belongs to ``time``.
        """
        return self.begin(origin if self._publishes else self._now() - time)

    def resume(self, time: int) -> int | None:
        """Return when on the schedule a simulation time [ns] is due; None for now."""
        return self._origin + time if self._follows else None

    def went_back(self) -> bool:
        return self._went_back.is_set()

    def close(self) -> None:
        if self._jumps is not None:
            self._jumps.unregister()
            self._jumps = None

    def _now(self) -> int:
        return int(self._clock.now().nanoseconds)

    def _on_jump(self, jump: TimeJump) -> None:
        if jump.delta.nanoseconds < 0:
            self._went_back.set()
        self._notify()
