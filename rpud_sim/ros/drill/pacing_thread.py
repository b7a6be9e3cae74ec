"""The thread that moves the drill: serves requests, then does what is due, then waits."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable
from typing import Any

from rclpy.node import Node

from rpud_sim.ros.drill.account import Account
from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.drill.inbox import Inbox
from rpud_sim.ros.drill.publishers import DrillPublishers
from rpud_sim.ros.requests import Requests
from rpud_sim.simulation.configuration import Settings

_LONGEST_WAIT = 0.5  # so that a stop is noticed whatever happens to the event [s]


class PacingThread:
    """Everything that moves the simulation, or changes it, happens in this thread.

    Args:
        node: for its clock, its logger and the graph.
        settings: to begin with.
        publishers: to publish with.
        account: of what it does.
        inbox: of commands.
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
        restored: Callable[[Settings], None],
        end: int = sys.maxsize,
    ) -> None:
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._failure: BaseException | None = None
        self._requests = Requests(self._wake.set)
        self._drilling = Drilling(
            node, settings, publishers, account, inbox, self._wake.set, restored, end
        )
        self._thread = threading.Thread(target=self._run, name="pacing")
        inbox.notify(self._wake.set)
        self._drilling.announce()

    @property
    def drilling(self) -> Drilling:
        """What it moves, to be read; ``request`` is the way to change it."""
        return self._drilling

    @property
    def finished(self) -> bool:
        """Whether it has ended, for whatever reason."""
        return self._finished.is_set()

    @property
    def failure(self) -> BaseException | None:
        """What ended it before it was asked to stop, if anything did."""
        return self._failure

    def start(self, settings: Settings) -> None:
        """Begin, active, with settings that may have changed: simulation time zero is now.

        Raises:
            ParameterError: if the scenario cannot be used.
        """
        self._drilling.begin(settings)
        self._thread.start()

    def stop(self) -> None:
        """End the drilling, and publish the last status."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def close(self) -> None:
        """Stop listening to the clock."""
        self._drilling.close()

    def request(self, action: Callable[[Drilling], Any]) -> Any:
        """Have something done between two blocks; return what it returns, raise what it raises.

        Of an action that returns a Future it is the Future's result. The pacing thread does at once
        what it asks for itself.

        Raises:
            StoppedError: if the drilling has ended.
        """
        if threading.current_thread() is self._thread:
            return action(self._drilling)
        return self._requests.do(lambda: action(self._drilling))

    def _run(self) -> None:
        # Whatever ends the thread must end the process too, or it would go on in silence.
        try:
            self._drilling.start(self._stop, self._requests.serve)
            while not (self._stop.is_set() or self._drilling.finished):
                self._requests.serve()
                self._wait(self._drilling.advance())
            self._drilling.finish()
        except Exception as error:
            self._failure = error
        finally:
            self._finished.set()
            self._drilling.interrupt("the drill has stopped")
            self._requests.close()

    def _wait(self, seconds: float) -> None:
        if seconds > 0.0:
            self._wake.wait(min(seconds, _LONGEST_WAIT))
            self._wake.clear()
