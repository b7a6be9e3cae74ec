"""Measures: figures of a run, or of recorded data, over windows of time."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from rpud_sim.foundation.quantities import ParameterError
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.contact import single_contact
from rpud_sim.model.engine import Buffers
from rpud_sim.model.segment import IMPACT, join_records
from rpud_sim.simulation.block import Block
from rpud_sim.simulation.configuration import Configuration
from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import FIGURES, Statistics

SAMPLE_RATE = 5000  # for the greatest displacements; these motions are slower than 100 Hz [Hz]
_TORQUE_INTERVAL = SECOND // 100  # between samples of the torque [ns]

_BUFFERS = Buffers()

# Values of single impacts, with the field of their record and unit, for a statistic over them.
IMPACT_VALUES = {
    "peak_force": ("peak_force", "N"),
    "contact_duration": ("contact_duration", "s"),
    "impact_velocity": ("impact_velocity", "m/s"),
    "impact_energy": ("energy", "J"),
    "impulse": ("impulse", "N s"),
}
# Figures of one collision in the rock, for which nothing is simulated.
CONTACT_FIGURES = {
    "contact_peak_force": ("peak_force", "N"),
    "contact_peak_displacement": ("peak_displacement", "m"),
}
# Greatest displacements in a window, which are sampled, with their channels.
_CHANNELS = {
    "nodal_plane_displacement": "nodal_plane_position",
    "drill_tool_displacement": "drill_tool_displacement",
}
# Figures of rock, rotor and actuator, as topics name them: means over a window.
DRILLING_FIGURES = {
    "penetration_rate": "m/s",
    "torque": "N m",  # of rock and cuttings against the rotation
    "electrical_power": "W",
    "actuator_power": "W",  # work of the vibration on the free mass
}
# Figures that may be negative.
SIGNED = ("energy_transferred_rate", "energy_absorbed_rate", "reacting_force_mean")
# Those of ``rpud simulate`` over a window, and all others.
UNITS: Mapping[str, str] = {
    **FIGURES,
    "kinetic_energy": "J",
    **dict.fromkeys(_CHANNELS, "m"),
    **DRILLING_FIGURES,
    **{name: unit for name, (_, unit) in (IMPACT_VALUES | CONTACT_FIGURES).items()},
}


@dataclasses.dataclass(frozen=True)
class Measure:
    """Figure of a run."""

    figure: str  # of ``UNITS``
    start: float  # of its window, simulation time [s]
    end: float  # of its window [s]
    quantile: float | None = None  # of values of impacts, from 0 to 1; None for their mean
    impact_velocity: float = 5.0  # of the free mass, for a figure of one collision [m/s]

    @property
    def unit(self) -> str:
        return UNITS[self.figure]

    @property
    def simulated(self) -> bool:
        return self.figure not in CONTACT_FIGURES

    def __str__(self) -> str:
        if not self.simulated:
            return f"{self.figure} at {self.impact_velocity:g} m/s"
        statistic = ", mean" if self.figure in IMPACT_VALUES else ""
        if self.quantile is not None:
            statistic = f", {100.0 * self.quantile:g} % quantile"
        return f"{self.figure}{statistic}, {self.start:g} to {self.end:g} s"


def missing_model(configuration: Configuration, figure: str) -> str:
    """Return the parameter that a drill must set to have a figure; empty if it has it."""
    rock = configuration.rock.rock_model != "none" or bool(configuration.strata.strata)
    needs = {
        "penetration_rate": (rock, "rock_model or strata"),
        "torque": (configuration.rotation.rotation_model != "none", "rotation_model"),
        "electrical_power": (
            configuration.actuator.actuator_model == "resonance",
            "actuator_model: resonance",
        ),
    }
    has, parameter = needs.get(figure, (True, ""))
    return "" if has else parameter


def measure(configuration: Configuration, phase: float, measures: Sequence[Measure]) -> list[float]:
    """Return the measures of a run from an initial phase [cycles]; NaN where it has no figure."""
    windows = {_span(item): _Window() for item in measures if item.simulated}
    if windows:
        _simulate(configuration, phase, windows, {item.figure for item in measures})
    return [
        _figure(windows[_span(item)], item) if item.simulated else _contact(configuration, item)
        for item in measures
    ]


def _span(item: Measure) -> tuple[int, int]:
    """Return start and end of a measure's window [ns]."""
    return round(item.start * SECOND), round(item.end * SECOND)


def _contact(configuration: Configuration, item: Measure) -> float:
    contact = single_contact(configuration.parameters, item.impact_velocity)
    return float(getattr(contact, CONTACT_FIGURES[item.figure][0]))


class _Window:
    """What a run gives between two times."""

    def __init__(self) -> None:
        self.statistics = Statistics()
        self.impacts: list[np.ndarray] = []
        self.deeper = 0.0  # by which the hole gets deeper [m]; NaN without rock
        self.blocks: list[Block] = []

    def values(self, field: str) -> np.ndarray:
        return np.concatenate([impacts[field] for impacts in self.impacts])


