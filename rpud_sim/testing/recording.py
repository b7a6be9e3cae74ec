"""Recording of a test by the recorder, in a process of its own."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import time
from pathlib import Path

import rpud_sim.bag
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.drill import Drill
from rpud_sim.testing.errors import DrillError, LostMessagesError
from rpud_sim.testing.processes import ChildProcess

_START = 30.0  # that the recorder may take to start [s]
_END = 30.0  # that it may take to complete the bag [s]
_POLL_PERIOD = 0.05  # s


class Recording:
    """Recording of everything in the drill's domain, from now until it is stopped."""

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
        self._drill = drill
        self._begun = drill.published

    @property
    def path(self) -> Path:
        """Folder of the bag, which is complete when the recording is stopped."""
        return self._path

    def __fspath__(self) -> str:
        return str(self._path)

    def stop(self) -> Path:
        """Complete the bag and return its folder; it must have all messages of the drill."""
        if not self._stopped:
            self._stopped = True
            self._drill.await_delivery()
            self._process.send(signal.SIGTERM)
            ended = self._process.wait(_END)
            code = self._process.code
            self._process.kill()
            if not ended or code:
                raise DrillError(f"the recorder failed; its last lines:\n{self._process.tail}")
            self._check()
        return self._path

    def _check(self) -> None:
        with rpud_sim.bag.open(self._path) as bag:
            recorded = {item.topic.name: item.message_count for item in bag.topics}
        for name, count in self._drill.published.items():
            topic, published = TOPICS[name], count - self._begun[name]
            found = recorded.get(f"{self._drill.namespace.rstrip('/')}/{name}", 0)
            if topic.complete and found < published:
                raise LostMessagesError(
                    f"{published} messages of {name} were published, {found} are in {self._path}"
                )

    def _await_start(self, ready: int) -> None:
        deadline = time.monotonic() + _START
        while self._process.running and time.monotonic() < deadline:
            readable, _, _ = select.select([ready], [], [], _POLL_PERIOD)
            if readable and os.read(ready, 1):
                return
        tail = self._process.tail
        self._process.kill()
        raise DrillError(f"the recorder has not started; its last lines:\n{tail}")
