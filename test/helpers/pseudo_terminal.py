"""A real program in a pseudo terminal, as a user's shell starts it."""

import contextlib
import fcntl
import os
import pty
import re
import select
import signal
import struct
import termios
import time

from support import PATIENCE

_STEERING = re.compile(r"\x1b\[[0-9;?<>=$ ]*[a-zA-Z]|\x1b[()][A-Z0-9]|\x1b[=>]")


def without_steering(text):
    """Return a text without what moves a cursor or changes a colour."""
    return _STEERING.sub("", text)


class PseudoTerminal:
    """Process with a terminal of its own; what it draws is read while a test waits."""

    def __init__(self, *command, columns=80, rows=24, **environment):
        """Start `command`; the environment is added to that of this process."""
        self.drawn = b""
        self._code = None
        self.pid, self._master = pty.fork()
        if self.pid == 0:
            try:
                fcntl.ioctl(0, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
                os.execvpe(command[0], list(command), {**os.environ, **environment})
            finally:
                os._exit(127)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._code is None:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self._master)

    @property
    def text(self):
        """What it has drawn, without what steers the terminal."""
        return without_steering(self.drawn.decode(errors="replace"))

    def type(self, keys):
        """Send keys."""
        os.write(self._master, keys.encode())

    def until(self, condition):
        """Read what it draws until a condition holds."""
        deadline = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < deadline, f"it did not come true; it drew:\n{self.text}"
            self._read(0.05)

    def wait(self):
        """Return the exit code when it has ended."""

        def ended():
            pid, status = os.waitpid(self.pid, os.WNOHANG)
            if pid:
                self._code = os.waitstatus_to_exitcode(status)
            return pid

        self.until(ended)
        while self._read(0.0):
            pass
        return self._code

    def _read(self, seconds):
        readable, _, _ = select.select([self._master], [], [], seconds)
        if not readable:
            return False
        with contextlib.suppress(OSError):  # EIO: nobody has the terminal open any more
            drawn = os.read(self._master, 65536)
            self.drawn += drawn
            return bool(drawn)
        return False
