"""Targets from data of somebody's drill: a bag, or a CSV file.

The motion is chaotic, so a trajectory cannot be fitted. The figures of the data are the targets.
Their sampling errors, from figures of ten consecutive parts of the data, are the tolerances.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from rpud_sim.foundation.quantities import Flag, ParameterError, Quantity, did_you_mean, shown_name
from rpud_sim.foundation.time import SECOND
from rpud_sim.studies.fit.measures import IMPACT_VALUES, SIGNED, Measure, impact_statistic
from rpud_sim.studies.fit.specification import Target

PARTS = 10  # of the data, for the sampling error
LONGEST = 5.0  # of a run that is compared with the data [s]
MANY = 1_000_000_000  # runs: the tolerance has all of the data's chance
_LEAST_ERROR = 1e-3  # of the value: instruments are not better
_FEWEST = 100  # impacts, or samples of the reacting force


_ENTRIES = ("bag", "csv", "skip", "regime", "parameters", "hold_out")
_FIELDS = {field: name for name, (field, _) in IMPACT_VALUES.items()}
_QUANTILES = (0.05, 0.5, 0.95)
_TIMES = ("time", "header.stamp")

Series = dict[str, tuple[np.ndarray, np.ndarray]]  # times [s] and values, by field


def read_data(
    entry: str, content: Mapping[str, Any], own: Mapping[str, Any], folder: Path
) -> list[Target]:
    """Return the targets of an entry of ``data``.

    Args:
        entry: its name, for messages.
        content: of the entry: ``bag`` or ``csv``, ``skip``, ``hold_out``.
        own: parameters that the drill had.
        folder: at which paths begin.

    Raises:
        ParameterError: if the entry is not valid or its file has too few impacts and samples.
    """
    for name in content:
        if name not in _ENTRIES:
            raise ParameterError(
                f"{entry}.{shown_name(name)} is not an entry; {did_you_mean(name, _ENTRIES)}"
            )
    if ("bag" in content) == ("csv" in content):
        raise ParameterError(f"{entry}: needs either bag or csv, the path of a file")
    kind = "bag" if "bag" in content else "csv"
    if not isinstance(content[kind], str):
        raise ParameterError(f"{entry}.{kind}: is no path")
    skip = Quantity("s", "", 0.0, 50.0).check(f"{entry}.skip", content.get("skip", 0.5))
    hold_out = Flag("").check(f"{entry}.hold_out", content.get("hold_out", False))
    path = folder / content[kind]
    series = (_read_bag if kind == "bag" else _read_csv)(path)
    if not series:
        raise ParameterError(f"{path}: has no topic contact_force or reacting_force of a drill")
    found = _measured(series, skip)
    if not found:
        raise ParameterError(
            f"{path}: has neither {_FEWEST} impacts nor {_FEWEST} samples of the reacting force "
            f"after {skip:g} s"
        )
    for item, value, _ in found:
        if value < 0.0 and item.figure not in SIGNED:
            raise ParameterError(
                f"{path}: {item} is {value:g} {item.unit}, and the model's is never negative"
            )
    return [
        Target(item, value, error, MANY, tuple(own.items()), hold_out, content[kind], entry)
        for item, value, error in found
    ]


def _measured(series: Series, skip: float) -> list[tuple[Measure, float, float]]:
    """Return measures with their values and sampling errors."""
    clocks = [times[np.isfinite(times)] for times, _ in series.values()]
    times = np.concatenate([np.empty(0), *clocks])
    if not len(times) or not times.max() > times.min() + skip:
        return []
    start, end = float(times.min()) + skip, float(times.max())
    window = skip, skip + min(end - start, LONGEST)
    edges = np.linspace(start, end, PARTS + 1)
    found = []
    for field, (times, values) in series.items():
        kept = (times >= start) & (times < end) & np.isfinite(values)
        if np.count_nonzero(kept) < _FEWEST:
            continue
        parts = np.clip(np.searchsorted(edges, times[kept], side="right") - 1, 0, PARTS - 1)
        for item in _measures(field, *window):
            whole = _value(item, values[kept], end - start)
            pieces = [
                _value(item, values[kept][parts == part], (end - start) / PARTS)
                for part in range(PARTS)
            ]
            error = _standard_error(np.array(pieces))
            found.append((item, whole, max(error, _LEAST_ERROR * abs(whole), 1e-300)))
    return found


def _standard_error(pieces: np.ndarray) -> float:
    """Return the standard error of a mean over parts, with the spread of Student's t."""
    pieces = pieces[np.isfinite(pieces)]
    freedom = len(pieces) - 1
    if freedom < 3:
        return math.inf
    spread = float(pieces.std(ddof=1)) * math.sqrt(freedom / (freedom - 2))
    return spread / math.sqrt(len(pieces))


