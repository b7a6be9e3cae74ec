"""A real program in a pseudo terminal, as a user's shell starts it."""

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
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", rows, columns, 0, 0))
        self.modes_before = termios.tcgetattr(slave)
        self._slave = slave  # open, or the modes would be gone with the process
        self.drawn = b""
        self.pid = os.fork()
        if self.pid == 0:
            try:
                os.login_tty(slave) if hasattr(os, "login_tty") else _login(slave)
                os.execvpe(command[0], list(command), {**os.environ, **environment})
            finally:
                os._exit(127)
        self._code = None

    def __enter__(self):
        return self

    def __exit__(self, *_):
        if self._code is None:
            os.kill(self.pid, signal.SIGKILL)
            os.waitpid(self.pid, 0)
        os.close(self._master)
        os.close(self._slave)

    @property
    def text(self):
        """What it has drawn, without what steers the terminal."""
        return without_steering(self.drawn.decode(errors="replace"))

    @property
    def modes(self):
        """Modes of the terminal, such as whether it echoes."""
        return termios.tcgetattr(self._slave)

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
        if readable:
            self.drawn += os.read(self._master, 65536)
        return bool(readable)


def _login(slave):
    """Make a terminal the controlling one of this process, as Python 3.11 can do it itself."""
    os.setsid()
    fcntl.ioctl(slave, termios.TIOCSCTTY, 0)
    for number in (0, 1, 2):
        os.dup2(slave, number)
