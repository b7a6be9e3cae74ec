"""What tests share: a ROS domain of their own and real processes that never outlive a test."""

import contextlib
import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TypeVar

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory

from rpud_sim.cli.main import main
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.simulation.fields import trajectory_cuts, trajectory_fields
from rpud_sim.simulation.telemetry import row_of

_PROFILE = Path(get_package_share_directory("rpud_sim"), "config", "fastdds_loopback.xml")
_FAST_DDS = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
LOOPBACK = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT" if _FAST_DDS else "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(_PROFILE),
}
"""Environment of processes that talk over loopback alone, as env.bash sets it."""

Value = TypeVar("Value")

GRACE = 5.0  # seconds that a process has to obey a signal
PATIENCE = 100.0
"""Seconds that a test waits for a condition at most: a first drill compiles, beside busy loops."""

MANY_EXAMPLES = os.environ.get("RPUD_EXAMPLES") == "many"
FEW = 25


def examples(count: int) -> int:
    """Number of examples that a property draws: `count` in `make test-all`, else 25 at most."""
    return count if MANY_EXAMPLES else min(count, FEW)


def real_time_permitted() -> bool:
    """Whether a thread of this process may have a real-time priority."""

    def attempt() -> None:
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))

    with ThreadPoolExecutor(1) as pool:
        return not isinstance(pool.submit(attempt).exception(), PermissionError)


def until(condition: Callable[[], Value]) -> Value:
    """Wait until a condition is true, and return its value; fail if it never is."""
    deadline = time.monotonic() + PATIENCE
    while not (value := condition()):
        assert time.monotonic() < deadline, "it did not come true"
        time.sleep(0.002)
    return value


def refusal(make: Callable[..., object], *arguments: object) -> str:
    """Give the one line with which arguments are refused; empty if they are not."""
    try:
        make(*arguments)
    except ParameterError as error:
        text = str(error)
    else:
        return ""
    assert text
    assert "\n" not in text
    return text


def rpud(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command of `rpud` in a process of its own to its end."""
    return subprocess.run(
        ["rpud", *map(str, words)], capture_output=True, text=True, timeout=110, check=False
    )


def called(capsys: pytest.CaptureFixture, *words: object) -> tuple[int, str, str]:
    """Call `rpud` in this process; give exit code, standard output and standard error."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return (end.value.code or 0, *capsys.readouterr())


class Process:
    """A real process in a group of its own; its output and errors are read as they come."""

    def __init__(self, *command: str | os.PathLike, **options):
        """Start `command`; `options` go to `subprocess.Popen`."""
        self.command = [os.fspath(word) for word in command]
        self._popen = subprocess.Popen(
            self.command,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            start_new_session=True,
            **options,
        )
        self.pid = self._popen.pid
        self._lines: list[str] = []
        self._ended = False
        self._changed = threading.Condition()
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _read(self) -> None:
        for line in self._popen.stdout:
            with self._changed:
                self._lines.append(line.rstrip("\n"))
                self._changed.notify_all()
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    @property
    def output(self) -> str:
        """All that it printed until now."""
        with self._changed:
            return "\n".join(self._lines)

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._popen.poll() is None

    def wait_for_line(self, pattern: str, timeout: float = PATIENCE) -> re.Match:
        """Return the match in the first line of all its output that has `pattern`, or fail."""
        expression = re.compile(pattern)

        def match() -> re.Match | None:
            return next(filter(None, map(expression.search, self._lines)), None)

        with self._changed:
            self._changed.wait_for(lambda: match() or self._ended, timeout)
            if found := match():
                return found
            reason = "ended without it" if self._ended else f"not within {timeout} s"
            raise self._failure(f"did not print {pattern!r} ({reason})")

    def wait(self, timeout: float = PATIENCE) -> int:
        """Return the exit code, all output read; fail when it does not end."""
        try:
            code = self._popen.wait(timeout)
        except subprocess.TimeoutExpired:
            raise self._failure(f"did not end within {timeout} s") from None
        self._reader.join(GRACE)
        return code

    def interrupt(self) -> None:
        """Send SIGINT, as Ctrl-C does."""
        self._popen.send_signal(signal.SIGINT)

    def terminate(self) -> None:
        """Send SIGTERM, as `kill` and service managers do."""
        self._popen.terminate()

    def kill(self) -> None:
        """Send SIGKILL, which leaves it no time for anything."""
        self._popen.kill()

    def stop(self) -> None:
        """End it by the gentlest signal that it obeys, then whatever it left in its group."""
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGKILL):
            self._popen.send_signal(number)
            try:
                self._popen.wait(GRACE)
                break
            except subprocess.TimeoutExpired:
                pass
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, signal.SIGKILL)
        self._reader.join(GRACE)
        self._popen.stdout.close()

    def _failure(self, what: str) -> AssertionError:
        return AssertionError(
            f"{' '.join(self.command)} {what}; its output:\n" + "\n".join(self._lines)
        )


def trajectory_messages(segments, sequence, origin):
    """Give the fields of the trajectories of finished segments, one for each set of constants."""
    if not len(segments):
        return []
    cuts = np.array([0, *trajectory_cuts(segments).tolist(), len(segments)])
    columns = trajectory_fields(segments, cuts, sequence, origin)
    return [row_of(columns, number) for number in range(len(cuts) - 1)]


def one_by_one(found):
    """Yield a run's messages, of which many may come together, one by one in order."""
    for each in found:
        yield from (each,) if isinstance(each, tuple) else each.messages()
