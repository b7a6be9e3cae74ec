"""Bags without ROS: writing, proving, exporting and reading them, start of the command included."""

from __future__ import annotations

import sys
import tempfile
import time
import zlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import zstandard
from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from bench.command import RPUD, Used, run
from bench.table import Goal, Row, row
from rpud_sim.bag.mcap_writer import LEVEL
from rpud_sim.bag.records import uncompressed
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation

LONG, SHORT = 600, 120  # simulated time of the bags that are written and of those read [s]
TURNS = 3
TOPICS = ("contact_force", "drill_tool", "joint_states", "reacting_force", "waveform")
"""Topics whose arrays are read."""

_ARRAYS = """
import sys
import rpud_sim.bag

with rpud_sim.bag.open(sys.argv[1]) as bag:
    bag.arrays([f"/rpud/{name}" for name in sys.argv[2:]])
"""
# A third and an eighth of the processor time of version 0.1.0. With its set-up on one machine, by
# turns, that took 11.6 and 29.8 times these limits for ten minutes of bag.
_WRITING, _PROVING = Goal(most=3.87), Goal(most=3.72)
_START = "start of rpud simulate"
_GOALS = {  # processor time [s]
    _START: Goal(most=0.5),
    f"export of {LONG} s": Goal(most=8.0),
    f"report of {LONG} s": Goal(most=6.0),
}


def bags(long: int = LONG, short: int = SHORT, turns: int = TURNS) -> Iterator[Row]:
    """Time commands that write, prove, export and read bags of drilling."""
    writing, proving = f"simulate --bag of {long} s", f"verify of {long} s"
    used: dict[str, list[Used]] = {}
    limits: dict[str, list[float]] = {writing: [], proving: []}
    for _ in range(turns):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            bag, read = folder / "long", folder / "short"
            run(_simulate(short, read))
            commands = {
                _START: (*RPUD, "simulate", "--duration", "0.001"),
                writing: _simulate(long, bag),
                proving: (*RPUD, "verify", bag),
                f"export of {long} s": (*RPUD, "export", bag, "--out", folder / "tables"),
                f"arrays of {len(TOPICS)} topics of {short} s": (
                    *(sys.executable, "-c", _ARRAYS, read),
                    *TOPICS,
                ),
                f"report of {long} s": (*RPUD, "report", bag, "--out", folder / "report.html"),
            }
            for what, command in commands.items():
                used.setdefault(what, []).append(run(command))
            for what, spent in zip(limits, _limits(bag, long), strict=True):
                limits[what].append(spent)
    for what, found in used.items():
        seconds = [each.processor for each in found]
        yield row(f"{what}: processor time", seconds, "s", _GOALS.get(what))
        yield row(f"{what}: wall time", [each.wall for each in found], "s")
        yield row(f"{what}: peak memory", [each.memory / 2**20 for each in found], "MiB")
        if what in limits:
            yield row(f"{what}: limit, processor time", limits[what], "s")
            pairs = zip(found, limits[what], strict=True)
            ratios = [each.processor / limit for each, limit in pairs]
            goal = _WRITING if what == writing else _PROVING
            yield row(f"{what}: processor time over limit", ratios, goal=goal)


def _simulate(seconds: int, bag: Path) -> Sequence[str | Path]:
    return (*RPUD, "simulate", "--regime", "drilling", "--duration", str(seconds), "--bag", bag)


def _limits(bag: Path, seconds: int) -> tuple[float, float]:
    """Return the time that no writing and no proof of a bag can do without [s].

    That is the engine, the samples of the waveform, and the compression of the chunks with its
    checksums, or their decompression; each measured on the data of this bag.
    """
    settings = to_settings({"regime": "drilling"})
    simulation = Simulation(settings.configuration)
    began = time.process_time()
    for second in range(1, seconds + 1):
        block = simulation.advance_to(second * SECOND)
        numbers = block.grid(settings.sample_rate)
        block.sample(Times.from_grid(numbers.start, len(numbers), settings.sample_rate))
    simulated = time.process_time() - began
    compression = decompression = 0.0
    compress = zstandard.ZstdCompressor(level=LEVEL).compress
    for path in bag.glob("*.mcap"):
        with path.open("rb") as stream:
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    began = time.process_time()
                    data = uncompressed(record)
                    between = time.process_time()
                    compress(data)
                    zlib.crc32(data)
                    compression += time.process_time() - between
                    decompression += between - began
    return simulated + compression, simulated + decompression
