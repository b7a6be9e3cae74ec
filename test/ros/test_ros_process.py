"""ROS starts, or says in one line why not; a signal stops it, and nothing hangs at its end."""

import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from importlib import metadata
from pathlib import Path

import pytest

from rpud_sim.bag import BagWriter
from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.ros.environment import StartError
from rpud_sim.ros.process import StopRequest, running_ros, start_ros

SECURITY = {"ROS_SECURITY_ENABLE": "true"}


@pytest.fixture
def bag(tmp_path):
    with BagWriter(tmp_path / "empty"):
        pass
    return tmp_path / "empty"


def commands(bag):
    new = bag.parent / "new"
    return {
        "rpud run": ("rpud", "run", "--duration", "1", "--record", new),
        "drill_node": ("drill_node",),
        "rpud record": ("rpud", "record", "--out", new),
        "rpud replay": ("rpud", "replay", bag),
    }


def wheels_are_installed():
    try:
        return bool(metadata.version("ros-fastrtps"))
    except metadata.PackageNotFoundError:
        return False


@pytest.mark.parametrize(
    ("variables", "reason"),
    [
        ({}, "HOME is not set"),
        ({"HOME": "/dev/null"}, "/dev/null/.ros/log: Not a directory"),
        ({"HOME": "/dev/null", "ROS_HOME": "~/r"}, "/dev/null/r/log: Not a directory"),
        ({"ROS_LOG_DIR": "/dev/null/log"}, "/dev/null/log: Not a directory"),
        ({"ROS_LOG_DIR": "HERE/log"}, ""),
    ],
)
def test_ros_starts_without_a_folder_for_its_log_and_says_so_in_one_line(
    tmp_path, variables, reason
):
    here = {name: each.replace("HERE", str(tmp_path)) for name, each in variables.items()}
    own = {k: v for k, v in os.environ.items() if k not in ("HOME", "ROS_HOME", "ROS_LOG_DIR")}
    script = "from rpud_sim.ros.process import start_ros; start_ros()"
    done = subprocess.run(
        [sys.executable, "-c", script], env=own | here, capture_output=True, text=True
    )
    assert (done.returncode, done.stdout) == (0, "")
    line = f"[rpud_sim]: no log file: {reason}; ROS_LOG_DIR names a folder\n"
    assert done.stderr.partition(" ")[2].partition(" ")[2] == (line if reason else "")


@pytest.mark.extended
@pytest.mark.skipif(not wheels_are_installed(), reason="an installed ROS has DDS-Security")
@pytest.mark.parametrize("name", commands(Path()))
@pytest.mark.parametrize("keystore", [False, True], ids=["without_keystore", "with_keystore"])
def test_security_that_the_wheels_lack_is_refused_in_one_line(process, bag, name, keystore):
    environment = {**os.environ, **SECURITY}
    if keystore:
        (bag.parent / "keystore" / "enclaves").mkdir(parents=True)
        environment["ROS_SECURITY_KEYSTORE"] = str(bag.parent / "keystore")
    command = process(*commands(bag)[name], env=environment)
    assert command.wait() == 2
    assert command.output == (
        f"{name}: ROS_SECURITY_ENABLE is true, but the ROS wheels are built without DDS-Security: "
        "use an installed ROS, or unset ROS_SECURITY_ENABLE"
    )
    assert not (bag.parent / "new").exists()


def test_a_domain_that_cannot_be_is_refused_in_one_line(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "300")
    with pytest.raises(
        ParameterError, match=r"^ROS_DOMAIN_ID = 300 is outside its range \[0, 232\]$"
    ):
        start_ros()


def test_a_response_that_nobody_takes_is_a_line_of_the_log(capfd):
    shown = warnings.showwarning
    with running_ros():
        # As rclpy warns; Python shows a warning once for each place.
        warnings.showwarning("failed to send response (timeout): x", RuntimeWarning, "f.py", 1)
    error = capfd.readouterr().err
    assert error.endswith("[rpud_sim]: a client did not take its response: it may have ended\n")
    assert warnings.showwarning is shown


def test_a_parameter_file_that_is_a_fifo_is_refused_without_waiting(tmp_path):
    os.mkfifo(tmp_path / "fifo")
    with pytest.raises(StartError, match=f"^{tmp_path}/fifo: is not a regular file$"):
        start_ros(["--ros-args", "--params-file", str(tmp_path / "fifo")])


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


HUNG = """
import threading
from rpud_sim.ros import process
from rpud_sim.ros.drill.drill_node import DrillNode, spin
from rpud_sim.ros.process import start_ros

class Hung(DrillNode):
    def start(self):
        pass

    def stop(self):
        threading.Event().wait()

process.LONGEST_END = 0.5
start_ros()
with process.StopRequest() as stop:
    stop.request()
    spin(Hung(), stop)
"""


def test_a_drill_whose_middleware_hangs_ends_all_the_same():
    done = subprocess.run(
        [sys.executable, "-c", HUNG], capture_output=True, text=True, check=False, timeout=60.0
    )
    assert done.returncode == 1
    assert "in stop" in done.stderr
