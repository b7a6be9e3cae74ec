"""Source of the drill's time: this machine's clock, the drill itself, or another's ``/clock``."""

from __future__ import annotations

import threading
from collections.abc import Callable

from rclpy.clock import JumpThreshold, ROSClock, TimeJump
from rclpy.duration import Duration
from rclpy.node import Node


class TimeSource:
    """Clock that gives simulation time zero its stamp, and what comes after it a schedule.

    The node's clock follows ``/clock`` with its parameter ``use_sim_time``. With ``publishes`` the
    node itself is the source of ``/clock``.
    """

    def __init__(self, node: Node, publishes: bool) -> None:
        self._clock = node.get_clock()
        self._logger = node.get_logger()
        self._publishes = publishes
        simulated = isinstance(self._clock, ROSClock) and self._clock.ros_time_is_active
        # Whether the time is that of another source of ``/clock``.
        self.follows = simulated and not publishes
        self._notify: Callable[[], None] = lambda: None
        self._went_back = threading.Event()
        self._jumps = None
        if self.follows:
            self._jumps = self._clock.create_jump_callback(
                JumpThreshold(
                    min_forward=Duration(nanoseconds=1),
                    min_backward=Duration(nanoseconds=-1),
                    on_clock_change=False,
                ),
                post_callback=self._on_jump,
            )

    @property
    def schedule(self) -> Callable[[], int] | None:
        """The time that a schedule follows [ns]; None for the monotonic clock."""
        return self._now if self.follows else None

    def notify(self, notify: Callable[[], None]) -> None:
        """Call this from now on when another's ``/clock`` has moved."""
        self._notify = notify

    def wait(self, stop: threading.Event, serve: Callable[[], None]) -> None:
        """Wait until there is a time; ``serve`` is called again and again meanwhile."""
        if self.follows and self._now() == 0:
            self._logger.info("waiting for /clock, as use_sim_time is set")
            while self._now() == 0 and not stop.wait(0.01):
                serve()

    def origin(self, time: int = 0, own: int = 0) -> int:
        """Return the stamp of simulation time zero if a simulation time is now [ns].

        It is ``own`` where the node is the source. Whether another's ``/clock`` went back counts
        from here on.
        """
        self._went_back.clear()
        return own if self._publishes else self._now() - time

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
