"""Processes of a test: their output goes to a file, and they never outlive the test."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

_GRACE = 3.0  # that a process has to obey a signal [s]
_POLL_PERIOD = 0.005  # s
_TAIL = 15  # lines of output in an error
_TAIL_BYTES = 16_384
_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_LIBC = ctypes.CDLL(None)


class ChildProcess:
    """Process in a session of its own, which ends with this process at the latest.

    ``output`` is a file for its output and its errors; options are those of ``subprocess.Popen``.
    """

    def __init__(
        self,
        name: str,
        command: Sequence[str],
        environment: Mapping[str, str],
        output: Path,
        folder: Path | None = None,
        **options: object,
    ) -> None:
        self.name = name
        self.command = tuple(command)
        self.output_file = output
        with output.open("wb") as stream:
            self._process: subprocess.Popen[bytes] = subprocess.Popen(  # type: ignore[call-overload]
                self.command,
                env=dict(environment),
                cwd=folder,
                stdout=stream,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                preexec_fn=end_with_parent,
                **{"stdin": subprocess.DEVNULL, **options},
            )

    @property
    def pid(self) -> int:
        return self._process.pid

    @property
    def code(self) -> int | None:
        """Exit code, negative for a signal; None while it runs."""
        return self._process.poll()

    @property
    def running(self) -> bool:
        return self.code is None

    @property
    def output(self) -> str:
        return self.output_file.read_text(errors="replace")

    @property
    def tail(self) -> str:
        """The last lines that it has printed, indented."""
        with self.output_file.open("rb") as stream:
            stream.seek(max(0, self.output_file.stat().st_size - _TAIL_BYTES))
            lines = stream.read().decode(errors="replace").splitlines()[-_TAIL:]
        return "\n".join(f"    {line}" for line in lines) or "    (it has printed nothing)"

    @property
    def ending(self) -> str:
        """How it has ended, in words."""
        code = self.code
        if code is None:
            return "runs"
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"was ended by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"

    def send(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def stop(self) -> None:
        """End it by the gentlest signal that it obeys, then what it left in its group."""
        for number in (signal.SIGINT, signal.SIGTERM):
            if self.running:
                self.send(number)
                self.wait(_GRACE)
        self.kill()

    def kill(self) -> None:
        self.send(signal.SIGKILL)
        self._process.wait()
        if self._process.stdin:
            self._process.stdin.close()

    def wait(self, seconds: float) -> bool:
        """Wait until it has ended, at most for some seconds; return whether it has."""
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return not self.running


def stop_all(processes: Sequence[ChildProcess]) -> None:
    for number in (signal.SIGINT, signal.SIGTERM):
        running = [process for process in processes if process.running]
        for process in running:
            process.send(number)
        deadline = time.monotonic() + _GRACE
        while any(process.running for process in running) and time.monotonic() < deadline:
            time.sleep(_POLL_PERIOD)
    for process in processes:
        process.kill()


def end_with_parent() -> None:
    """Have the kernel end this process by SIGTERM when the one that started it ends."""
    # Nothing else ends a child of a process that is killed. A launch file ends its own at SIGTERM.
    _LIBC.prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)
