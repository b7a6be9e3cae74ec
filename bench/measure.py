"""What is measured, each as a function that returns rows of a table."""

from __future__ import annotations

import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from bench.engine import engine
from bench.row import Row, row
from bench.start import start

NODE_SECONDS = 10.0


def node() -> Iterator[Row]:
    """Run the node in real time at its default rates, and read its own account."""
    import tempfile

    with tempfile.TemporaryDirectory() as folder:
        process = subprocess.Popen(
            [
                *(sys.executable, "-m", "rpud_sim.cli.main", "run"),
                *("--duration", str(NODE_SECONDS), "--record", str(Path(folder, "bag"))),
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        try:
            share = _cpu_share(process.pid)
            output, live = process.communicate(timeout=60.0)
        except BaseException:
            process.send_signal(signal.SIGINT)
            process.wait(10.0)
            raise
    lateness = [float(value) for value in re.findall(r"late ([0-9.]+) ms", live)]
    missed = re.search(r"(\d+) deadlines missed", output)
    if not lateness or missed is None:
        raise RuntimeError(f"rpud run did not report its timing:\n{output}{live}")
    yield row("node: latest block of each second", lateness, "ms")
    yield row("node: deadlines missed", [float(missed.group(1))], "")
    yield row("node: share of one core while it records", [share], "%")


def _cpu_share(pid: int) -> float:
    """Share of one core that a process takes in the middle of its run [%]."""
    import os

    def ticks() -> int:
        fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        return int(fields[11]) + int(fields[12])

    time.sleep(0.5 * NODE_SECONDS)
    before = ticks()
    time.sleep(0.3 * NODE_SECONDS)
    used = (ticks() - before) / os.sysconf("SC_CLK_TCK")
    return 100.0 * used / (0.3 * NODE_SECONDS)


MEASUREMENTS = (engine, start, node)
