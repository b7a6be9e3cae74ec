"""Thread of a playback: it sleeps until a message is due or a request comes."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from rpud_sim.ros.replay.playback import Playback
from rpud_sim.ros.requests import Requests
from rpud_sim.ros.scheduling import schedule_thread

Result = TypeVar("Result")

_LONGEST_SLEEP = 3600.0  # s; the system call refuses more than some decades
_SHORTEST_SLEEP = 2e-4  # s; messages of less than this come together, and wake their listeners once


class PlaybackThread:
    """Thread that plays, by real-time priority unless 0; others reach the playback by ``do``."""

    def __init__(self, playback: Playback, priority: int = 0) -> None:
        self._playback = playback
        self._priority = priority
        self._wake = threading.Event()
        self._requests = Requests(self._wake.set)
        self._error: Exception | None = None
        self._thread = threading.Thread(target=self._run, name="playback", daemon=True)

    def start(self) -> None:
        self._thread.start()

    @property
    def running(self) -> bool:
        return self._thread.is_alive()

    def do(self, action: Callable[[Playback], Result]) -> Result:
        """Have something done between two messages; return its result, raise what it raises."""
        return self._requests.do(lambda: action(self._playback))

    def stop(self) -> None:
        self._playback.stop()
        self._wake.set()

    def join(self) -> None:
        """Wait for the end, and raise what it ended with."""
        self._thread.join()
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        schedule_thread(self._priority)
        try:
            self._playback.begin()
            while True:
                self._wake.clear()
                self._requests.serve()
                delay = self._playback.advance()
                if delay is None:
                    break
                if delay > 0:
                    self._wake.wait(min(max(delay, _SHORTEST_SLEEP), _LONGEST_SLEEP))
        except Exception as error:
            self._error = error
        finally:
            self._requests.close()
            self._playback.close()
