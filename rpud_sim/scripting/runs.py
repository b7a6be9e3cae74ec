"""Runs in scripts: metrics, columns of topics, waveforms and plots, simulated or recorded."""

from __future__ import annotations

import dataclasses
import os
import warnings
from base64 import b64encode
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property
from html import escape
from io import BytesIO
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from rpud_sim.bag import BagReader, Column, Kind
from rpud_sim.bag.tables import to_frame
from rpud_sim.foundation.options import POSITIVE_SECONDS, SECONDS
from rpud_sim.foundation.quantities import ParameterError, Quantity, did_you_mean, short_repr
from rpud_sim.foundation.shown_quantities import METRIC_UNITS
from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.yaml_files import yaml_node
from rpud_sim.messages.columns import RECEIVED
from rpud_sim.model.segment import SEGMENT, join_records
from rpud_sim.recorded.drill_tables import drill_table, rows_of
from rpud_sim.recorded.growing_run import GrowingRun
from rpud_sim.recorded.offline_bag import kept_topics, run_batches, write_offline_bag
from rpud_sim.recorded.rebuild import CHANNEL_UNITS
from rpud_sim.scripting.plots import plot_run
from rpud_sim.simulation.block import Block, first_sample
from rpud_sim.simulation.changes import Change
from rpud_sim.simulation.configuration import read_parameter_file, to_settings
from rpud_sim.simulation.ensemble import compile_kernels
from rpud_sim.simulation.metrics import Metrics
from rpud_sim.simulation.plan import Beginning, Plan
from rpud_sim.simulation.run import Run
from rpud_sim.simulation.sampling import CHANNELS, Times, sample
from rpud_sim.simulation.scenario_file import read_commands, read_scenario, scenario_at
from rpud_sim.simulation.topics import TOPICS
from rpud_sim.simulation.unused_parameters import doubts

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

    from rpud_sim.recorded.runs import RecordedRun

Faults = str | os.PathLike[str] | Mapping[str, Any] | Sequence[str | Mapping[str, Any]]

_RATE = Quantity("Hz", "rate of samples", 1, 1e7, whole=True)
_CLOSE, _CLOSE_RATE = 0.002, 500_000  # close look of a plot: its length [s], its samples [Hz]
_TIMES = (Kind.TIME, Kind.DURATION)
# Topics with messages that a run has only at its end.
_AT_END = ("waveform", "trajectory", "power", "status", "journal")


class _UnknownNameError(KeyError):
    """Name of nothing that is there; as a text it has no quotes and escapes."""

    def __str__(self) -> str:
        return str(self.args[0])


class _Figures(dict[str, Any]):
    """Values of a run by their names."""

    def __missing__(self, name: str) -> Any:
        raise _UnknownNameError(f"no metric {name!r}{did_you_mean(str(name), self)}")


class Columns(dict[str, np.ndarray]):
    """Columns of a table by their names, as read-only arrays; ``units`` has their SI units."""

    def __init__(self, values: Mapping[str, np.ndarray], units: Mapping[str, str]) -> None:
        super().__init__(values)
        for column in values.values():
            column.setflags(write=False)  # they are kept, and a change would change the run
        self.units = dict(units)  # empty for a number without a unit

    def __missing__(self, name: str) -> np.ndarray:
        raise _UnknownNameError(f"no column {name!r}{did_you_mean(str(name), self)}")

    def __repr__(self) -> str:
        """Return the columns' names and units, and the number of rows."""
        named = [f"{n} [{unit}]" if (unit := self.units.get(n)) else n for n in self]
        return f"<Columns of {len(next(iter(self.values()), ()))} rows: {', '.join(named)}>"


def simulate(
    duration: float,
    *,
    config: str | os.PathLike[str] | None = None,
    seed: int | None = None,
    faults: Faults | None = None,
    commands: str | os.PathLike[str] | None = None,
    **parameters: Any,
) -> DrillRun:
    """Simulate the drill for a duration [s] and return the run.

    Args:
        config: ROS parameter file.
        seed: of initial phase, scenario and noise; None for the file's seed, or for phase zero.
        faults: a scenario file, kinds, or entries as a scenario file has them.
        commands: file of commands and faults at their times, as of ``rpud fork``.
        parameters: by their names, as ``weight_on_bit=20.0``; they go before the file's.

    Raises:
        ParameterError: for a name or a value that cannot be used.
    """
    length = POSITIVE_SECONDS.check("duration", duration)
    beginning = beginning_of(parameters, config, seed, faults)
    planned = read_commands(_path("commands", commands)).changes if commands is not None else ()
    end = round(length * SECOND)
    return DrillRun(Plan(beginning, tuple(each for each in planned if each.time < end)), end)


