"""What a terminal has of a replay: keys that control it, and a bar that shows where it is."""

from __future__ import annotations

from contextlib import ExitStack
from functools import partial
from types import TracebackType

from rclpy.impl.rcutils_logger import RcutilsLogger
from tqdm import tqdm

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.replay.keyboard import Keyboard
from rpud_sim.ros.replay.playback import Plan, Playback, RefusedError
from rpud_sim.ros.replay.playback_thread import PlaybackThread
from rpud_sim.ros.requests import StoppedError

_LOOK_PERIOD = 0.05  # s
_RATE_STEP = 0.1  # times real time, as in `ros2 bag play`
_BAR = "{desc}: {percentage:3.0f}%|{bar}| {n:.1f}/{total:.1f} s{postfix}"


class ReplayConsole:
    """Reads keys where standard input is a terminal, and draws where standard error is one.

    Args:
        thread: to control.
        plan: of what it plays.
        title: of the bar.
        logger: for what is refused.
        keys: whether keys are read.
    """

    def __init__(
        self, thread: PlaybackThread, plan: Plan, title: str, logger: RcutilsLogger, *, keys: bool
    ) -> None:
        self._thread = thread
        self._first = plan.first
        self._length = (plan.last - plan.first) / SECOND
        self._logger = logger
        self._title = title
        self._keyboard = Keyboard()
        self._keys = keys
        self._open = ExitStack()

    def __enter__(self) -> ReplayConsole:
        """Take the terminal."""
        if self._keys:
            self._open.enter_context(self._keyboard)
        self._bar = self._open.enter_context(
            tqdm(desc=self._title, total=self._length, bar_format=_BAR, leave=False, disable=None)
        )
        if self._keyboard.active:
            self._logger.info("space: pause, right: next message, up and down: rate")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Give the terminal back."""
        self._open.close()

    def look(self, playback: Playback) -> None:
        """Wait a moment for keys and do what they say; show where the playback is."""
        for key in self._keyboard.read(_LOOK_PERIOD):
            try:
                self._thread.do(partial(_press, key))
            except (RefusedError, StoppedError) as error:
                self._logger.warning(str(error))
        if not self._bar.disable:
            self._bar.n = min((playback.position - self._first) / SECOND, self._length)
            state = "paused" if playback.paused else f"x{playback.rate:g}"
            self._bar.set_postfix_str(f"{state}, {playback.published} messages")


def _press(key: str, playback: Playback) -> None:
    if key == " ":
        playback.toggle_paused()
    elif key in ("right", "n"):
        playback.play_next()
    elif key == "up":
        playback.set_rate(round(playback.rate + _RATE_STEP, 6))
    elif key == "down":
        playback.set_rate(round(playback.rate - _RATE_STEP, 6))
