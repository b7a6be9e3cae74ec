"""How late this machine wakes a Python thread that waits for every default period and does nothing.

Prints a line when it begins. Runs until SIGINT, and then prints the quantiles of its lateness [ms]
as JSON. As a separate process beside the node it has the same minutes: the same neighbours, and
the same listener.
"""

from __future__ import annotations

import json
import signal
import sys
import threading
import time

from rpud_sim.foundation.time import SECOND
from rpud_sim.ros.threads import DelayHistogram, schedule_thread

PERIOD = 0.01  # of blocks at the default rate [s]
SHARES = {"p50": 0.5, "p99": 0.99, "p99.9": 0.999}


def main(priority: int) -> None:
    """Wait for deadlines, with a real-time priority if it is not zero and the system permits it."""
    stop, wake = threading.Event(), threading.Event()
    signal.signal(signal.SIGINT, lambda *_: stop.set())
    schedule_thread(priority)
    lateness = DelayHistogram()
    print("begun", flush=True)
    due = time.monotonic_ns()
    while not stop.is_set():
        due += round(PERIOD * SECOND)
        wake.wait(max(0.0, (due - time.monotonic_ns()) / SECOND))
        lateness.add(time.monotonic_ns() - due)
    print(json.dumps({key: 1e3 * lateness.quantile(share) for key, share in SHARES.items()}))


if __name__ == "__main__":
    main(int(sys.argv[1]))