def beginning_of(
    parameters: Mapping[str, Any],
    config: str | os.PathLike[str] | None,
    seed: int | None,
    faults: Faults | None,
) -> Beginning:
    """Return the beginning of a run; arguments are as in ``simulate``."""
    values = read_parameter_file(_path("config", config)) if config is not None else {}
    values.update(parameters)
    if faults is not None:
        values["scenario"] = ""  # they replace it
    beginning = Beginning.drawn(to_settings(values), seed)
    for line in doubts(parameters, beginning.settings):
        warnings.warn(line, stacklevel=3)
    if faults is None:
        return beginning
    injected = _changes(faults, beginning.settings.seed_or_none)
    return dataclasses.replace(beginning, faults=injected)


def _changes(faults: Faults, seed: int | None) -> tuple[Change, ...]:
    if isinstance(faults, os.PathLike) or (isinstance(faults, str) and Path(faults).suffix):
        return read_scenario(os.fspath(faults), seed)
    entries: Any = [faults] if isinstance(faults, str | Mapping) else faults
    if isinstance(entries, Iterable):
        entries = [{"kind": e, "onset": 0.0} if isinstance(e, str) else e for e in entries]
    return scenario_at(yaml_node({"faults": entries}, "faults"), seed)


def _path(name: str, value: Any) -> Path:
    try:
        return Path(value)
    except TypeError:
        raise ParameterError(f"{name} = {short_repr(value)} is not the path of a file") from None


class GrowingColumns:
    """Columns of the topics of a run that continues; a copy starts empty."""

    def __init__(self) -> None:
        self._run: GrowingRun | None = None
        self._scheduled = 1  # changes of the plan; the first one sets the origin
        self._columns: dict[str, Mapping[str, np.ndarray]] = {}  # by topic

    def columns(self, topic: str, plan: Plan, end: int) -> Mapping[str, np.ndarray] | None:
        """Return the columns of a topic of the plan's run that ends at a time [ns].

        None if a longer run begins with other messages, or the run is beyond that time.
        """
        if self._run is None:
            self._run = GrowingRun(dataclasses.replace(plan, changes=plan.changes[:1]))
        if topic in _AT_END or end < self._run.run.time:
            return None
        new = [each for each in plan.changes[self._scheduled :] if each.time < end]
        self._scheduled += len(new)
        found = self._run.new(topic)  # before it advances, so that the first topic comes from it
        self._run.advance(new, end)
        further = rows_of(topic, found + self._run.new(topic))
        known = self._columns.get(topic, further)
        if known is not further:
            further = {name: np.concatenate([known[name], further[name]]) for name in known}
        self._columns[topic] = further
        return further

    def __reduce__(self) -> Any:
        return GrowingColumns, ()


