"""How late this machine wakes a Python thread that waits for every default period and does nothing.

As a program it prints a line when it begins. It runs until SIGINT, and then prints the quantiles of
its lateness [ms], and how often it was late by a period, as JSON. As a separate process beside the
node it has the same minutes: the same neighbours, and the same listener.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import threading
import time

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.threads import DelayHistogram, schedule_thread
from rpud_sim.simulation.configuration import Settings

PERIOD = 0.01  # of blocks at the default rate [s]
SHARES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}
LATE = "late"
PRIORITY = Settings().thread_priority  # of the node


class BareTimer:
    """This program in a separate process, with a priority."""

    def __init__(self, priority: int) -> None:
        words = (sys.executable, "-m", "bench.bare_timer", str(priority))
        self._process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> BareTimer:
        assert self._process.stdout
        self._process.stdout.readline()  # it has begun
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait()

    def end(self) -> dict[str, float]:
        """End it, and return what it prints."""
        self._process.send_signal(signal.SIGINT)
        said, _ = self._process.communicate(timeout=30.0)
        found: dict[str, float] = json.loads(said)
        return found


def main(priority: int) -> None:
    """Wait for deadlines, with a real-time priority if it is not zero and the system permits it."""
    stop, wake = threading.Event(), threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    schedule_thread(priority)
    lateness, late = DelayHistogram(), 0
    print("begun", flush=True)
    due = time.monotonic_ns()
    while not stop.is_set():
        due += round(PERIOD * SECOND)
        wake.wait(max(0.0, (due - time.monotonic_ns()) / SECOND))
        delay = time.monotonic_ns() - due
        lateness.add(delay)
        late += delay > PERIOD * SECOND
    found = {key: 1e3 * lateness.quantile(share) for key, share in SHARES.items()}
    print(json.dumps({**found, LATE: late}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
