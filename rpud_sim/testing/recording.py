"""Recording of a test by the recorder, in a process of its own."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import time
from pathlib import Path

from rpud_sim.testing.drill import Drill
from rpud_sim.testing.errors import DrillError
from rpud_sim.testing.processes import ChildProcess

_START = 30.0  # that the recorder may take to start [s]
_END = 30.0  # that it may take to complete the bag [s]
_POLL_PERIOD = 0.05  # s


class Recording:
    """Recording of everything in the drill's domain, from now until it is stopped.

    Args:
        drill: to record.
        path: folder of the new bag.

    Raises:
        DrillError: if the recorder does not start.
    """

    def __init__(self, drill: Drill, path: Path) -> None:
        self._path = path
        self._stopped = False
        ready, writing = os.pipe()
        try:
            self._process = ChildProcess(
                "recorder",
                (
                    *(sys.executable, "-m", "rpud_sim.cli.main", "record", "--all"),
                    *("--out", str(path), "--namespace", drill.namespace),
                    *("--until-eof", "--allow-empty", "--ready-fd", str(writing)),
                ),
                drill.environment,
                path.with_name(f"{path.name}.log"),
                pass_fds=(writing,),
                stdin=subprocess.PIPE,
            )
            os.close(writing)
            self._await_start(ready)
        finally:
            os.close(ready)
        drill.await_connections()

    @property
    def path(self) -> Path:
        """Folder of the bag, which is complete when the recording is stopped."""
        return self._path

    def __fspath__(self) -> str:
        return str(self._path)

    def stop(self) -> Path:
        """Complete the bag, and return its folder.

        Raises:
            DrillError: if the recorder fails.
        """
        if not self._stopped:
            self._stopped = True
            self._process.send(15)
            ended = self._process.wait(_END)
            code = self._process.code
            self._process.kill()
            if not ended or code:
                raise DrillError(f"the recorder failed; its last lines:\n{self._process.tail}")
        return self._path

    def _await_start(self, ready: int) -> None:
        deadline = time.monotonic() + _START
        while self._process.running and time.monotonic() < deadline:
            readable, _, _ = select.select([ready], [], [], _POLL_PERIOD)
            if readable and os.read(ready, 1):
                return
        tail = self._process.tail
        self._process.kill()
        raise DrillError(f"the recorder has not started; its last lines:\n{tail}")
