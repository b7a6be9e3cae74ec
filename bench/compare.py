"""What became slower or faster than another commit: both run the same work by turns.

A work is a whole command in a process of its own, so that the spread between processes counts. Its
time is that of processors, of all its processes.
"""

from __future__ import annotations

import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from bench.checkout import Checkout, CheckoutError, Used, checkout, work_tree
from bench.ratios import INCOMPARABLE, Ratio, judge
from bench.row import Row, row

PAIRS = 8
THRESHOLD = 0.1
Command = Sequence[str | Path]

_ENGINE = """
import time
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation

simulation = Simulation(preset("drilling"), 0.0)
simulation.advance_to(10**9)
began = time.process_time()
for end in range(10, 310, 10):
    simulation.advance_to(end * 10**9)
print(time.process_time() - began)
"""
_SWEEP = """
design: latin_hypercube
points: 400
repeat: 10
duration: 0.2
swept:
  weight_on_bit: {minimum: 5.0, maximum: 20.0}
"""


def _processor(used: Used) -> float:
    return used.processor


@dataclass(frozen=True)
class Work:
    """Something that both versions do.

    Attributes:
        command: its words from the folder of the inputs and an empty one for what it writes.
        value: its time from what the command used [s].
    """

    command: Callable[[Path, Path], Command]
    value: Callable[[Used], float] = _processor


WORKS: Mapping[str, Work] = {
    "engine": Work(
        lambda given, out: ["python", "-c", _ENGINE], lambda used: float(used.output.split()[-1])
    ),
    "simulate": Work(
        lambda given, out: ["rpud", "simulate", "--regime", "drilling", "--duration", "300"]
    ),
    "simulate --bag": Work(
        lambda given, out: (
            ["rpud", "simulate", "--regime", "drilling", "--duration", "20", "--bag", out / "bag"]
        )
    ),
    "verify": Work(lambda given, out: ["rpud", "verify", given / "bag"]),
    "export": Work(lambda given, out: ["rpud", "export", given / "bag", "--out", out / "tables"]),
    "report": Work(lambda given, out: ["rpud", "report", given / "bag", "--out", out / "r.html"]),
    "info": Work(lambda given, out: ["rpud", "info", given / "bag"]),
    "sweep": Work(lambda given, out: ["rpud", "sweep", given / "sweep.yaml", "--out", out / "s"]),
}


def make_inputs(version: Checkout, folder: Path) -> None:
    """Write what the works read; the earlier version writes it, as a later one can read it."""
    (folder / "sweep.yaml").write_text(_SWEEP)
    version.run(
        [
            *("rpud", "simulate", "--regime", "drilling", "--duration", "20"),
            *("--bag", folder / "bag"),
        ]
    )


def compare(base: str, names: Sequence[str], pairs: int) -> list[Ratio]:
    """Return the times of the work tree over those of a commit.

    Args:
        base: the commit.
        names: of works; none for all.
        pairs: times that both versions do each work.

    Raises:
        CheckoutError: if this clone lacks the commit, or one of both does not run.
    """
    works = {name: WORKS[name] for name in names or WORKS}
    with (
        checkout(base) as former,
        work_tree() as ours,
        tempfile.TemporaryDirectory() as folder,
    ):
        make_inputs(former, Path(folder))
        return by_turns(former, ours, works, Path(folder), pairs)


def by_turns(
    former: Checkout, ours: Checkout, works: Mapping[str, Work], given: Path, pairs: int
) -> list[Ratio]:
    """Return the ratios of works that two versions do in the order A B B A ...

    Args:
        former: the first version.
        ours: the other one; a ratio is its time over that of the first.
        works: by their names.
        given: folder of the inputs.
        pairs: times that both do each work, after each did it once to warm up.
    """
    times: dict[str, list[tuple[float, float]]] = {}
    reasons: dict[str, str] = {}
    for turn in range(-1, pairs):
        for name, work in works.items():
            if name in reasons:
                continue
            order = (0, 1) if turn % 2 == 0 else (1, 0)
            try:
                took = {each: _time((former, ours)[each], work, given) for each in order}
            except (CheckoutError, ValueError, IndexError) as error:
                reasons[name] = str(error)
                times.pop(name, None)
                continue
            if turn >= 0:
                times.setdefault(name, []).append((took[0], took[1]))
        print(f"turn {turn + 1} of {pairs} is done", file=sys.stderr, flush=True)
    return judge(times, reasons)


def _time(version: Checkout, work: Work, given: Path) -> float:
    out = Path(tempfile.mkdtemp(dir=given))
    try:
        return work.value(version.run(work.command(given, out)))
    finally:
        shutil.rmtree(out, ignore_errors=True)


def rows(ratios: Sequence[Ratio]) -> Iterator[Row]:
    """Yield the rows of the table, each with the ratio and both ends of its interval."""
    for ratio in ratios:
        if ratio.verdict != INCOMPARABLE:
            yield row(
                f"{ratio.name}: time over that of the base", [ratio.value, ratio.low, ratio.high]
            )
