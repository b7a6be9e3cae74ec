"""Targets from data of somebody's drill: a bag, or a CSV file.

The motion is chaotic, so a trajectory cannot be fitted. The figures of the data are the targets.
Their sampling errors, from figures of ten consecutive parts of the data, are the tolerances.
"""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.studies.fit.measures import IMPACT_VALUES, SIGNED, Measure, impact_statistic

PARTS = 10  # of the data, for the sampling error
LONGEST = 5.0  # of a run that is compared with the data [s]
_FEWEST_IMPACTS, _FEWEST_SAMPLES = 100, 20
_FIELDS = {field: name for name, (field, _) in IMPACT_VALUES.items()}
_QUANTILES = (0.05, 0.5, 0.95)
_TIMES = ("time", "header.stamp")
# Figures of what is sampled: means of the samples, or rates at which a sum grows.
_MEANS = {
    "reacting_force": "reacting_force_mean",
    "torque": "torque",
    "actuator_power": "actuator_power",
}
_SUMS = {"depth": "penetration_rate", "electrical_energy": "electrical_power"}
_SAMPLED = _MEANS | _SUMS
# Fields of a bag's topics; a topic that comes first goes before another with the same field.
_TOPICS = {
    "contact_force": {name: name for name in _FIELDS},
    "reacting_force": {"force": "reacting_force"},
    "rotation": {"torque": "torque"},
    "borehole": {"depth": "depth"},
    "actuator_state": {"electrical_energy": "electrical_energy"},
    "status": {"depth": "depth", "actuator_power": "actuator_power"},
}

Series = dict[str, tuple[np.ndarray, np.ndarray]]  # times [s] and values, by field


def read_data(
    path: Path, is_bag: bool, skip: float
) -> tuple[list[tuple[Measure, float, float]], int]:
    """Return figures of a file, without its first ``skip`` [s], with their sampling errors.

    The number is how many runs the file is long.
    """
    series = (_read_bag if is_bag else _read_csv)(path)
    if not series:
        raise ParameterError(f"{path}: has none of a drill's topics {', '.join(_TOPICS)}")
    found, runs = _measured(series, skip)
    if not found:
        raise ParameterError(
            f"{path}: has neither {_FEWEST_IMPACTS} impacts nor {_FEWEST_SAMPLES} samples "
            f"after {skip:g} s"
        )
    for item, value, _ in found:
        if value < 0.0 and item.figure not in SIGNED:
            raise ParameterError(
                f"{path}: {item} is {value:g} {item.unit}, and the model's is never negative"
            )
    return found, runs


def _measured(series: Series, skip: float) -> tuple[list[tuple[Measure, float, float]], int]:
    """Return measures with values and sampling errors, and how many runs the data is long."""
    clocks = [times[np.isfinite(times)] for times, _ in series.values()]
    times = np.concatenate([np.empty(0), *clocks])
    if not len(times) or not times.max() > times.min() + skip:
        return [], 1
    start, end = float(times.min()) + skip, float(times.max())
    window = skip, skip + min(end - start, LONGEST)
    edges = np.linspace(start, end, PARTS + 1)
    found = []
    for field, (times, values) in series.items():
        kept = (times >= start) & (times < end) & np.isfinite(values)
        fewest = _FEWEST_SAMPLES if field in _SAMPLED else _FEWEST_IMPACTS
        if np.count_nonzero(kept) < fewest:
            continue
        times, values = times[kept], values[kept]
        parts = np.clip(np.searchsorted(edges, times, side="right") - 1, 0, PARTS - 1)
        for item in _measures(field, *window):
            if field in _SUMS:
                whole, pieces = _growth(times, values, edges)
            else:
                whole = _value(item, values, end - start)
                lasting = (end - start) / PARTS
                pieces = [_value(item, values[parts == part], lasting) for part in range(PARTS)]
            error = _standard_error(np.array(pieces))
            if math.isfinite(error):
                found.append((item, whole, error))
    return found, max(1, int((end - start) / LONGEST))


def _growth(times: np.ndarray, values: np.ndarray, edges: np.ndarray) -> tuple[float, list[float]]:
    """Return the rate at which a sum grows, over all times and between edges."""
    at = np.interp(edges, times, values)
    whole = (values[-1] - values[0]) / (times[-1] - times[0])
    return float(whole), (np.diff(at) / np.diff(edges)).tolist()


def _standard_error(pieces: np.ndarray) -> float:
    """Return the standard error of a mean over parts, with the spread of Student's t."""
    pieces = pieces[np.isfinite(pieces)]
    freedom = len(pieces) - 1
    if freedom < 3:
        return math.inf
    spread = float(pieces.std(ddof=1)) * math.sqrt(freedom / (freedom - 2))
    return spread / math.sqrt(len(pieces))


def _measures(field: str, start: float, end: float) -> list[Measure]:
    if field in _SAMPLED:
        return [Measure(_SAMPLED[field], start, end)]
    name = _FIELDS[field]
    mean = Measure(name, start, end)
    if field == "energy":
        return [Measure("kinetic_energy_rate", start, end)]
    if field != "peak_force":
        return [mean]
    quantiles = [Measure(name, start, end, share) for share in _QUANTILES]
    return [Measure("drill_tool_impact_rate", start, end), mean, *quantiles]


def _value(item: Measure, values: np.ndarray, duration: float) -> float:
    if item.figure == "drill_tool_impact_rate":
        return len(values) / duration
    if item.figure == "kinetic_energy_rate":
        return float(values.sum()) / duration
    if item.figure in _MEANS.values():
        return float(values.mean()) if len(values) else math.nan
    return impact_statistic(values, item)


def _read_bag(path: Path) -> Series:
    from rpud_sim.bag import BagError, open  # slow to load

    series: Series = {}
    try:
        with open(path) as bag:
            topics = [summary.topic.name for summary in bag.readable_topics]
            for kind, columns in _TOPICS.items():
                for topic in (name for name in topics if name.rpartition("/")[2] == kind):
                    table = bag.arrays(topic)
                    if not all(name in table for name in ("header.stamp", *columns)):
                        continue
                    times = table["header.stamp"] / SECOND
                    for name, field in columns.items():
                        if np.isfinite(table[name]).any():
                            series.setdefault(field, (times, table[name]))
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
    names = {name: name for name in (*_FIELDS, *_SAMPLED) if name in heading}
    if not names and "force" in heading:  # of an exported topic
        names = {"force": "reacting_force"}
    if not names:
        raise ParameterError(f"{path}: has no column named {', '.join((*_FIELDS, *_SAMPLED))}")
    times = _column(path, heading, content, clock) / (SECOND if clock != "time" else 1)
    return {
        field: (times[keep := np.isfinite(values)], values[keep])
        for name, field in names.items()
        if (values := _column(path, heading, content, name)) is not None
    }


def _column(path: Path, heading: list[str], rows: list[list[str]], name: str) -> np.ndarray:
    place, found = heading.index(name), np.empty(len(rows))
    for number, row in enumerate(rows):
        try:
            found[number] = float(row[place]) if row[place].strip() else math.nan
        except (ValueError, IndexError):
            raise ParameterError(f"{path}: line {number + 2} has no number in {name}") from None
    return found
