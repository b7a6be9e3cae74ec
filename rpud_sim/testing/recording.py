"""Recording of a test by the recorder, in the drill's domain."""

from __future__ import annotations

import signal
from pathlib import Path

from rpud_sim.foundation.child_process import RPUD, ChildProcess
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.testing.drill import LockstepDrill
from rpud_sim.testing.errors import DrillError, LostMessagesError

_START = 30.0  # that the recorder may take to start [s]
_END = 30.0  # that it may take to complete the bag [s]


class Recording:
    """Recording of everything in the drill's domain, from now until it is stopped."""

    def __init__(self, drill: LockstepDrill, path: Path) -> None:
        self.path = path  # folder of the bag, which is complete when the recording is stopped
        self._stopped = False
        self._process = ChildProcess(
            (
                *(*RPUD, "record", "--all", "--out", str(path), "--namespace", drill.namespace),
                *("--allow-empty", "--ready-fd", "1"),
            ),
            environment=drill.environment,
            errors_apart=True,
        )
        if not self._process.first_line(_START) or not self._process.running:
            self._process.kill()
            raise DrillError(f"the recorder has not started; its last lines:\n{self._process.tail}")
        drill.await_connections()
        self._drill = drill
        self._begun = drill.published

    def __fspath__(self) -> str:
        return str(self.path)

    def stop(self) -> Path:
        """Complete the bag and return its folder; it must have all messages of the drill."""
        if not self._stopped:
            self._stopped = True
            self._drill.await_delivery()
            self._process.end(signal.SIGTERM, seconds=_END)
            if self._process.code:
                raise DrillError(f"the recorder failed; its last lines:\n{self._process.tail}")
            self._check()
        return self.path

    def _check(self) -> None:
        import rpud_sim.bag

        with rpud_sim.bag.open(self.path) as bag:
            recorded = {item.topic.name: item.message_count for item in bag.topics}
        for name, count in self._drill.published.items():
            topic, published = TOPICS[name], count - self._begun[name]
            found = recorded.get(f"{self._drill.namespace.rstrip('/')}/{name}", 0)
            if topic.complete and found < published:
                raise LostMessagesError(
                    f"{published} messages of {name} were published, {found} are in {self.path}"
                )
