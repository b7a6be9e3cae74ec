"""The thread that moves the drill: serves requests, then does what is due, then waits."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

from rpud_sim.ros.drill.drilling import Drilling
from rpud_sim.ros.requests import Requests, StoppedError
from rpud_sim.simulation.configuration import Settings

_LONGEST_WAIT = 0.5  # so that a stop is noticed whatever happens to the event [s]


class PacingThread:
    """The one thread that moves the simulation, or changes it."""

    def __init__(self, drilling: Drilling) -> None:
        self._drilling = drilling
        self._wake = threading.Event()
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._failure: BaseException | None = None
        self._requests = Requests(self._wake.set)
        self._thread = threading.Thread(target=self._run, name="pacing")
        drilling.notify(self._wake.set)
        drilling.announce()

    @property
    def started(self) -> bool:
        return self._thread.ident is not None

    @property
    def finished(self) -> bool:
        return self._finished.is_set()

    @property
    def failure(self) -> BaseException | None:
        """Error that ended it, None without one."""
        return self._failure

    def start(self, settings: Settings) -> None:
        """Begin, active, with settings that may have changed: simulation time zero is now."""
        self._drilling.begin(settings)
        self._thread.start()

    def stop(self) -> None:
        """End the drilling, and publish the last status."""
        self._stop.set()
        self._wake.set()
        if self._thread.is_alive():
            self._thread.join()

    def request(self, action: Callable[[Drilling], Any]) -> Any:
        """Have something done between two blocks; see ``Requests.do``."""
        if not self.started:
            raise StoppedError("the node has not been activated")
        return self._requests.do(lambda: action(self._drilling))

    def _run(self) -> None:
        # Any error must end the process too, or it would go on in silence.
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
            self._drilling.time_control.interrupt("the drill has stopped")
            self._requests.close()

    def _wait(self, seconds: float) -> None:
        if seconds > 0.0:
            self._wake.wait(min(seconds, _LONGEST_WAIT))
            self._wake.clear()
