"""The busy loops beside a command run while it runs, and never after it."""

import re
import sys
from pathlib import Path

import pytest
from support import until

pytestmark = pytest.mark.extended

PROGRAM = Path(__file__).parent / "busy.py"


def children(pid):
    return Path(f"/proc/{pid}/task/{pid}/children").read_text().split()


def ticks(pid):
    """Processor time that a process has used, in ticks."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return int(fields[11]) + int(fields[12])


def ended(pid):
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] == "Z"
    except (FileNotFoundError, ProcessLookupError):
        return True


def start(process, *command):
    return process(sys.executable, PROGRAM, "--loops", "2", "--", *command)


def test_it_gives_the_exit_code_of_the_command(process):
    busy = start(process, sys.executable, "-c", "print('ran'); raise SystemExit(3)")
    assert busy.wait() == 3
    assert busy.output == "ran"


def test_loops_use_the_processors_and_die_with_their_parent_however_it_dies(process):
    busy = start(process, sys.executable, "-c", "import time; print('runs'); time.sleep(100)")
    busy.wait_for_line("runs")
    loops = [pid for pid in children(busy.pid) if re.search("getppid", command_line(pid))]
    assert len(loops) == 2
    for pid in loops:
        until(lambda pid=pid: ticks(pid) > 10)
    busy.kill()
    for pid in loops:
        until(lambda pid=pid: ended(pid))


def command_line(pid):
    return Path(f"/proc/{pid}/cmdline").read_text()
