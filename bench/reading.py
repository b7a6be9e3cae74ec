"""Reading of bags: tables, arrays and reports, beside version 0.1.0 and the physical limit."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

import pyarrow as pa
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from pyarrow import parquet

from bench.checkout import VERSION_0_1_0, Checkout, Used, checkout, work_tree
from bench.row import Goal, Row, row
from rpud_sim.bag.records import uncompressed

TOPICS = ("contact_force", "drill_tool", "joint_states", "reacting_force", "waveform")
"""Topics whose arrays are read."""

TOGETHER = "arrays of 5 topics in one call, beside a call for each in 0.1.0"
SINGLY = "arrays of 5 topics, a call for each"

GOALS: Mapping[str, Goal | None] = {"export": Goal(least=3), TOGETHER: Goal(least=5), SINGLY: None}
"""Wall time of 0.1.0 over that of this version, for work on both cores."""

_OPEN = """
import sys
import rpud_sim.bag

topics = [f"/rpud/{name}" for name in sys.argv[2:]]
with rpud_sim.bag.open(sys.argv[1]) as bag:
"""
_SINGLY = f"{_OPEN}    for topic in topics: bag.arrays(topic)\n"
TOGETHER_CODE = f"{_OPEN}    bag.arrays(topics)\n"
"""Reads the arrays of topics; its arguments are a bag and the names."""


def reading(seconds: int = 120, turns: int = 3) -> Iterator[Row]:
    """Time `rpud export`, `BagReader.arrays` and `rpud report` of one bag.

    The report is that of this version alone: 0.1.0 needs another library for its pictures.

    Args:
        seconds: simulated time of the bag [s].
        turns: of each version, one after the other.
    """
    pairs: dict[str, list[tuple[Used, Used]]] = {name: [] for name in GOALS}
    limits: dict[str, list[float]] = {name: [] for name in (*GOALS, "report")}
    reports: list[Used] = []
    with (
        checkout(VERSION_0_1_0) as base,
        work_tree() as present,
        tempfile.TemporaryDirectory() as folder,
    ):
        bag = Path(folder) / "bag"
        present.run(["rpud", "simulate", *_run(seconds), "--bag", bag])
        for turn in range(turns):
            out = {
                version.commit: Path(folder, f"{turn}{version.commit}")
                for version in (base, present)
            }
            for name in GOALS:
                old, new = (
                    _used(version, _command(one, bag, out[version.commit]))
                    for version, one in (
                        (base, SINGLY if name == TOGETHER else name),
                        (present, name),
                    )
                )
                pairs[name].append((old, new))
            reports.append(present.run(_command("report", bag, out[""])))
            decompression = _decompression(bag)
            compression = _compression(out[""] / "tables")
            limits["export"].append(decompression + compression)
            limits[TOGETHER].append(decompression)
            limits[SINGLY].append(decompression * len(TOPICS))
            limits["report"].append(decompression)
    for name, goal in GOALS.items():
        yield from _compared(f"{name} of {seconds} s", pairs[name], goal)
        used = [new for _, new in pairs[name]]
        yield from _limited(f"{name} of {seconds} s", used, limits[name], goal and Goal(most=1.5))
    yield from _limited(f"report of {seconds} s", reports, limits["report"], None)


def _run(seconds: int) -> Sequence[str]:
    return ("--regime", "drilling", "--duration", str(seconds))


def _command(name: str, bag: Path, out: Path) -> Sequence[str | Path]:
    if name == "export":
        return ["rpud", "export", bag, "--out", out / "tables"]
    if name == "report":
        return ["rpud", "report", bag, "--out", out / "report.html"]
    return ["python", "-c", TOGETHER_CODE if name == TOGETHER else _SINGLY, bag, *TOPICS]


def _used(version: Checkout, command: Sequence[str | Path]) -> Used:
    for word in command:
        if isinstance(word, Path):
            word.parent.mkdir(exist_ok=True)
    return version.run(command)


def _compared(name: str, pairs: Sequence[tuple[Used, Used]], goal: Goal | None) -> Iterator[Row]:
    ratios = [old.processor / new.processor for old, new in pairs]
    yield row(f"{name}: processor time of 0.1.0 over this", ratios)
    ratios = [old.wall / new.wall for old, new in pairs]
    yield row(f"{name}: wall time of 0.1.0 over this", ratios, "", goal)
    ratios = [old.memory / new.memory for old, new in pairs]
    yield row(f"{name}: peak memory of 0.1.0 over this", ratios)


def _limited(
    name: str, used: Sequence[Used], limits: Sequence[float], goal: Goal | None
) -> Iterator[Row]:
    yield row(f"{name}: processor time", [each.processor for each in used], "s")
    yield row(f"{name}: wall time", [each.wall for each in used], "s")
    yield row(f"{name}: peak memory", [each.memory / 2**20 for each in used], "MiB")
    yield row(f"{name}: limit, processor time", limits, "s")
    ratios = [each.processor / limit for each, limit in zip(used, limits, strict=True)]
    yield row(f"{name}: processor time over limit", ratios, "", goal)


def _decompression(bag: Path) -> float:
    """Return the time to read a bag's chunks, to decompress them and to check them [s]."""
    spent = 0.0
    for path in bag.glob("*.mcap"):
        with path.open("rb") as stream:
            began = time.process_time()
            for record in StreamReader(stream, emit_chunks=True).records:
                if isinstance(record, Chunk):
                    uncompressed(record)
            spent += time.process_time() - began
    return spent


def _compression(folder: Path) -> float:
    """Return the time to encode and compress tables that are in memory as Parquet [s]."""
    spent = 0.0
    for path in folder.glob("*.parquet"):
        file = parquet.ParquetFile(path)
        texts = [field.name for field in file.schema_arrow if field.type == pa.string()]
        writer = parquet.ParquetWriter(
            pa.BufferOutputStream(), file.schema_arrow, compression="zstd", use_dictionary=texts
        )
        for group in range(file.num_row_groups):
            table = file.read_row_group(group)
            began = time.process_time()
            writer.write_table(table)
            spent += time.process_time() - began
        writer.close()
    return spent