def _simulate(
    configuration: Configuration,
    phase: float,
    windows: Mapping[tuple[int, int], _Window],
    figures: set[str],
) -> None:
    """Fill windows with a run, which is advanced from one of their edges to the next."""
    # Blocks of motion are kept only if something of it is sampled.
    buffers = _BUFFERS if figures.isdisjoint(_CHANNELS) else None
    run = Simulation(configuration, phase, buffers=buffers)
    turns = "torque" in figures and configuration.rotation.rotation_model != "none"
    for start, end in itertools.pairwise(sorted({0, *itertools.chain(*windows)})):
        inside = [own for (first, last), own in windows.items() if first <= start and end <= last]
        between = range(start + _TORQUE_INTERVAL, end, _TORQUE_INTERVAL) if turns else ()
        for time in (*between, end):
            depth, block = run.depth, run.advance_to(time)
            impacts = join_records([block.impacts], IMPACT)
            for window in inside:
                window.statistics.add(block)
                window.impacts.append(impacts)
                window.deeper += run.depth - depth
                window.blocks.append(block)


def _figure(window: _Window, item: Measure) -> float:
    start, end = _span(item)
    duration = (end - start) / SECOND
    if item.figure in IMPACT_VALUES:
        return impact_statistic(window.values(IMPACT_VALUES[item.figure][0]), item)
    if item.figure in _CHANNELS:
        return max(_greatest(block, _CHANNELS[item.figure]) for block in window.blocks)
    match item.figure:
        case "kinetic_energy":
            return float(window.values("energy").sum())
        case "penetration_rate":
            return window.deeper / duration
        case "torque":
            rotors = [block.process.rotation for block in window.blocks]
            torques = [rotor.torque for rotor in rotors if rotor]
            return math.fsum(torques) / len(torques) if torques else math.nan
        case "electrical_power":
            return window.statistics.account.electrical / duration
        case "actuator_power":
            return window.statistics.account.actuator_work / duration
    value = window.statistics.figures()[item.figure]
    return math.nan if value is None else float(value)


def impact_statistic(values: np.ndarray, item: Measure) -> float:
    """Return the statistic of a measure over values of impacts; NaN if there are none."""
    if not len(values):
        return math.nan
    return float(values.mean() if item.quantile is None else np.quantile(values, item.quantile))


def _greatest(block: Block, channel: str) -> float:
    numbers = block.grid(SAMPLE_RATE)
    if not numbers:
        return 0.0
    samples = block.sample(Times.from_grid(numbers.start, len(numbers), SAMPLE_RATE))
    return float(np.abs(getattr(samples, channel)).max())


# Figures of recorded data

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
    "power": {"actuator_power": "actuator_power"},
    "status": {"depth": "depth"},
}

Series = dict[str, tuple[np.ndarray, np.ndarray]]  # times [s] and values, by field


def read_data(
    path: Path, is_bag: bool, skip: float
) -> tuple[list[tuple[Measure, float, float]], int]:
    """Return figures of a file with their sampling errors, and how many runs it is long.

    These are figures of a bag, or of a CSV file, without its first ``skip`` [s]. The motion is
    chaotic, so a trajectory cannot be fitted. Figures of ten consecutive parts give the errors.
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
                    if "header.stamp" not in table:
                        continue
                    times = table["header.stamp"] / SECOND
                    for name, field in columns.items():
                        if name in table and np.isfinite(table[name]).any():
                            series.setdefault(field, (times, table[name]))
    except BagError as error:
        raise ParameterError(str(error)) from None
    return series


def _read_csv(path: Path) -> Series:
    """Return the columns of a CSV file with a heading; time in s, or stamps in ns."""
    try:
        with open(path, newline="", encoding="utf-8-sig") as file:
            heading, *rows = [row for row in csv.reader(file) if row] or [[]]
    except (OSError, ValueError, csv.Error) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ParameterError(f"{path}: {reason}") from None
    places = {name.strip(): place for place, name in enumerate(heading)}
    clock = next((name for name in _TIMES if name in places), None)
    if clock is None:
        raise ParameterError(f"{path}: has no column named {' or '.join(_TIMES)}")
    names = {name: name for name in (*_FIELDS, *_SAMPLED) if name in places}
    if not names and "force" in places:  # of an exported topic
        names = {"force": "reacting_force"}
    if not names:
        raise ParameterError(f"{path}: has no column named {', '.join((*_FIELDS, *_SAMPLED))}")

    def column(name: str) -> np.ndarray:
        found = np.full(len(rows), math.nan)
        for number, row in enumerate(rows):
            try:
                if text := row[places[name]].strip():
                    found[number] = float(text)
            except (ValueError, IndexError):
                reason = f"line {number + 2} has no number in {name}"
                raise ParameterError(f"{path}: {reason}") from None
        return found

    times = column(clock) / (SECOND if clock != "time" else 1)
    columns = {field: column(name) for name, field in names.items()}
    known = {field: np.isfinite(values) for field, values in columns.items()}
    return {name: (times[known[name]], values[known[name]]) for name, values in columns.items()}
