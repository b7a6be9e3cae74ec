"""SIGINT, SIGTERM and SIGHUP ask for a stop, interrupt sleep, and are given back afterwards."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from rpud_sim.ros.stopping import StopRequest


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_interrupts_the_sleep(number):
    before = signal.getsignal(number)
    with StopRequest() as stop:
        assert callable(signal.getsignal(number))
        assert not stop.requested
        sender = threading.Timer(0.05, os.kill, (os.getpid(), number))
        sender.start()
        began = time.monotonic()
        assert stop.wait(60.0)
        assert time.monotonic() - began < 30.0
        assert stop.requested
        sender.join()
    assert signal.getsignal(number) is before


@pytest.mark.parametrize(("with_parent", "ends"), [(True, True), (False, False)])
def test_the_end_of_the_parent_requests_a_stop_where_it_is_wanted(monkeypatch, with_parent, ends):
    with StopRequest(with_parent) as stop:
        assert not stop.requested
        monkeypatch.setattr(os, "getppid", lambda: 1)
        assert (stop.requested, stop.orphaned, stop.wait(0.0)) == (ends, ends, ends)


def test_a_hangup_that_is_ignored_stays_ignored():
    before = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with StopRequest() as stop:
            os.kill(os.getpid(), signal.SIGHUP)
            assert not stop.requested
        assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    finally:
        signal.signal(signal.SIGHUP, before)


def test_more_signals_change_nothing():
    with StopRequest() as stop:
        for _ in range(100_000):
            stop.request()
        os.kill(os.getpid(), signal.SIGTERM)
        assert stop.wait(60.0)


def test_without_a_request_the_sleep_is_as_long_as_asked():
    with StopRequest() as stop:
        began = time.monotonic()
        assert not stop.wait(0.02)
        assert time.monotonic() - began >= 0.02
        assert not stop.wait(-1.0)


HUNG = """
import threading
from rpud_sim.ros import stopping
from rpud_sim.ros.drill.drill_node import DrillNode, spin
from rpud_sim.ros.starting import start_ros

class Hung(DrillNode):
    def start(self):
        pass

    def stop(self):
        threading.Event().wait()

stopping.LONGEST_END = 0.5
start_ros()
with stopping.StopRequest() as stop:
    stop.request()
    spin(Hung(), stop)
"""


def test_a_drill_whose_middleware_hangs_ends_all_the_same():
    done = subprocess.run(
        [sys.executable, "-c", HUNG], capture_output=True, text=True, check=False, timeout=60.0
    )
    assert done.returncode == 1
    assert "in stop" in done.stderr
