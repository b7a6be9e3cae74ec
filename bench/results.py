"""Results of the bench, kept in files with machine and commit."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from bench.checkout import ROOT
from bench.row import Goal, Row

KEPT = ROOT / "build/bench/results"
"""Folder of the results of every run, outside of git."""


@dataclass(frozen=True)
class Part:
    """Result of one measurement.

    Attributes:
        measurement: its name.
        began: when, in UTC by ISO 8601.
        commit: hash of the sources; empty where there is no git.
        changed: whether files differed from that commit.
        machine: processor, cores, memory, versions.
        load: average load of the machine before and after.
        seconds: how long it took.
        rows: its figures.
        failure: why it ended early; empty if it did not.
        stolen: share of the processor time that other virtual machines took [%]; None if it was
            not measured.
    """

    measurement: str
    began: str
    commit: str
    changed: bool
    machine: dict[str, str]
    load: tuple[float, float]
    seconds: float
    rows: tuple[Row, ...]
    failure: str = ""
    stolen: float | None = None


def write_parts(file: Path, parts: Sequence[Part]) -> None:
    """Write parts as JSON: a failure in the middle leaves the former file."""
    content = [asdict(part) | {"rows": [_to_json(row) for row in part.rows]} for part in parts]
    file.parent.mkdir(parents=True, exist_ok=True)
    written = file.with_suffix(".part")
    written.write_text(_laid_out({"parts": content}), encoding="utf-8")
    written.replace(file)


def read_parts(file: Path) -> list[Part]:
    """Return the parts of a file.

    Raises:
        ValueError: if it is not such a file.
    """
    try:
        return [
            Part(
                **each | {"rows": tuple(map(_from_json, each["rows"])), "load": tuple(each["load"])}
            )
            for each in json.loads(file.read_text(encoding="utf-8"))["parts"]
        ]
    except (KeyError, TypeError, ValueError) as error:
        raise ValueError(f"{file} does not hold results of the bench: {error}") from None


def newest_parts(folder: Path) -> list[Part]:
    """Return the newest whole result of each measurement in a folder of results, by their names.

    Ratios are taken within a measurement, so that measurements may come from several runs.
    """
    found: dict[str, Part] = {}
    for file in folder.glob("*.json"):
        for part in read_parts(file):
            former = found.get(part.measurement)
            if not part.failure and (former is None or former.began < part.began):
                found[part.measurement] = part
    return [found[name] for name in sorted(found)]


def rows_of(parts: Iterable[Part]) -> list[Row]:
    """Return the rows of all parts."""
    return [row for part in parts for row in part.rows]


def heading(parts: Sequence[Part]) -> Iterator[str]:
    """Yield lines that say on what machine and of which commits the results are."""
    for machine in dict.fromkeys(tuple(part.machine.items()) for part in parts):
        named = dict(machine)
        words = [named.pop("processor"), f"{named.pop('cores')} cores", named.pop("memory")]
        others = [f"{name} {version}" for name, version in named.items() if name != "system"]
        yield f"Measured on {', '.join([*words, named['system'], *others])}."
    commits = dict.fromkeys(
        f"{part.commit[:7] or 'unknown'}{' with changes' if part.changed else ''}" for part in parts
    )
    yield f"Commit: {', '.join(commits)}."
    loads = [each for part in parts for each in part.load]
    yield f"Load of the machine: {min(loads):.1f} to {max(loads):.1f}."
    stolen = [part.stolen for part in parts if part.stolen is not None]
    if stolen:
        yield (
            "Other virtual machines took "
            f"{min(stolen):.1f} to {max(stolen):.1f} % of the processor time of a measurement."
        )


def table(rows: Sequence[Row]) -> Iterator[str]:
    """Yield the lines of a Markdown table with each figure beside its goal."""
    yield "| figure | median | spread | unit | goal | met |"
    yield "|---|---|---|---|---|---|"
    for row in rows:
        met = "" if row.goal is None else "**no**" if row.missed else "yes"
        goal = "" if row.goal is None else str(row.goal)
        yield (
            f"| {row.name} | {number(row.median)} | {spread(row)} | {row.unit} | {goal} | {met} |"
        )


def summary(parts: Sequence[Part]) -> Iterator[str]:
    """Yield lines that say which goals are missed and which measurements failed."""
    rows = [row for row in rows_of(parts) if row.goal is not None]
    missed = [row for row in rows if row.missed]
    if rows:
        yield f"{len(rows) - len(missed)} of {len(rows)} goals are met."
    for row in missed:
        median = f"{number(row.median)} {row.unit}".rstrip()
        yield f"missed: {row.name}: {median}, goal {row.goal}"
    for part in parts:
        if part.failure:
            yield f"failed: {part.measurement}: {part.failure}"


def number(value: float) -> str:
    """Return a number with three digits, such as ``0.0612``, ``12.3`` or ``31,200``."""
    if not math.isfinite(value) or value == 0.0:
        return f"{value:g}"
    digits = 2 - math.floor(math.log10(abs(value)))
    rounded = round(value, digits)
    if 1e-4 <= abs(rounded) < 1e7:
        return f"{rounded:,.{max(0, 2 - math.floor(math.log10(abs(rounded))))}f}"
    return f"{value:.3g}"


def spread(row: Row) -> str:
    """Return the least and greatest value of a figure; empty for a single one."""
    if len(row.values) == 1:
        return ""
    return f"{number(row.least)} to {number(row.greatest)}"


def _to_json(row: Row) -> dict[str, object]:
    values = [float(f"{value:.6g}") if math.isfinite(value) else None for value in row.values]
    goal = None if row.goal is None else row.goal._asdict()
    return {"name": row.name, "values": values, "unit": row.unit, "goal": goal}


def _from_json(content: dict[str, object]) -> Row:
    values = content["values"]
    goal = content["goal"]
    assert isinstance(values, list)
    return Row(
        str(content["name"]),
        tuple(math.nan if value is None else float(value) for value in values),
        str(content["unit"]),
        None if goal is None else Goal(**goal),  # type: ignore[arg-type]
    )


def _laid_out(content: dict[str, list[dict[str, object]]]) -> str:
    """Return JSON with a row on a line, so that changes of a kept file can be read."""
    lines = []
    for part in content["parts"]:
        head = json.dumps({name: value for name, value in part.items() if name != "rows"})
        rows = ",\n".join(f"    {json.dumps(row)}" for row in part["rows"])  # type: ignore[attr-defined]
        lines.append(f'  {head[:-1]}, "rows": [\n{rows}\n  ]}}')
    return '{"parts": [\n' + ",\n".join(lines) + "\n]}\n"
