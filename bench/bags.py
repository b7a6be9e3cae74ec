"""Bags without ROS: writing, proving, exporting and reading them, start of the command included."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

from bench.command import RPUD, Used, run
from bench.table import Row, row

LONG = 600  # simulated time of the bag [s]
TURNS = 3
_ARRAYS = """
import sys
import rpud_sim.bag

with rpud_sim.bag.open(sys.argv[1]) as bag:
    bag.arrays([f"/rpud/{name}" for name in sys.argv[2:]])
"""
_TOPICS = ("contact_force", "drill_tool", "joint_states", "reacting_force", "waveform")
_GOALS = {"start of rpud simulate": 0.5, "export": 8.0, "report": 6.0}  # processor time [s]


def bags(seconds: int = LONG, turns: int = TURNS) -> Iterator[Row]:
    """Time commands that write, prove, export and read a bag of drilling."""
    used: dict[str, list[Used]] = {}
    for _ in range(turns):
        with tempfile.TemporaryDirectory() as folder:
            bag = Path(folder, "bag")
            simulate = (*RPUD, "simulate", "--regime", "drilling", "--duration")
            commands = {
                "start of rpud simulate": (*simulate, "0.001"),
                "simulate": (*simulate, str(seconds)),
                "simulate --bag": (*simulate, str(seconds), "--bag", bag),
                "verify": (*RPUD, "verify", bag),
                "export": (*RPUD, "export", bag, "--out", bag.with_name("tables")),
                "arrays of five topics": (sys.executable, "-c", _ARRAYS, bag, *_TOPICS),
                "report": (*RPUD, "report", bag, "--out", bag.with_name("report.html")),
            }
            for what, command in commands.items():
                used.setdefault(what, []).append(run(command))
    for what, found in used.items():
        name = what if what in ("start of rpud simulate",) else f"{what}, {seconds} s"
        times = [each.processor for each in found]
        yield row(f"{name}: processor time", times, "s", most=_GOALS.get(what))
        yield row(f"{name}: wall time", [each.wall for each in found], "s")
        yield row(f"{name}: peak memory", [each.memory / 2**20 for each in found], "MiB")
