"""Recorder in a process of its own, so that a slow disk cannot make the drill late."""

from __future__ import annotations

import os
import select
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

from rpud_sim.foundation.terminal import complain

if TYPE_CHECKING:
    from rpud_sim.ros.stopping import StopRequest

_PROGRAM = "rpud run"
_START_TIMEOUT = 15.0  # s
_CLOSE_TIMEOUT = 30.0  # s
_POLL_PERIOD = 0.05  # s
_LINES_KEPT = 100  # of its standard error, which has a line of progress every ten seconds


class RecorderProcess:
    """Process of ``rpud record``; a crash of it may cost at most ``max_loss`` of messages [s]."""

    def __init__(self, bag: str, namespace: str, max_loss: float) -> None:
        self._bag = bag
        self._ready, ready = os.pipe()
        self._process = subprocess.Popen(
            [
                *(sys.executable, "-m", "rpud_sim.cli.main", "record"),
                *("--out", bag, "--namespace", namespace, "--until-eof"),
                # `missing` compares numbers of messages, which says more than an empty bag.
                *("--max-loss", str(max_loss), "--allow-empty", "--ready-fd", str(ready)),
            ],
            pass_fds=(ready,),
            stdin=subprocess.PIPE,  # it ends with this process, whatever ends that
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            errors="backslashreplace",
            # Ctrl-C must stop the drill first, and the recorder when it has everything.
            start_new_session=True,
        )
        os.close(ready)
        self._errors: deque[str] = deque(maxlen=_LINES_KEPT)
        # This thread alone reads its errors: communicate() would consume some of them.
        self._stream, self._process.stderr = self._process.stderr or (), None
        self._reader = threading.Thread(target=self._read_errors, daemon=True)
        self._reader.start()

    def wait_until_ready(self, stop: StopRequest) -> bool:
        """Wait until it records; return whether it does."""
        end = time.monotonic() + _START_TIMEOUT
        while time.monotonic() < end and not stop.requested:
            readable, _, _ = select.select([self._ready], [], [], _POLL_PERIOD)
            if readable:
                return bool(os.read(self._ready, 1))  # nothing is read where it has ended
        return False

    def close(self) -> bool:
        """Stop it, print its summary or its errors, and return whether it recorded until now."""
        early = self._process.poll() is not None
        if not early:
            self._process.terminate()
        try:
            summary, _ = self._process.communicate(timeout=_CLOSE_TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            summary, _ = self._process.communicate()
        self._reader.join(1.0)
        os.close(self._ready)
        if summary:
            print(summary, end="", flush=True)
        code = self._process.returncode
        if code == 0:
            if early:
                complain(_PROGRAM, "the recorder was stopped before the drill")
            return not early
        lines = [line for line in self._errors if line.startswith("rpud")]
        if not lines and code < 0:
            complain(_PROGRAM, f"the recorder was ended by signal {-code}; its bag is torn")
        else:
            print("\n".join(lines or list(self._errors)[-3:]), file=sys.stderr)
        return False

    def missing(self, sent: Mapping[str, int]) -> list[str]:
        """Return a line for each topic with more messages sent than in the closed bag."""
        import rpud_sim.bag
        from rpud_sim.bag import BagError

        try:
            with rpud_sim.bag.open(self._bag) as bag:
                recorded = {item.topic.name: item.message_count for item in bag.topics}
        except BagError as error:
            return [str(error)]
        return [
            f"{name}: {count} messages were sent, {recorded.get(name, 0)} are in the bag"
            for name, count in sorted(sent.items())
            if recorded.get(name, 0) < count
        ]

    def _read_errors(self) -> None:
        for line in self._stream:
            self._errors.append(line.rstrip("\n"))
