"""Bags without ROS: writing and proving them, beside version 0.1.0 and the physical limit."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from mcap.records import Chunk
from mcap.stream_reader import StreamReader

from bench.checkout import VERSION_0_1_0, Checkout, Used, checkout, work_tree
from bench.row import Goal, Row, row
from rpud_sim.bag.open_chunk import ClosedChunk, Compressor
from rpud_sim.bag.records import uncompressed
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import Simulation
from rpud_sim.simulation.configuration import to_settings
from rpud_sim.simulation.sampling import Times

_DRILLING = {"regime": "drilling"}


def offline(seconds: int = 600, turns: int = 3) -> Iterator[Row]:
    """Time ``rpud simulate --bag`` and ``rpud verify``, start of the command included.

    Args:
        seconds: simulated time of the bag [s].
        turns: of each version, one after the other.
    """
    writing: list[tuple[Used, Used]] = []
    proving: list[tuple[Used, Used]] = []
    limits: list[tuple[float, float]] = []
    with checkout(VERSION_0_1_0) as base, work_tree() as present:
        for _ in range(turns):
            with tempfile.TemporaryDirectory() as folder:
                bags = [Path(folder) / name for name in ("base", "present")]
                pairs = list(zip((base, present), bags, strict=True))
                writing.append(_both(pairs, lambda bag: _simulate(bag, seconds)))
                proving.append(_both(pairs, lambda bag: ["rpud", "verify", bag]))
                limits.append(_limits(bags[1], seconds))
    yield from _compared(f"simulate --bag of {seconds} s", writing, Goal(least=3))
    yield from _compared(f"verify of {seconds} s", proving, Goal(least=8))
    for number, (name, used) in enumerate((("simulate --bag", writing), ("verify", proving))):
        spent = [limit[number] for limit in limits]
        ratios = [pair[1].processor / limit for pair, limit in zip(used, spent, strict=True)]
        yield row(f"{name}: limit, processor time", spent, "s")
        yield row(f"{name}: processor time over limit", ratios, "", Goal(most=1.5))


def _simulate(bag: Path, seconds: int) -> list[str | Path]:
    options = ["--regime", "drilling", "--duration", str(seconds)]
    return ["rpud", "simulate", *options, "--bag", bag]


def _both(
    pairs: list[tuple[Checkout, Path]], command: Callable[[Path], list[str | Path]]
) -> tuple[Used, Used]:
    base, present = (version.run(command(bag)) for version, bag in pairs)
    return base, present


def _compared(name: str, pairs: list[tuple[Used, Used]], goal: Goal) -> Iterator[Row]:
    yield row(f"{name}: processor time", [new.processor for _, new in pairs], "s")
    yield row(f"{name}: wall time", [new.wall for _, new in pairs], "s")
    yield row(f"{name}: peak memory", [new.memory / 2**20 for _, new in pairs], "MiB")
    ratios = [old.processor / new.processor for old, new in pairs]
    yield row(f"{name}: processor time of 0.1.0 over this", ratios, "", goal)
    ratios = [old.wall / new.wall for old, new in pairs]
    yield row(f"{name}: wall time of 0.1.0 over this", ratios, "", goal)


def _limits(bag: Path, seconds: int) -> tuple[float, float]:
    """Return the time of what no writing and no proof of a bag can do without [s].

    That is the engine, the samples of the waveform, and the compression of the chunks with its
    checksums, or their decompression; each measured alone on the data of this bag.
    """
    settings = to_settings(_DRILLING)
    simulation = Simulation(settings.configuration)
    engine = sampling = 0.0
    for second in range(1, seconds + 1):
        began = time.process_time()
        block = simulation.advance_to(second * SECOND)
        engine += time.process_time() - began
        numbers = block.grid(settings.sample_rate)
        began = time.process_time()
        block.sample(Times.from_grid(numbers.start, len(numbers), settings.sample_rate))
        sampling += time.process_time() - began
    compression = decompression = 0.0
    compressor = Compressor("zstd")
    for path in bag.glob("*.mcap"):
        with path.open("rb") as stream:
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    began = time.process_time()
                    data = uncompressed(record)
                    between = time.process_time()
                    compressor.record(ClosedChunk(data, 0, 0, {}))
                    compression += time.process_time() - between
                    decompression += between - began
    return engine + sampling + compression, engine + sampling + decompression
