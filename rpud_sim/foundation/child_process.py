"""Child process: its start, its lines, its end. It never outlives the process that started it."""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import select
import signal
import subprocess
import sys
import termios
import time
from array import array
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

RPUD = (sys.executable, "-m", "rpud_sim.cli.main")
"""Words that start ``rpud``."""

_GRACE = 3.0  # time for a process to obey a signal [s]
_POLL_PERIOD = 0.05  # time between looks at the output [s]
_READ_PERIOD = 0.002  # time between looks at the unread input [s]
_TAIL = 15  # lines of output in an error
_SET_DEATH_SIGNAL = 1  # PR_SET_PDEATHSIG of prctl(2)
_LIBC = ctypes.CDLL(None)


class ChildProcess:
    """Process in a separate session: Ctrl-C does not reach it.

    Its output goes to a file, or stays in memory; with ``errors_apart`` its errors do not belong to
    it. With ``talked_to`` its input is what ``write_line`` writes. The kernel interrupts it when
    this process ends.
    """

    def __init__(
        self,
        command: Sequence[str],
        output: Path | None = None,
        *,
        name: str = "",
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        errors_apart: bool = False,
        talked_to: bool = False,
    ) -> None:
        self.command = tuple(command)
        self.name = name
        self._said: tuple[str, str] | None = None  # output and errors, when it has been ended
        self._begun = 0  # byte of its output from which on it counts
        self._output = _memory() if output is None else output.open("w+b")
        self._errors = _memory() if errors_apart else self._output
        reading, self._input = os.pipe() if talked_to else (subprocess.DEVNULL, -1)
        try:
            self._process = subprocess.Popen(
                self.command,
                env=environment,
                cwd=folder,
                stdin=reading,
                stdout=self._output,
                stderr=self._errors,
                start_new_session=True,
                preexec_fn=end_with_parent,
            )
        except OSError:
            self._close()
            raise
        finally:
            if talked_to:
                os.close(reading)

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
        return self._said[0] if self._said else _text(self._output, self._begun)

    @property
    def errors(self) -> str:
        """Its errors, if they are apart; otherwise its output."""
        if self._errors is self._output:
            return self.output
        return self._said[1] if self._said else _text(self._errors)

    @property
    def tail(self) -> str:
        """The last lines of its errors, indented."""
        lines = self.errors.splitlines()[-_TAIL:]
        return "\n".join(f"    {line}" for line in lines) or "    (it has printed nothing)"

    @property
    def ending(self) -> str:
        code = self.code
        if code is None:
            return "runs"
        if code < 0:
            with contextlib.suppress(ValueError):
                return f"was ended by {signal.Signals(-code).name}"
        return f"ended with exit code {code}"

    def first_line(self, seconds: float, cancelled: Callable[[], bool] = lambda: False) -> str:
        """Wait for the first line of its output; empty if it ends, or none comes in time."""
        deadline = time.monotonic() + seconds
        while True:
            last = not self.running or cancelled() or time.monotonic() >= deadline
            line, found, _ = self.output.partition("\n")
            if found or last:
                return line + found if found else ""
            self.join(_POLL_PERIOD)

    def write_line(self, text: str = "") -> None:
        """Write a line to its input."""
        with contextlib.suppress(BrokenPipeError):  # it has ended, which its owner will see
            os.write(self._input, f"{text}\n".encode())

    def has_read(self, seconds: float) -> bool:
        """Wait until it has read its input, at most for some seconds; return whether it has."""
        deadline, unread = time.monotonic() + seconds, array("i", [1])
        while unread[0] and self.running and time.monotonic() < deadline:
            self.join(_READ_PERIOD)
            fcntl.ioctl(self._input, termios.FIONREAD, unread)
        return not unread[0]

    def forget_output(self) -> None:
        """Leave out of its output what it has printed until now."""
        self._begun = os.fstat(self._output.fileno()).st_size

    def send(self, number: int) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self.pid, number)

    def stop(self) -> None:
        """End it by the gentlest signal that it obeys, then what it left in its group."""
        self.end(signal.SIGINT, signal.SIGTERM)

    def end(self, *numbers: int, seconds: float = _GRACE) -> None:
        """End it by the first of these signals that it obeys in time, or kill it."""
        for number in numbers:
            if self.running:
                self.send(number)
                self.join(seconds)
        self.kill()

    def kill(self) -> None:
        self.send(signal.SIGKILL)
        self._process.wait()
        if self._said is None:
            self._said = self.output, self.errors
            self._close()

    def _close(self) -> None:
        self._output.close()
        self._errors.close()
        if self._input >= 0:
            os.close(self._input)

    def join(self, seconds: float) -> bool:
        """Wait until it has ended, at most for some seconds; return whether it has."""
        if self.running:
            # Python's own wait polls, up to every 50 ms.
            descriptor = os.pidfd_open(self.pid)
            try:
                poll = select.poll()
                poll.register(descriptor, select.POLLIN)
                poll.poll(1000.0 * seconds)
            finally:
                os.close(descriptor)
        return not self.running


def group_of(leader: int) -> list[int]:
    """Return the numbers of the processes in a group that a process leads."""
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(ProcessLookupError):
            if os.getpgid(int(entry.name)) == leader:
                found.append(int(entry.name))
    return found


def stop_all(processes: Sequence[ChildProcess]) -> None:
    """End processes together, each as ``ChildProcess.stop`` does."""
    for number in (signal.SIGINT, signal.SIGTERM):
        running = [process for process in processes if process.running]
        for process in running:
            process.send(number)
        deadline = time.monotonic() + _GRACE
        for process in running:
            process.join(max(0.0, deadline - time.monotonic()))
    for process in processes:
        process.kill()


def end_with_parent() -> None:
    """Have the kernel end this process by SIGTERM when the one that started it ends."""
    # Nothing else ends a child of a process that is killed. A launch file ends its own at SIGTERM.
    _LIBC.prctl(_SET_DEATH_SIGNAL, signal.SIGTERM)


def _memory() -> BinaryIO:
    return os.fdopen(os.memfd_create("output"), "w+b")


def _text(file: Any, begun: int = 0) -> str:
    # Without moving the offset, which the child has as well.
    size = os.fstat(file.fileno()).st_size - begun
    return os.pread(file.fileno(), size, begun).decode(errors="replace")
