"""What tests share: a ROS domain of their own and real processes that never outlive a test."""

import contextlib
import json
import os
import re
import signal
import subprocess
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory

from rpud_sim.cli.main import main
from rpud_sim.foundation.child_process import ChildProcess
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.messages.batch import Batch
from rpud_sim.model import engine
from rpud_sim.model.engine import initial_state
from rpud_sim.model.tolerances import GREATEST_EFFORT
from rpud_sim.simulation.fields import trajectory_cuts, trajectory_fields
from rpud_sim.simulation.plan import JournalEntry

_PROFILE = Path(get_package_share_directory("rpud_sim"), "config", "fastdds_loopback.xml")
_FAST_DDS = os.environ.get("RMW_IMPLEMENTATION", "rmw_fastrtps_cpp").startswith("rmw_fastrtps")
LOOPBACK = {
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "SYSTEM_DEFAULT" if _FAST_DDS else "LOCALHOST",
    "FASTRTPS_DEFAULT_PROFILES_FILE": str(_PROFILE),
}
"""Environment of processes that talk over loopback alone, as env.bash sets it."""

Value = TypeVar("Value")

PATIENCE = 100.0
"""Seconds that a test waits for a condition at most: a first drill compiles, beside busy loops."""

SECOND = 1_000_000_000
MANY_EXAMPLES = os.environ.get("RPUD_EXAMPLES") == "many"
FEW = 5


def examples(count: int) -> int:
    """Number of examples that a property draws: `count` in `make test-all`, else few."""
    return count if MANY_EXAMPLES else min(count, FEW)


def extended(*values: object) -> object:
    """Parameters of a further case, which `make test-all` runs."""
    return pytest.param(*values, marks=pytest.mark.extended)


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


def exhaust(monkeypatch: pytest.MonkeyPatch) -> None:
    """Let every drill begin beyond its budget of events."""

    def exhausted(*arguments: Any) -> np.ndarray:
        state = initial_state(*arguments)
        state["effort"] = 2.0 * GREATEST_EFFORT
        return state

    monkeypatch.setattr(engine, "initial_state", exhausted)


def rpud(*words: object) -> subprocess.CompletedProcess[str]:
    """Run a command of `rpud` in a process of its own to its end."""
    return subprocess.run(["rpud", *map(str, words)], capture_output=True, text=True, check=False)


def called(capsys: pytest.CaptureFixture, *words: object) -> tuple[int, str, str]:
    """Call `rpud` in this process; give exit code, standard output and standard error."""
    with pytest.raises(SystemExit) as end:
        main([str(word) for word in words])
    return (end.value.code or 0, *capsys.readouterr())


class Process:
    """A real process in a group of its own; its output and errors are read as they come."""

    def __init__(self, *command: str | os.PathLike, env: Mapping[str, str] | None = None):
        self._child = ChildProcess([os.fspath(word) for word in command], environment=env)
        self.pid = self._child.pid

    def __enter__(self) -> "Process":
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    @property
    def output(self) -> str:
        """All that it printed until now."""
        return self._child.output.rstrip("\n")

    @property
    def running(self) -> bool:
        """Whether it has not ended yet."""
        return self._child.running

    def wait_for_line(self, pattern: str, timeout: float = PATIENCE) -> re.Match:
        """Return the match in the first line of all its output that has `pattern`, or fail.

        What it has started may go on to print when it has ended itself.
        """
        expression = re.compile(pattern)
        deadline = time.monotonic() + timeout
        while True:
            last = not self._group_lives() or time.monotonic() >= deadline
            lines = self._child.output.split("\n")
            complete = lines if last else lines[:-1]
            if found := next(filter(None, map(expression.search, complete)), None):
                return found
            if last:
                raise self._failure(f"did not print {pattern!r} within {timeout} s, or ended")
            time.sleep(0.01)

    def wait(self, timeout: float = PATIENCE) -> int:
        """Return the exit code; fail when it does not end."""
        if not self._child.join(timeout):
            raise self._failure(f"did not end within {timeout} s")
        return self._child.code

    def interrupt(self) -> None:
        """Send SIGINT, as Ctrl-C does."""
        self.send(signal.SIGINT)

    def terminate(self) -> None:
        """Send SIGTERM, as `kill` and service managers do."""
        self.send(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL, which leaves it no time for anything."""
        self.send(signal.SIGKILL)

    def stop(self) -> None:
        """End it by the gentlest signal that it obeys, then whatever it left in its group."""
        self._child.stop()

    def send(self, number: int) -> None:
        if self.running:  # to itself alone, not to what it has started
            os.kill(self.pid, number)

    def _group_lives(self) -> bool:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, 0)
            return True
        return False

    def _failure(self, what: str) -> AssertionError:
        return AssertionError(f"{' '.join(self._child.command)} {what}; its output:\n{self.output}")


def trajectory_messages(segments, sequence, origin):
    """Give the fields of the trajectories of finished segments, one for each set of constants."""
    if not len(segments):
        return []
    cuts = np.array([0, *trajectory_cuts(segments).tolist(), len(segments)])
    columns = trajectory_fields(segments, cuts, sequence, origin)
    batch = Batch("trajectory", np.zeros(len(cuts) - 1, np.int64), columns)
    return [fields for _, _, fields in batch.rows()]


def entries_in(rows):
    """Return the journal's entries in messages, as the reader of a bag has them."""
    found = []
    for _, topic, fields in rows:
        if topic == "journal":
            content = json.loads(fields["content"])
            entry = JournalEntry(fields["sequence"], content.pop("time"), fields["kind"], content)
            found.append(entry)
    return found


class ManualClock:
    """A monotonic clock [ns] that stands still until a caller sleeps or sets `now`."""

    def __init__(self, now=17 * SECOND):
        self.now = now
        self.slept = []

    def __call__(self):
        return self.now

    def sleep(self, seconds):
        """Note the time that was slept [s], and move by it."""
        self.slept.append(seconds)
        self.now += round(seconds * SECOND)
