"""Pacing loop: the one thread that moves the live run, or changes it."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable
from typing import Any

from rpud_sim.ros.drill.live_run import LiveRun
from rpud_sim.ros.threads import Requests, StoppedError
from rpud_sim.simulation.configuration import Settings

_LONGEST_WAIT = 0.5  # so that a stop is noticed whatever happens to the event [s]
_LAST_RESPONSE = 1.0  # for the response to a client that ends the process, to arrive [s]
_ACKNOWLEDGEMENT = 1.0  # that the last messages may take to reach their subscribers [s]


class PacingLoop:
    """Thread of a live run, from ``start`` to the end of the run or ``clean_up``."""

    def __init__(self) -> None:
        self.live: LiveRun | None = None  # from the node's configuration to its clean-up
        self.failure: BaseException | None = None  # error that ended the thread
        self._thread: threading.Thread | None = None
        self._waking = threading.Event()
        self.wake = self._waking.set  # to be called when there is something to do
        self._stop = threading.Event()
        self._finished = threading.Event()
        self._requests = Requests(self.wake)
        self._quit_at = math.inf

    @property
    def begun(self) -> LiveRun | None:
        """Live run, to be read; None until it has begun."""
        return self.live if self._thread is not None else None

    @property
    def finished(self) -> bool:
        """Whether the process is to end: the drill has ended by itself, or ``quit`` is done."""
        return self._finished.is_set() or time.monotonic() >= self._quit_at

    def configure(self, live: LiveRun) -> None:
        """Take a live run, which nothing moves yet."""
        self.live = live
        self._stop.clear()
        live.announce()

    def start(self, settings: Settings) -> None:
        """Begin, active, with settings that may have changed: simulation time zero is now."""
        assert self.live is not None  # an inactive node is configured
        self.live.begin(settings)
        self._requests = Requests(self.wake)
        arguments = (self.live, self._requests)
        self._thread = threading.Thread(target=self._run, args=arguments, name="pacing")
        self._thread.start()

    def request(self, action: Callable[[LiveRun], Any]) -> Any:
        """Have something done between two blocks; see ``Requests.do``."""
        if (live := self.begun) is None:
            raise StoppedError("the node has not been activated")
        return self._requests.do(lambda: action(live))

    def quit(self) -> None:
        """End the drilling now, at a client's request, and the process a little later.

        The middleware drops a response that reaches a client together with the news that its sender
        has left.
        """
        self._end()
        self._quit_at = time.monotonic() + _LAST_RESPONSE

    def stop(self) -> None:
        """End the drilling, publish the last status, and wait until subscribers have it."""
        self._end()
        if self._thread is not None:
            self._thread.join()
        if self.live is not None:
            self.live.publishers.outlets.wait(_ACKNOWLEDGEMENT)

    def clean_up(self) -> None:
        """Stop, and give up the live run."""
        self.stop()
        live, self.live, self._thread = self.live, None, None
        if live is not None:
            live.close()

    def _end(self) -> None:
        self._stop.set()
        self.wake()

    def _run(self, live: LiveRun, requests: Requests) -> None:
        # Any error must end the process too, or it would go on in silence.
        try:
            live.start_time(self._stop, requests.serve)
            while not (self._stop.is_set() or live.finished):
                requests.serve()
                if (idle := live.turn()) > 0.0:
                    self._waking.wait(min(idle, _LONGEST_WAIT))
                    self._waking.clear()
            live.finish()
        except Exception as error:
            self.failure = error
        finally:
            if not self._stop.is_set():
                self._finished.set()
            live.interrupt("the drill has stopped")
            requests.close()
