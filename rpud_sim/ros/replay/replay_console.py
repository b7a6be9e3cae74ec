"""Terminal of a replay: keys that control it, and a bar that shows its position."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from types import TracebackType
from typing import Any, Protocol

from rclpy.impl.rcutils_logger import RcutilsLogger

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.replay.keyboard import Keyboard
from rpud_sim.ros.replay.playback import Plan, Playback, RefusedError
from rpud_sim.ros.replay.playback_thread import PlaybackThread
from rpud_sim.ros.requests import StoppedError

_POLL_PERIOD = 0.05  # s
_RATE_STEP = 0.1  # times real time, as in `ros2 bag play`


class MakeBar(Protocol):
    """Maker of a progress bar."""

    def __call__(self, *, title: str, total: float) -> Any:
        """Return a ``tqdm`` bar of that many seconds."""


class ReplayConsole:
    """Reader of keys, where standard input is a terminal, and display of the position.

    ``bar`` is a ``tqdm`` bar in seconds of the bag.
    """

    def __init__(
        self, thread: PlaybackThread, plan: Plan, bar: Any, logger: RcutilsLogger, *, keys: bool
    ) -> None:
        self._thread = thread
        self._first = plan.first
        self._bar = bar
        self._logger = logger
        self._keyboard = Keyboard()
        self._keys = keys
        self._open = ExitStack()

    def __enter__(self) -> ReplayConsole:
        if self._keys:
            self._open.enter_context(self._keyboard)
        self._open.enter_context(self._bar)
        if self._keyboard.active:
            self._logger.info("space: pause, right: next message, up and down: rate")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open.close()

    def update(self, playback: Playback) -> None:
        """Wait a moment for keys and act on them; show the position of the playback."""
        for key in self._keyboard.read(_POLL_PERIOD):
            try:
                self._thread.do(partial(_press, key))
            except (RefusedError, StoppedError) as error:
                self._logger.warning(str(error))
        self._bar.n = min((playback.position - self._first) / SECOND, self._bar.total)
        state = "paused" if playback.paused else f"x{playback.rate:g}"
        self._bar.set_postfix_str(f"{state}, {playback.published} messages", refresh=False)
        self._bar.last_print_n = min(self._bar.last_print_n, self._bar.n)  # after a step backwards
        self._bar.update(0)


def _press(key: str, playback: Playback) -> None:
    if key == " ":
        playback.toggle_paused()
    elif key in ("right", "n"):
        playback.play_next()
    elif key == "up":
        playback.set_rate(round(playback.rate + _RATE_STEP, 6))
    elif key == "down":
        playback.set_rate(round(playback.rate - _RATE_STEP, 6))
