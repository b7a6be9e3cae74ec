"""Guard of a drill's folder: when the test's process has ended, nothing that it started lives on.

It runs by itself, for a process that is killed can end nothing, and a node that hangs obeys only
SIGKILL. All processes of a drill have its folder in their environment, also those that a launch
file starts.
"""

from __future__ import annotations

import os
import select
import shutil
import signal
import sys
import time
from contextlib import suppress
from pathlib import Path

VARIABLE = "ROS_LOG_DIR"  # that names a folder below the drill's

_ROUNDS = 100  # of killing: a process may start another one meanwhile
_PERIOD = 0.05  # between two [s]


def kill_all(folder: str) -> None:
    """Kill the processes whose environment names a drill's folder, until there are none."""
    mark = f"\0{VARIABLE}={folder}/".encode()
    for _ in range(_ROUNDS):
        found = False
        for entry in Path("/proc").iterdir():
            with suppress(OSError):  # it has ended, or is of another user
                if entry.name.isdecimal() and mark in b"\0" + (entry / "environ").read_bytes():
                    os.kill(int(entry.name), signal.SIGKILL)
                    found = True
        if not found:
            return
        time.sleep(_PERIOD)


def main(parent: int, folder: str) -> None:
    """Wait until the parent process has ended, then end what it has left."""
    for number in (signal.SIGHUP, signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)  # a CI server may send them to every process
    with suppress(ProcessLookupError):
        select.select([os.pidfd_open(parent)], [], [])
    kill_all(folder)
    shutil.rmtree(folder, ignore_errors=True)


if __name__ == "__main__":
    main(int(sys.argv[1]), sys.argv[2])