def _measures(field: str, start: float, end: float) -> list[Measure]:
    if field == "reacting_force":
        return [Measure("reacting_force_mean", start, end)]
    if field == "energy":
        return [Measure("kinetic_energy_rate", start, end)]
    name = _FIELDS[field]
    mean = Measure(name, start, end, "mean")
    if field != "peak_force":
        return [mean]
    quantiles = [Measure(name, start, end, "quantile", share) for share in _QUANTILES]
    return [Measure("drill_tool_impact_rate", start, end), mean, *quantiles]


def _value(item: Measure, values: np.ndarray, duration: float) -> float:
    if item.figure == "drill_tool_impact_rate":
        return len(values) / duration
    if item.figure == "kinetic_energy_rate":
        return float(values.sum()) / duration
    if item.figure == "reacting_force_mean":
        return float(values.mean()) if len(values) else math.nan
    return impact_statistic(values, item)


def _read_bag(path: Path) -> Series:
    """Return impacts and reacting force of the topics of a drill in a bag."""
    from rpud_sim.bag import BagError, open  # slow to load

    fields = {"contact_force": tuple(_FIELDS), "reacting_force": ("force",)}
    series: Series = {}
    try:
        with open(path) as bag:
            for topic in (summary.topic.name for summary in bag.readable_topics):
                columns = fields.get(topic.rpartition("/")[2])
                if columns is None:
                    continue
                table = bag.arrays(topic)
                if not all(name in table for name in ("header.stamp", *columns)):
                    continue
                times = table["header.stamp"] / SECOND
                for name in columns:
                    series["reacting_force" if name == "force" else name] = times, table[name]
    except BagError as error:
        raise ParameterError(str(error)) from None
    return series


def _read_csv(path: Path) -> Series:
    """Return the columns of a CSV file with a heading; time in s, or stamps in ns."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            rows = csv.reader(file)
            heading = [name.strip() for name in next(rows, [])]
            content = [row for row in rows if row]
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(f"{path}: {reason}") from None
    clock = next((name for name in _TIMES if name in heading), None)
    if clock is None:
        raise ParameterError(f"{path}: has no column named {' or '.join(_TIMES)}")
    names = {name: name for name in (*_FIELDS, "reacting_force") if name in heading}
    if not names and "force" in heading:  # of an exported topic
        names = {"force": "reacting_force"}
    if not names:
        raise ParameterError(f"{path}: has no column named {', '.join(_FIELDS)} or reacting_force")
    times = _column(path, heading, content, clock) / (SECOND if clock != "time" else 1)
    return {
        field: (times[keep := np.isfinite(values)], values[keep])
        for name, field in names.items()
        if (values := _column(path, heading, content, name)) is not None
    }


def _column(path: Path, heading: list[str], rows: list[list[str]], name: str) -> np.ndarray:
    """Return a column; empty cells are NaN."""
    place = heading.index(name)
    try:
        return np.array([float(row[place]) if row[place].strip() else math.nan for row in rows])
    except (ValueError, IndexError):
        for number, row in enumerate(rows, 2):
            try:
                float(row[place] or 0.0)
            except (ValueError, IndexError):
                raise ParameterError(f"{path}: line {number} has no number in {name}") from None
        raise ParameterError(f"{path}: {name} holds no numbers") from None
