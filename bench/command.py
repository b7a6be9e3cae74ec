"""Commands of `rpud`, with the processor time, wall time and memory that they take.

As a script, ``command.py FILE COMMAND...`` runs a command and writes its usage to a file. A process
inherits the peak memory of the one that starts it, so a small process has to start the command.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

RPUD = (sys.executable, "-m", "rpud_sim.cli.main")
"""First words of a command of `rpud` with this Python."""


class Used(NamedTuple):
    """What a command used, and what it printed."""

    processor: float  # time of all its processes [s]
    wall: float  # [s]
    memory: int  # peak [byte]
    output: str  # standard output


def run(command: Sequence[str | Path], environment: Mapping[str, str] | None = None) -> Used:
    """Run a command until it ends, in a temporary folder.

    Raises:
        RuntimeError: if its exit code is not zero.
    """
    words = [str(word) for word in command]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "used.json")
        done = subprocess.run(
            [sys.executable, str(Path(__file__).resolve()), str(file), *words],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            check=False,
        )
        if done.returncode:
            lines = done.stderr.strip().splitlines()
            last = lines[-1] if lines else "no message"
            raise RuntimeError(f"{' '.join(words)}: exit code {done.returncode}: {last}")
        return Used(**json.loads(file.read_text()), output=done.stdout)


def _measure(file: str, command: Sequence[str]) -> int:
    began = time.perf_counter()
    process = subprocess.Popen(command)
    try:
        _, status, usage = os.wait4(process.pid, 0)
    except BaseException:
        process.kill()
        raise
    processor, wall = usage.ru_utime + usage.ru_stime, time.perf_counter() - began
    found = {"processor": processor, "wall": wall, "memory": usage.ru_maxrss * 1024}
    Path(file).write_text(json.dumps(found))
    return os.waitstatus_to_exitcode(status)


if __name__ == "__main__":
    sys.exit(_measure(sys.argv[1], sys.argv[2:]))
