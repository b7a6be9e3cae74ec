"""Orderly stop at SIGINT and SIGTERM, and a sleep that it interrupts."""

from __future__ import annotations

import os
import select
import signal
from types import FrameType, TracebackType


class StopRequest:
    """Request to stop the program; while it is entered, SIGINT and SIGTERM make it.

    rclpy's own handlers would end the context at once, and messages that have arrived would be
    lost. A pipe carries the request: a signal handler cannot acquire a lock that the interrupted
    main thread may hold.
    """

    def __init__(self) -> None:
        self._requested = False
        self._reading, self._writing = os.pipe()
        os.set_blocking(self._writing, False)
        self._handlers: dict[int, object] = {}

    def __enter__(self) -> StopRequest:
        for number in (signal.SIGINT, signal.SIGTERM):
            self._handlers[number] = signal.signal(number, self._handle)
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        for number, handler in self._handlers.items():
            signal.signal(number, handler)  # type: ignore[arg-type]
        self._requested = True  # so that no thread writes to what is closed
        os.close(self._reading)
        os.close(self._writing)

    @property
    def requested(self) -> bool:
        return self._requested

    def request(self) -> None:
        if not self._requested:
            self._requested = True
            os.write(self._writing, b"\0")

    def wait(self, seconds: float) -> bool:
        """Sleep for some seconds or until the stop is requested; return whether it is."""
        if not self._requested:
            select.select([self._reading], [], [], max(0.0, seconds))
        return self._requested

    def _handle(self, number: int, frame: FrameType | None) -> None:
        self.request()
