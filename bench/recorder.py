"""The recorder: how many messages and bytes per second it takes, and whether it loses any."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import IO, NamedTuple

from bench.command import RPUD
from bench.table import Row, row, used_by
from rpud_sim.bag import BagReader

SECONDS = 5.0  # of talking
RATES: Mapping[int, Sequence[int]] = {
    100: (10_000, 20_000, 30_000, 40_000, 45_000, 50_000),
    1_000_000: (20, 50, 100, 200),
}
STARTS = 5
_SMALL = 40_000  # messages of 100 bytes per second without loss
_ENDING = 120.0  # [s]
_STARTING = 4.0  # until a recorder that started is stopped [s]


class _Recorded(NamedTuple):
    """What became of messages: published in how many seconds, recorded, and the share of a core."""

    published: int
    elapsed: float
    recorded: int
    share: float


def recorder() -> Iterator[Row]:
    """Record the drill's own mix, and small and large messages at rising rates."""
    with tempfile.TemporaryDirectory() as folder:
        yield from _starts(Path(folder))
        yield from _drill(Path(folder, "drill"))
        for size, rates in RATES.items():
            best = 0.0
            for rate in rates:
                found = _talk(Path(folder), size, rate)
                what = f"rpud record, {size:,} bytes at {rate:,} per second"
                yield row(f"{what}: published", [found.published / found.elapsed], "1/s")
                yield row(f"{what}: lost", [found.published - found.recorded])
                yield row(f"{what}: share of one core", [100.0 * found.share], "%")
                if found.recorded == found.published:
                    best = max(best, found.recorded / found.elapsed)
            what = f"rpud record, {size:,} bytes: most without loss"
            goal = _SMALL if size == min(RATES) else None
            yield row(what, best, "messages/s", least=goal)
            yield row(what, [best * size], "B/s")


def _recorder(topic: str, bag: Path, nowhere: IO[str]) -> subprocess.Popen[bytes]:
    words = (*RPUD, "record", topic, "--out", str(bag))
    return subprocess.Popen(words, stdout=nowhere, stderr=nowhere)


def _starts(folder: Path) -> Iterator[Row]:
    """Start recorders beside a publisher: time from the command to the first message in the bag."""
    topic = f"/bench_{os.getpid()}/start"
    words = (sys.executable, "-m", "bench.byte_talker", topic, "--size", "100", "--rate", "100")
    found = []
    with (
        open(os.devnull, "w") as nowhere,
        subprocess.Popen(
            (*words, "--alone", "--seconds", "1e6"), stdout=subprocess.PIPE
        ) as talking,
    ):
        try:
            assert talking.stdout is not None
            talking.stdout.readline()  # it begins
            for number in range(STARTS):
                bag, began = folder / f"start_{number}", time.time_ns()
                with _recorder(topic, bag, nowhere) as recording:
                    time.sleep(_STARTING)
                    recording.send_signal(signal.SIGINT)
                    recording.wait(_ENDING)
                with BagReader(bag) as reader:
                    found.append((reader.start_time - began) / 1e9)
        finally:
            talking.kill()
    yield row("rpud record: start to first message", found, "s", most=1.5)


def _drill(bag: Path) -> Iterator[Row]:
    words = (*RPUD, "run", "--duration", str(2.0 * SECONDS), "--record", str(bag))
    done = subprocess.run(words, capture_output=True, text=True, timeout=_ENDING, check=True)
    lost = sum(map(int, re.findall(r"lost (\d+) messages", done.stdout)))
    with BagReader(bag) as reader:
        seconds, count = reader.duration / 1e9, reader.message_count
        size = sum(len(message.data) for message in reader.messages())
    yield row("rpud record, the drill's mix: messages per second", [count / seconds], "messages/s")
    yield row("rpud record, the drill's mix: bytes per second", [size / seconds], "B/s")
    yield row("rpud record, the drill's mix: lost", [lost])


def _talk(folder: Path, size: int, rate: int) -> _Recorded:
    bag = folder / f"bag_{len(os.listdir(folder))}"
    topic = f"/bench_{os.getpid()}/{bag.name}"
    talk = (sys.executable, "-m", "bench.byte_talker", topic, "--size", str(size))
    rates = ("--rate", str(rate), "--seconds", str(SECONDS))
    with (
        open(os.devnull, "w") as nowhere,
        _recorder(topic, bag, nowhere) as listening,
        subprocess.Popen((*talk, *rates), stdout=subprocess.PIPE, text=True) as talking,
    ):
        try:
            assert talking.stdout is not None
            talking.stdout.readline()  # it begins
            before = used_by(listening.pid)
            said = talking.stdout.readline()
            used = used_by(listening.pid) - before
            talking.wait(_ENDING)
            time.sleep(1.0)
        finally:
            talking.terminate()
            listening.send_signal(signal.SIGINT)
            listening.wait(_ENDING)
    found = re.search(r"published (\d+) in ([0-9.]+)", said)
    if found is None:
        raise RuntimeError(f"the talker did not report what it published, but {said!r}")
    with BagReader(bag) as reader:
        recorded = reader.message_count
    elapsed = float(found[2])
    return _Recorded(int(found[1]), elapsed, recorded, used / elapsed)
