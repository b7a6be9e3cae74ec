"""Rows of figures beside their goals: as Markdown, and in files with machine and commit."""

from __future__ import annotations

import json
import math
import statistics
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple


class Goal(NamedTuple):
    """Bounds that the median of a figure should keep."""

    least: float | None = None  # None for no such bound
    most: float | None = None  # None for no such bound

    def met(self, value: float) -> bool:
        """Return whether a value keeps the bounds; NaN does not."""
        above = self.least is None or value >= self.least
        below = self.most is None or value <= self.most
        return above and below

    def __str__(self) -> str:
        """Return the bounds, such as ``>= 3``."""
        parts = [f">= {self.least:g}"] if self.least is not None else []
        parts += [f"<= {self.most:g}"] if self.most is not None else []
        return " and ".join(parts)


class Row(NamedTuple):
    """One measured figure."""

    name: str
    values: tuple[float, ...]  # of each turn, in their order; at least one
    unit: str = ""  # empty for a ratio or a number
    goal: Goal | None = None

    @property
    def median(self) -> float:
        """Median of the values."""
        return statistics.median(self.values)

    @property
    def missed(self) -> bool:
        """Whether there is a goal that is not shown to be met.

        Times, rates and ratios are never negative: a turn that says so has failed.
        """
        return self.goal is not None and (min(self.values) < 0.0 or not self.goal.met(self.median))

    def __str__(self) -> str:
        """Return the row in one line."""
        return f"{self.name}: {number(self.median)} {self.unit}".rstrip()


def row(name: str, values: Sequence[float], unit: str = "", goal: Goal | None = None) -> Row:
    """Return the row of a figure from the values of its turns."""
    return Row(name, tuple(map(float, values)), unit, goal)


@dataclass(frozen=True)
class Part:
    """Result of one measurement."""

    measurement: str  # its name
    began: str  # when, in UTC by ISO 8601
    commit: str  # short hash, with "with changes" if files differed from it
    machine: dict[str, str]  # processor, cores, memory, versions
    stolen: float  # share of the processor time that other virtual machines took [%]
    rows: tuple[Row, ...]
    failure: str = ""  # why it ended early; empty if it did not


def write_parts(file: Path, parts: Sequence[Part]) -> None:
    """Write parts as JSON with a row on a line, so that changes of the file can be read."""
    texts = []
    for part in parts:
        head = json.dumps({name: value for name, value in asdict(part).items() if name != "rows"})
        rows = ",\n".join(f"    {json.dumps(_to_json(each))}" for each in part.rows)
        texts.append(f'  {head[:-1]}, "rows": [\n{rows}\n  ]}}')
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text('{"parts": [\n' + ",\n".join(texts) + "\n]}\n", encoding="utf-8")


def read_parts(file: Path) -> list[Part]:
    """Return the parts of a file."""
    return [
        Part(**part | {"rows": tuple(map(_from_json, part["rows"]))})
        for part in json.loads(file.read_text(encoding="utf-8"))["parts"]
    ]


def rows_of(parts: Iterable[Part]) -> list[Row]:
    """Return the rows of all parts."""
    return [each for part in parts for each in part.rows]


def heading(parts: Sequence[Part]) -> Iterator[str]:
    """Yield lines that say on what machine and of which commits the results are."""
    for machine in dict.fromkeys(tuple(part.machine.items()) for part in parts):
        yield f"Measured on {', '.join(f'{name} {value}' for name, value in machine)}."
    yield f"Commit: {', '.join(dict.fromkeys(part.commit for part in parts))}."
    stolen = [part.stolen for part in parts]
    yield (
        "Other virtual machines took "
        f"{min(stolen):.1f} to {max(stolen):.1f} % of the processor time of a measurement."
    )


def table(rows: Iterable[Row]) -> Iterator[str]:
    """Yield the lines of a Markdown table with each figure beside its goal."""
    yield "| figure | median | spread | unit | goal | met |"
    yield "|---|---|---|---|---|---|"
    for each in rows:
        met = "" if each.goal is None else "**no**" if each.missed else "yes"
        low, high = number(min(each.values)), number(max(each.values))
        spread = f"{low} to {high}" if len(each.values) > 1 else ""
        cells = (each.name, number(each.median), spread, each.unit, str(each.goal or ""), met)
        yield f"| {' | '.join(cells)} |"


def number(value: float) -> str:
    """Return a number with three digits, such as ``0.0612``, ``12.3`` or ``31,200``."""
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}"
    rounded = float(f"{value:.3g}")
    if 1e-4 <= abs(rounded) < 1e7:
        return f"{rounded:,.{max(0, 2 - math.floor(math.log10(abs(rounded))))}f}"
    return f"{value:.3g}"


def _to_json(each: Row) -> dict[str, object]:
    values = [float(f"{value:.6g}") for value in each.values]
    goal = None if each.goal is None else each.goal._asdict()
    return {"name": each.name, "values": values, "unit": each.unit, "goal": goal}


def _from_json(content: dict[str, object]) -> Row:
    values, goal = content["values"], content["goal"]
    assert isinstance(values, list)
    made = None if goal is None else Goal(**goal)  # type: ignore[arg-type]
    return row(str(content["name"]), values, str(content["unit"]), made)
