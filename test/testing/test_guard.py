"""The guard of a drill: nothing lives on when the process of the tests is killed."""

import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support import until

# A drill, and a node that obeys nothing and has started others, one of them in another session.
TESTS = """
import subprocess, time
from rpud_sim.testing.processes import DrillProcess

drill = DrillProcess()
drill.start({}, "/rpud")
node = "trap '' HUP INT TERM; sleep 1000 & setsid sleep 1000 & echo ready; wait; wait"
system = subprocess.Popen(
    ["sh", "-c", node], env=drill.environment, stdout=subprocess.PIPE, start_new_session=True
)
system.stdout.readline()
print(drill.folder, flush=True)
time.sleep(1000)
"""


def alive(folder):
    found = []
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            if folder.encode() in (entry / "environ").read_bytes():
                found.append((entry / "cmdline").read_text().replace("\0", " "))
        except OSError:
            continue
    return found


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGHUP])
def test_all_of_a_drill_ends_with_the_process_of_the_tests(number):
    words = [sys.executable, "-c", TESTS]
    tests = subprocess.Popen(words, stdout=subprocess.PIPE, text=True, start_new_session=True)
    folder = tests.stdout.readline().strip()
    # In the moment in which a process becomes another, its environment cannot be read.
    until(lambda: len(alive(folder)) >= 4)
    tests.send_signal(number)
    tests.communicate()
    until(lambda: not alive(folder) and not Path(folder).exists())
