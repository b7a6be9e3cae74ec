"""Keyboard: keys of a terminal, one by one, without echo."""

from __future__ import annotations

import os
import re
import select
import signal
import sys
import termios
import tty
from types import FrameType, TracebackType

_KEYS = re.compile(rb"\x1b[\[O][ABCD]|.", re.DOTALL)
_NAMES = {b"A": "up", b"B": "down", b"C": "right", b"D": "left"}
_MOST = 256  # bytes that are read at once


class Keyboard:
    """Reads keys while it is entered, if standard input is a terminal with this program in front.

    A program in the background must not touch its terminal: it would be stopped. The terminal is
    restored at the end, and set again when the program continues in front.
    """

    def __init__(self) -> None:
        self._terminal: int | None = None
        self._before: list = []
        self._continued: object = signal.SIG_DFL

    @property
    def active(self) -> bool:
        """Whether there are keys to read."""
        return self._terminal is not None and _in_front(self._terminal)

    def read(self, seconds: float) -> list[str]:
        """Wait for keys [s at most]: characters, ``up``, ``down``, ``right`` and ``left``."""
        terminal = self._terminal if self.active else None
        waiting = [] if terminal is None else [terminal]
        if not select.select(waiting, [], [], seconds)[0] or terminal is None or not self.active:
            return []
        try:
            data = os.read(terminal, _MOST)
        except OSError:
            data = b""
        if not data:  # the terminal is gone
            self._terminal = None
        return [
            _NAMES[key[-1:]] if key[:1] == b"\x1b" and len(key) > 1 else key.decode("latin-1")
            for key in _KEYS.findall(data)
        ]

    def __enter__(self) -> Keyboard:
        """Set the terminal, and give the keyboard."""
        try:
            terminal = sys.stdin.fileno()
            if os.isatty(terminal) and _in_front(terminal):
                self._before = termios.tcgetattr(terminal)
                self._terminal = terminal
                self._continued = signal.signal(signal.SIGCONT, self._set)
                self._set()
        except (AttributeError, OSError, ValueError, termios.error):
            pass  # no standard input, or none with a file: no keys
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Put the terminal back."""
        if not self._before:
            return
        signal.signal(signal.SIGCONT, self._continued)  # type: ignore[arg-type]
        if self.active:
            assert self._terminal is not None
            termios.tcsetattr(self._terminal, termios.TCSANOW, self._before)

    def _set(self, number: int = 0, frame: FrameType | None = None) -> None:
        if self.active:
            assert self._terminal is not None
            tty.setcbreak(self._terminal, termios.TCSANOW)


def _in_front(terminal: int) -> bool:
    try:
        return os.tcgetpgrp(terminal) == os.getpgrp()
    except OSError:
        return False
