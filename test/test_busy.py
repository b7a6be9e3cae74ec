"""The busy loops beside a command run while it runs, and never after it."""

import re
import sys
from pathlib import Path

import pytest
from support import until

pytestmark = pytest.mark.extended

PROGRAM = Path(__file__).parent / "helpers" / "busy.py"


def stat(pid):
    """Fields of /proc/PID/stat after the name: the state first; of a process that is gone, Z."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return ["Z"]


@pytest.mark.parametrize("killed", [False, True])
def test_loops_use_the_processors_and_end_with_the_command_or_their_killed_parent(process, killed):
    command = "import sys; print('runs'); sys.stdin.read(); sys.exit(3)"
    command = command if not killed else "import time; print('runs'); time.sleep(1000)"
    words = ("--loops", "2", "--", sys.executable, "-c", command)
    busy = process(sys.executable, PROGRAM, *words)
    busy.wait_for_line("runs")
    children = Path(f"/proc/{busy.pid}/task/{busy.pid}/children").read_text().split()
    lines = {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in children}
    loops = [pid for pid, line in lines.items() if re.search("getppid", line)]
    if killed:
        assert len(loops) == 2
        until(lambda: all(sum(map(int, stat(pid)[11:13])) > 10 for pid in loops))  # ticks
        busy.kill()
    assert busy.wait() == (-9 if killed else 3)
    until(lambda: all(stat(pid)[0] == "Z" for pid in loops))
