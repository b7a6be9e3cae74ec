"""Tables of a run: the samples of each topic with labels, and the features of windows."""

from __future__ import annotations

import dataclasses
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import rpud_sim.bag
from rpud_sim.bag.columns import Column, Kind
from rpud_sim.foundation.time import SECOND
from rpud_sim.inspection.export.arrow_files import ParquetFile
from rpud_sim.inspection.offline_bag import NAMESPACE
from rpud_sim.simulation.channels import CHANNELS
from rpud_sim.studies.dataset import NOTICE
from rpud_sim.studies.dataset.plan import PlannedRun
from rpud_sim.studies.dataset.specification import HEALTHY, Specification, window_starts

WINDOWS = "windows"
"""Table of the features of windows."""

STATISTICS = ("mean", "std", "min", "max")
# Fields that hold labels, or the cause of a fault that no instrument of a drill measures: how far
# the arm's host has slipped, and the state of bit, cuttings and rock in the hole.
_LABELS = {
    "status": ("active_faults",),
    "mount": ("slip", "position"),
    "borehole": ("layer", "specific_energy", "packed_cuttings", "bit_wear", "side_offset"),
}
_STAMP = "header.stamp"


def _number(name: str, dtype: Any, unit: str, description: str) -> Column:
    return Column(name, Kind.NUMBER, np.dtype(dtype), unit=unit, description=description)


def _text(name: str, description: str) -> Column:
    return Column(name, Kind.TEXT, description=description)


_RUN = (_text("run", "name of the run"), _text("rock", "rock of the run"))
_LABEL = (
    _text("label", f"kind of the fault that lasts; {HEALTHY} without one"),
    _text("channel", "channel of a signal fault, otherwise empty"),
    _number("severity", np.uint8, "", "of the fault that lasts, from 1; 0 without one"),
)
_SAMPLE = (*_RUN, _number("time", float, "s", "stamp, since the beginning of the run"), *_LABEL)
_WINDOW = (
    *_RUN,
    _number("start", float, "s", "beginning of the window, since that of the run"),
    _number("end", float, "s", "end of the window, when its features are known"),
    *_LABEL,
    _number("share", float, "", "share of the window in which the fault lasts"),
)
WINDOW_LABELS = tuple(column.name for column in _WINDOW)
"""Columns of the table of windows that are no features."""


def make_tables(bag_path: Path, run: PlannedRun, specification: Specification) -> dict[str, bytes]:
    """Return the part of each table that a run gives, as the content of a Parquet file."""
    names = {topic: f"{NAMESPACE}/{topic}" for topic in specification.topics}
    with rpud_sim.bag.open(bag_path) as bag, tempfile.TemporaryDirectory() as folder:
        values = bag.arrays(list(names.values()))
        files = {}
        features: dict[Column, np.ndarray] = {}
        starts = window_starts(specification)
        ends = starts + round(specification.window.length * SECOND)
        for topic, full_name in names.items():
            columns = [c for c in bag.columns(full_name) if c.name not in _LABELS.get(topic, ())]
            files[topic] = _written(
                Path(folder) / topic, *_samples(run, columns, values[full_name]), topic
            )
            features.update(_features(topic, columns, values[full_name], starts, ends))
        windows = {**_window_labels(run, starts, ends), **{c.name: v for c, v in features.items()}}
        files[WINDOWS] = _written(Path(folder) / WINDOWS, (*_WINDOW, *features), windows, WINDOWS)
    return files


def _written(
    path: Path, columns: Sequence[Column], values: Mapping[str, np.ndarray], table: str
) -> bytes:
    metadata = {"rpud_sim": {"table": table, "notice": NOTICE}}
    file = ParquetFile(path, columns, metadata)
    if len(values["run"]):
        file.write(values)
    file.close()
    return file.paths[0].read_bytes()


