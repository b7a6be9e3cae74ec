"""The tests' own tools: a leaked process or a shared ROS domain would spoil every other test."""

import os
import select
import signal
import sys

from support import Process

STUBBORN = """
import signal, subprocess, sys, time
signal.signal(signal.SIGINT, signal.SIG_IGN)
child = subprocess.Popen([sys.executable, "-c", "import time; time.sleep(600)"])
print("child", child.pid, flush=True)
time.sleep(600)
"""


def has_ended(pid: int) -> bool:
    """Wait until a process that need not be a child has ended, or 5 s."""
    try:
        descriptor = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    ready, _, _ = select.select([descriptor], [], [], 5.0)
    os.close(descriptor)
    return bool(ready)


def test_stop_ends_a_process_that_ignores_sigint_and_its_children(monkeypatch):
    monkeypatch.setattr("rpud_sim.foundation.child_process._GRACE", 1.0)
    stubborn = Process(sys.executable, "-c", STUBBORN)
    child = int(stubborn.wait_for_line(r"child (\d+)").group(1))
    stubborn.stop()
    assert stubborn.wait() == -signal.SIGTERM
    assert has_ended(child)
