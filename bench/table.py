"""Rows of a table: what was measured in turns, beside its goal; and the machine."""

from __future__ import annotations

import math
import os
import platform
import statistics
import subprocess
from collections.abc import Iterable, Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]


class Row(NamedTuple):
    """One measured quantity."""

    name: str
    values: tuple[float, ...]  # of each turn, in their order; at least one
    unit: str = ""  # empty for a ratio or a number
    least: float | None = None  # goals for the median; None for none
    most: float | None = None

    @property
    def median(self) -> float:
        """Median of the values."""
        return statistics.median(self.values)

    @property
    def goal(self) -> str:
        """The goal, such as ``>= 3``."""
        bounds = ((">=", self.least), ("<=", self.most))
        return " and ".join(f"{sign} {bound:g}" for sign, bound in bounds if bound is not None)

    @property
    def missed(self) -> bool:
        """Whether there is a goal that is not shown to be met; NaN meets none."""
        above = self.least is None or self.median >= self.least
        below = self.most is None or self.median <= self.most
        return not (above and below)

    def __str__(self) -> str:
        """Return the row in one line."""
        return f"{self.name}: {number(self.median)} {self.unit}".rstrip()


def row(
    name: str,
    values: float | Sequence[float],
    unit: str = "",
    *,
    least: float | None = None,
    most: float | None = None,
) -> Row:
    """Return the row of a quantity from the values of its turns, or from the only one."""
    turns = values if isinstance(values, Sequence) else [values]
    return Row(name, tuple(map(float, turns)), unit, least, most)


def table(rows: Iterable[Row]) -> Iterator[str]:
    """Yield the lines of a Markdown table with each row beside its goal."""
    yield "| what | median | spread | unit | goal | met |"
    yield "|---|---|---|---|---|---|"
    for each in rows:
        met = ("**no**" if each.missed else "yes") if each.goal else ""
        low, high = number(min(each.values)), number(max(each.values))
        spread = f"{low} to {high}" if len(each.values) > 1 else ""
        cells = (each.name, number(each.median), spread, each.unit, each.goal, met)
        yield f"| {' | '.join(cells)} |"


def number(value: float) -> str:
    """Return a number with three digits, such as ``0.0612``, ``12.3`` or ``31,200``."""
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}"
    rounded = float(f"{value:.3g}")
    if 1e-4 <= abs(rounded) < 1e7:
        return f"{rounded:,.{max(0, 2 - math.floor(math.log10(abs(rounded))))}f}"
    return f"{value:.3g}"


def machine() -> str:
    """Return in one line the machine, the versions, and the commit."""
    lines = Path("/proc/cpuinfo").read_text(errors="replace").splitlines()
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    words = ("git", "-C", str(ROOT), "describe", "--always", "--exclude=*", "--dirty= with changes")
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    versions = [f"{name} {metadata.version(name)}" for name in ("numpy", "numba", "mcap")]
    return (
        f"Measured on {next(names, platform.machine())}, {len(os.sched_getaffinity(0))} cores, "
        f"Linux {platform.release().partition('-')[0]}, Python {platform.python_version()}, "
        f"{', '.join(versions)}; commit {done.stdout.strip() or 'unknown'}."
    )


def used_by(process: int) -> float:
    """Return the time of processors that a process, given by its id, has used so far [s]."""
    fields = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