class DrillRun:
    """Run of the drill: its plan, up to a time; everything else is computed when it is asked for.

    ``run["contact_force"]`` are the columns of a topic. A run that ``rpud_sim.open`` gives has them
    as they were recorded.
    """

    def __init__(
        self,
        plan: Plan,
        end: int,
        bag: BagReader | None = None,
        recorded: RecordedRun | None = None,
        growing: GrowingColumns | None = None,
    ) -> None:
        self.plan = plan
        self.duration = end / SECOND  # simulated time [s]
        self._end = end
        self._bag = bag
        self.recorded = recorded  # where it lies in a bag; None for one in memory
        self._growing = growing  # of a drill that may continue
        self._columns: dict[str, Columns] = {}  # by topic
        self._origins: dict[str, np.ndarray] = {}  # stamps of time zero of recorded rows, by topic

    @property
    def parameters(self) -> dict[str, Any]:
        """Parameters at the beginning, by name."""
        return self.plan.beginning.settings.values()

    @property
    def seed(self) -> int:
        """Seed of phase, scenario and noise."""
        return self.plan.beginning.seed

    @property
    def topics(self) -> tuple[str, ...]:
        """Names of the topics that have columns."""
        if self._bag is not None and self.recorded is not None:
            prefix = self.recorded.prefix
            held = [each.topic.name for each in self._bag.readable_topics]
            own = {name.removeprefix(prefix) for name in held if name.startswith(prefix)}
            return tuple(sorted(own & set(TOPICS)))
        return tuple(sorted(kept_topics(self.parameters)))

    @cached_property
    def metrics(self) -> dict[str, Any]:
        """Metrics of the run in SI units, named as in ``rpud simulate --json``."""
        metrics = Metrics()
        self._advance(metrics.add)
        return _Figures(metrics.to_dict())

    @property
    def figures(self) -> dict[str, Any]:
        """Old name of ``metrics``, until the next release."""
        warnings.warn("figures is now metrics", DeprecationWarning, stacklevel=2)
        return self.metrics

    def __getitem__(self, topic: str) -> Columns:
        """Return the columns of a topic; times are integer nanoseconds."""
        if topic not in self.topics:
            raise _UnknownNameError(f"no topic {topic!r}{did_you_mean(str(topic), self.topics)}")
        if topic not in self._columns:
            self._columns[topic] = self._read(topic) if self._bag else self._compute(topic)
        return self._columns[topic]

    def __iter__(self) -> Iterable[str]:  # a mapping from topics, without a length
        return iter(self.topics)

    def times(self, topic: str) -> np.ndarray:
        """Return the simulation time of each row of a topic [s]."""
        columns = self[topic]
        stamps = columns["time"] if "time" in columns else columns["header.stamp"]
        return (stamps - self._origins.get(topic, 0)) / SECOND

    def frame(self, topic: str) -> pandas.DataFrame:
        """Return a topic as a pandas frame; its index is simulation time [s].

        ``frame.attrs["units"]`` has the units.
        """
        columns = self[topic]
        kept = {n: each for n, each in columns.items() if n not in ("time", "header.stamp")}
        times = {"time": self.times(topic)}
        return to_frame({**times, **kept}, {"time": "s", **columns.units}, "time")

    def waveform(self, rate: int, start: float = 0.0, duration: float | None = None) -> Columns:
        """Return every channel at any whole rate [Hz], exactly, with the times [s].

        ``start`` and ``duration`` choose a part [s]: samples are from start on and before its end,
        so parts that follow each other have each sample once. One of 12 channels takes 96 bytes.
        """
        rate = int(_RATE.check("rate", rate))
        begin, end = round(SECONDS.check("start", start) * SECOND), self._end
        if duration is not None:
            end = min(begin + round(SECONDS.check("duration", duration) * SECOND), end)
        first = first_sample(begin, rate)
        count = max(0, first_sample(end, rate) - first)
        times = Times.from_grid(first, count, rate)
        samples = sample(self._segments, times) if count else None
        values = {n: np.empty(0) if samples is None else getattr(samples, n) for n in CHANNELS}
        return Columns(
            {"time": times.seconds + times.fraction, **values}, {"time": "s", **CHANNEL_UNITS}
        )

    def plot(self) -> Figure:
        """Return a matplotlib figure: impacts, reacting force, nodal plane, and the last 2 ms."""
        return plot_run(
            (self.times("contact_force"), self["contact_force"]["peak_force"]),
            (self.times("reacting_force"), self["reacting_force"]["force"]),
            (self.times("nodal_plane"), self["nodal_plane"]["position"]),
            self.waveform(_CLOSE_RATE, start=max(0.0, self.duration - _CLOSE)),
        )

    def save(self, path: str | os.PathLike[str]) -> Path:
        """Write the run as a bag of rosbag2 with the drill's topics, and return its folder."""
        write_offline_bag(path, self.plan, self.duration)
        return Path(path)

    def __repr__(self) -> str:
        bag = f" of {os.fspath(self._bag.path)}" if self._bag is not None else ""
        return f"<DrillRun{bag}: {self.duration:g} s, seed {self.seed}>"

    def _repr_html_(self) -> str:
        units = {"duration": "s", **METRIC_UNITS}
        rows = "".join(
            f"<tr><td>{escape(name)}</td><td>{value:.6g} {escape(units[name])}</td></tr>"
            for name, value in self.metrics.items()
            if name in units and value is not None
        )
        try:
            picture = _picture(self.plot())
        except ModuleNotFoundError as error:
            picture = escape(str(error))
        return f"{escape(repr(self))}<table>{rows}</table>{picture}"

    def _advance(self, on_block: Callable[[Block], object]) -> None:
        """Compute the run to its end without messages."""
        compile_kernels(self.plan.beginning.settings.configuration)
        Run(self.plan, wanted=None, on_block=on_block).finish(self._end)

    def _compute(self, topic: str) -> Columns:
        growing = self._growing
        found = None if growing is None else growing.columns(topic, self.plan, self._end)
        if found is None:
            computed = run_batches(self.plan, self._end, (topic,))
            batches = [each for part in computed for each in part if each.topic == topic]
            found = rows_of(topic, batches)
        return _own_columns(found, drill_table(TOPICS[topic].type).columns)

    def _read(self, topic: str) -> Columns:
        assert self._bag is not None
        assert self.recorded is not None
        name = self.recorded.topic(topic)
        found = self._bag.arrays(name)
        held = self.recorded.holds(found["publish_time"])
        own = {name: values[held] for name, values in found.items()}
        self._origins[topic] = self.recorded.origins(own["publish_time"])
        return _own_columns(own, self._bag.columns(name))

    @cached_property
    def _segments(self) -> np.ndarray:
        """The segments of the whole run."""
        parts: list[np.ndarray] = []
        last: list[np.ndarray] = []

        def keep(block: Block) -> None:
            parts.append(block.segments)
            last[:] = [block.open_segment]

        self._advance(keep)
        return join_records([*parts, *last], SEGMENT)


def _own_columns(values: Mapping[str, np.ndarray], columns: Sequence[Column]) -> Columns:
    """Return columns without the times of a recorder."""
    kept = {name: each for name, each in values.items() if name not in RECEIVED}
    units = {e.name: "ns" if e.kind in _TIMES else e.unit for e in columns if e.name in kept}
    return Columns(kept, units)


def _picture(figure: Figure) -> str:
    data = BytesIO()
    figure.savefig(data, format="png", dpi=70)
    return f'<img src="data:image/png;base64,{b64encode(data.getvalue()).decode()}">'