def _samples(
    run: PlannedRun, columns: Sequence[Column], values: Mapping[str, np.ndarray]
) -> tuple[tuple[Column, ...], dict[str, np.ndarray]]:
    """Return the columns of the samples of a topic and their values.

    A sample has the label of its stamp: a message that a fault delays keeps that of its time.
    """
    taken = {column.name for column in _SAMPLE}
    renamed = {c.name: f"{c.name}_" if c.name in taken else c.name for c in columns}
    stamps = values[_STAMP]
    labelled = {
        **_run_labels(run, len(stamps)),
        "time": stamps / SECOND,
        **_labels(run, run.lasts_at(stamps)),
        **{renamed[c.name]: values[c.name] for c in columns},
    }
    own = tuple(dataclasses.replace(c, name=renamed[c.name]) for c in columns)
    return (*_SAMPLE, *own), labelled


def _window_labels(run: PlannedRun, starts: np.ndarray, ends: np.ndarray) -> dict[str, np.ndarray]:
    """Return the labels of windows: a fault counts where it lasts for any part of the window."""
    overlap = np.zeros(len(starts), np.int64)
    if run.onset is not None:
        clear = ends if run.clear is None else np.minimum(ends, run.clear)
        overlap = np.maximum(clear - np.maximum(starts, run.onset), 0)
    return {
        **_run_labels(run, len(starts)),
        "start": starts / SECOND,
        "end": ends / SECOND,
        **_labels(run, overlap > 0),
        "share": overlap / (ends - starts),
    }


def _run_labels(run: PlannedRun, count: int) -> dict[str, np.ndarray]:
    return {"run": _repeated(run.name, count), "rock": _repeated(run.rock, count)}


def _labels(run: PlannedRun, lasts: np.ndarray) -> dict[str, np.ndarray]:
    label, channel = (_repeated(text, len(lasts)) for text in (HEALTHY, ""))
    label[lasts] = run.kind
    channel[lasts] = run.channel
    return {"label": label, "channel": channel, "severity": (lasts * run.severity).astype(np.uint8)}


def _repeated(text: str, count: int) -> np.ndarray:
    texts = np.empty(count, object)
    texts[:] = text
    return texts


def _features(
    topic: str,
    columns: Sequence[Column],
    values: Mapping[str, np.ndarray],
    starts: np.ndarray,
    ends: np.ndarray,
) -> Iterator[tuple[Column, np.ndarray]]:
    """Yield the features of a topic in windows: of the messages that were published in them.

    A window without a message has NaN. Garbage numbers give infinite or NaN features as well.
    """
    published = values["log_time"]
    first, last = np.searchsorted(published, starts), np.searchsorted(published, ends)
    count = (last - first).astype(float)
    yield _number(f"{topic}.count", float, "", "messages that were published"), count
    late = (published - values[_STAMP]) / SECOND
    measured = [c for c in columns if c.kind is Kind.NUMBER and _is_measured(topic, c)]
    numbers = np.column_stack([late, *(values[c.name].astype(float) for c in measured)])
    found = np.full((len(STATISTICS), len(starts), numbers.shape[1]), np.nan)
    with np.errstate(all="ignore"):
        for i, (begin, end) in enumerate(zip(first.tolist(), last.tolist(), strict=True)):
            if end > begin:
                part = numbers[begin:end]
                found[:, i] = part.mean(0), part.std(0), part.min(0), part.max(0)
    # Stamps are rounded to nanoseconds: below a microsecond there is no delay.
    delay = np.round(found[0, :, 0], 6)
    yield _number(f"{topic}.delay", float, "s", "mean from stamp to publishing"), delay
    for j, column in enumerate(measured, 1):
        for k, statistic in enumerate(STATISTICS):
            name = f"{topic}.{column.name}.{statistic}"
            yield _number(name, float, column.unit, column.description), found[k, :, j]


def _is_measured(topic: str, column: Column) -> bool:
    """Whether a number is a measurement; a sequence number, for example, is none."""
    if topic in CHANNELS:
        channel = CHANNELS[topic]
        paths = {".".join(path) for path in (*channel.numbers, *channel.flags)}
        return column.name in paths
    return column.dtype.kind == "f" or column.dtype == bool
