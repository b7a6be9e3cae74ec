"""How late this machine wakes a Python thread that waits for every default period and does nothing.

As a program it prints a line when it begins. It runs until SIGINT, and then prints the quantiles of
its lateness [ms], and how often it was late by half a period, as JSON. As a separate process beside
the node it has the same minutes: the same neighbours, and the same listener. A machine may stop one
processor alone: a timer that keeps to one of them sees what a block there has to wait.
"""

from __future__ import annotations

import json
import os
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
# How often. A stop of the machine that makes a block late, which has its work to do in the period,
# must not escape the timer, which has none: it counts from half a period.
LATE = "late"
PRIORITY = Settings().thread_priority  # of the node


class BareTimer:
    """This program in a separate process, with a priority, on all processors or on one."""

    def __init__(self, priority: int, processor: int | None = None) -> None:
        where = () if processor is None else (str(processor),)
        words = (sys.executable, "-m", "bench.bare_timer", str(priority), *where)
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, text=True)

    def __enter__(self) -> BareTimer:
        assert self.process.stdout
        self.process.stdout.readline()  # it has begun
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()

    def end(self) -> dict[str, float]:
        """End it, and return what it prints."""
        self.process.send_signal(signal.SIGINT)
        output, _ = self.process.communicate(timeout=30.0)
        found: dict[str, float] = json.loads(output)
        return found


def main(priority: int, processor: int | None = None) -> None:
    """Wait for deadlines, with a real-time priority if it is not zero and the system permits it."""
    if processor is not None:
        os.sched_setaffinity(0, {processor})
    stop, wake = threading.Event(), threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    schedule_thread(priority)
    lateness, late = DelayHistogram(), 0
    due, ended = time.monotonic_ns(), False
    print("begun", flush=True)
    while not ended:
        ended = stop.is_set()  # before the last wait, so that a stop up to the end is counted
        due += round(PERIOD * SECOND)
        wake.wait(max(0.0, (due - time.monotonic_ns()) / SECOND))
        delay = time.monotonic_ns() - due
        lateness.add(delay)
        late += delay > PERIOD / 2 * SECOND
    found = {key: 1e3 * lateness.quantile(share) for key, share in SHARES.items()}
    print(json.dumps({**found, LATE: late}))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
