"""The recorder: how many messages and bytes per second it takes, and whether it loses any."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from bench.row import Row, row
from rpud_sim.bag import BagReader

SECONDS = 5.0  # of talking
RATES: dict[int, Sequence[int]] = {100: (5_000, 10_000, 20_000), 1_000_000: (20, 50, 100)}
_RPUD = (sys.executable, "-m", "rpud_sim.cli.main")
_ENDING = 120.0  # [s]


def recorder() -> Iterator[Row]:
    """Record the drill's own mix, and small and large messages at rising rates."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _drill(Path(folder, "drill"))
        for size, rates in RATES.items():
            greatest = 0.0
            for rate in rates:
                bag = Path(folder, f"{size}_{rate}")
                published, elapsed, recorded, share = _talk(bag, size, rate)
                name = f"recorder, {size:,} bytes at {rate:,} per second"
                yield row(f"{name}: published per second", [published / elapsed], "1/s")
                yield row(f"{name}: lost", [published - recorded])
                yield row(f"{name}: recorder's share of one core", [100.0 * share], "%")
                if recorded == published:
                    greatest = max(greatest, recorded / elapsed)
            yield row(f"recorder, {size:,} bytes: most without loss", [greatest], "1/s")
            yield row(f"recorder, {size:,} bytes: most without loss", [greatest * size], "B/s")


def _drill(bag: Path) -> Iterator[Row]:
    words = (*_RPUD, "run", "--duration", str(2.0 * SECONDS), "--record", str(bag))
    done = subprocess.run(words, capture_output=True, text=True, timeout=_ENDING, check=True)
    lost = sum(map(int, re.findall(r"lost (\d+) messages", done.stdout)))
    with BagReader(bag) as reader:
        seconds, count, size = reader.duration / 1e9, reader.message_count, 0
        for message in reader.messages():
            size += len(message.data)
    yield row("recorder, the drill's mix: messages per second", [count / seconds], "1/s")
    yield row("recorder, the drill's mix: bytes per second", [size / seconds], "B/s")
    yield row("recorder, the drill's mix: lost", [lost])


def _talk(bag: Path, size: int, rate: int) -> tuple[int, float, int, float]:
    """Messages published, in which time [s], messages recorded, and share of one core."""
    namespace = f"/bench_{os.getpid()}_{size}_{rate}"
    listening = subprocess.Popen(
        (*_RPUD, "record", "--namespace", namespace, "--out", str(bag)), stdout=subprocess.PIPE
    )
    try:
        words = (sys.executable, "-m", "bench.byte_talker", f"{namespace}/bytes")
        rates = ("--size", str(size), "--rate", str(rate), "--seconds", str(SECONDS))
        before = _used(listening.pid)
        done = subprocess.run(
            (*words, *rates), capture_output=True, text=True, timeout=_ENDING, check=True
        )
        used = _used(listening.pid) - before
        time.sleep(1.0)
    finally:
        listening.send_signal(signal.SIGINT)
        listening.communicate(timeout=_ENDING)
    found = re.search(r"published (\d+) in ([0-9.]+)", done.stdout)
    if found is None:
        raise RuntimeError(f"the talker did not say what it published:\n{done.stdout}")
    with BagReader(bag) as reader:
        recorded = reader.message_count
    elapsed = float(found.group(2))
    return int(found.group(1)), elapsed, recorded, used / elapsed


def _used(pid: int) -> float:
    """Time of processors that a process has used [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
