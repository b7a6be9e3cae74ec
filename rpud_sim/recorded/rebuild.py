"""Rebuilding of exact waveforms from a bag's trajectory, as a table of an export."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass
from typing import NamedTuple

import numpy as np

from rpud_sim.bag import BagFormatError, BagReader
from rpud_sim.bag.received_order import open_received
from rpud_sim.foundation.quantities import joined
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.messages.batch import Batch
from rpud_sim.messages.cdr import Codec
from rpud_sim.messages.columns import Column, Kind
from rpud_sim.messages.definitions import installed_codec
from rpud_sim.model.segment import SEGMENT
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.export import describe_column, file_stem, make_table, write_account
from rpud_sim.recorded.output import SkippedParts, new_folder
from rpud_sim.recorded.runs import drill_namespaces, find_drill
from rpud_sim.simulation.sampling import (
    CHANNELS,
    Times,
    end_sample,
    first_sample,
    sample,
    to_segments,
)
from rpud_sim.simulation.topics import TOPICS

_TYPE = TOPICS["trajectory"].type
_MOST = 100_000  # rows in one step
_UNITS = {"position": "m", "displacement": "m", "velocity": "m/s", "force": "N"}
CHANNEL_UNITS = {channel: _UNITS[channel.rpartition("_")[2]] for channel in CHANNELS}
_FLOAT = np.dtype(np.float64)
_COLUMNS = (
    Column("time", Kind.TIME, np.dtype(np.int64), description="stamp of the sample, rounded"),
    *(Column(name, Kind.NUMBER, _FLOAT, unit=unit) for name, unit in CHANNEL_UNITS.items()),
)


# Number of the first row, number of rows, and columns; None where samples lack.
_Rows = tuple[int, int, Mapping[str, np.ndarray] | None]

# Rounding of the times of consecutive segments [s].
_ROUNDING = 1e-6


@dataclass(frozen=True)
class Rebuilt:
    """Result of rebuilding the waveform of one run."""

    path: str  # folder of the export
    format: str  # of the table, one of ``export.FORMATS``
    topic: str  # of the trajectory
    table: str  # file or folder of the table, in the folder of the export
    rate: int  # of the samples [Hz]
    first: int  # number of the first sample: simulation time is number / rate
    count: int  # of samples
    missing: int  # samples that no segment covers; they are NaN in all columns but ``time``
    origin: int  # stamp of simulation time zero [ns]
    run: int  # number of the run in the bag, from 1; a reset begins the next one
    runs: int  # number of runs of the drill in the bag
    trajectory_size: int  # of the messages of the trajectory [bytes]
    size: int  # of the files [bytes]


def rebuild(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    rate: int,
    file_format: str = "parquet",
    topics: Collection[str] | None = None,
    start: float = 0.0,
    duration: float | None = None,
    run: int = 1,
    report: Callable[[int], object] = lambda samples: None,
) -> Rebuilt:
    """Write every channel of a bag's trajectory at any whole rate [Hz], without a simulation.

    ``out`` appears when all of it is complete. ``topics`` are those among which the trajectory is,
    if the bag holds several. ``start`` counts from the beginning of the trajectory, ``duration`` is
    the longest part [s]. ``run`` is the number of the run, if resets began several.
    """
    with open_received(path) as bag:
        topic = _topic(bag, topics)
        namespace = topic.rpartition("/")[0]
        if namespace not in drill_namespaces(bag):
            raise RecordingError(f"{bag.path}: {topic} is the trajectory of no drill in it")
        drill = find_drill(bag, SkippedParts(bag), namespace, run)
        own = drill.of(bag.batches({topic}))
        found = recorded_segments(own, installed_codec(_TYPE), bag.path)
        waveform = _Waveform(rate, start, duration)
        about = {"bag": str(bag.path), "topic": topic, "rate": rate, "run": run}
        with new_folder(out) as folder:
            stem = folder / file_stem(topic)
            file = make_table(file_format, stem, _COLUMNS, {"rpud_sim": about})
            missing = 0
            with closing(file):
                for place, count, values in waveform.rows(found):
                    none = dict.fromkeys(CHANNELS, np.full(0 if values else count, np.nan))
                    stamps = _stamps(place, count, rate, waveform.origin)
                    file.write({"time": stamps, **(values or none)})
                    missing += 0 if values else count
                    report(count if values else 0)
            rebuilt = Rebuilt(
                path=os.fspath(out),
                format=file_format,
                topic=topic,
                table=file.path.name,
                rate=rate,
                first=waveform.first,
                count=waveform.place - waveform.first,
                missing=missing,
                origin=waveform.origin,
                run=drill.number,
                runs=drill.runs,
                trajectory_size=waveform.size,
                size=file.path.stat().st_size,
            )
            columns = {column.name: describe_column(column) for column in _COLUMNS}
            write_account(folder, {**about, **asdict(rebuilt), "columns": columns})
    return rebuilt


def _topic(bag: BagReader, wanted: Collection[str] | None) -> str:
    held = [s.topic.name for s in bag.topics if s.topic.type == _TYPE and s.message_count]
    names = [name for name in held if wanted is None or name in wanted]
    if len(names) > 1:
        raise RecordingError(
            f"{bag.path} holds several trajectories: choose one by --topics of {joined(names)}"
        )
    if not names:
        what = "no trajectory" if wanted is None else f"no trajectory named {' or '.join(wanted)}"
        raise RecordingError(f"{bag.path} holds {what}; record the topic trajectory")
    return names[0]


class RecordedSegments(NamedTuple):
    """Segments of one message."""

    segments: np.ndarray  # ``SEGMENT`` records; at least one
    follows: bool  # whether they follow the message before without a gap
    origin: int  # stamp of simulation time zero, as the message has it [ns]
    zero: int  # origin of its batch [ns]
    size: int  # of the message [bytes]


def recorded_segments(
    batches: Iterable[Batch], codec: Codec, path: object
) -> Iterator[RecordedSegments]:
    """Yield the segments of a trajectory's messages, from any one on."""
    following, end = -1, 0.0
    for batch in batches:
        for number in range(len(batch)):
            message = codec.decode(data := batch.message(number))
            try:
                segments = to_segments(message)
            except ValueError as error:
                raise BagFormatError(f"{path}: a trajectory is damaged: {error}") from None
            if not len(segments):
                continue
            start = int(segments["start_seconds"][0]) + float(segments["start_fraction"][0])
            follows = message.sequence == following and start > end - _ROUNDING
            origin = join_seconds(message.origin.sec, message.origin.nanosec)
            yield RecordedSegments(segments, follows, origin, batch.origin, len(data))
            following = message.sequence + len(segments)
            last = segments[-1]
            end = int(last["start_seconds"]) + float(last["start_fraction"] + last["duration"])


class _Waveform:
    """Samples of one run of a trajectory, from ``start`` [s] for a duration [s]; None for all.

    Segments are sampled up to the start of the last one: the next message shows where that ends.
    """

    def __init__(self, rate: int, start: float, duration: float | None) -> None:
        self.first = 0  # number of the first sample
        self.place = 0  # number after the last one so far
        self.origin = 0  # stamp of simulation time zero [ns]
        self.size = 0  # of the messages [bytes]
        self._rate, self._start, self._duration = rate, start, duration
        self._most = 0  # number after the last sample that is wanted

    def rows(self, messages: Iterable[RecordedSegments]) -> Iterator[_Rows]:
        """Yield number of the first row, number of rows and columns; None where samples lack."""
        rate, begin = self._rate, -1
        held = np.zeros(0, SEGMENT)
        for message in messages:
            self.size += message.size
            first = first_sample(message.segments[0], rate)
            if begin < 0:
                begin, self.origin = first, message.origin
                self.first = self.place = first + round(self._start * rate)
                duration = 2**32 if self._duration is None else self._duration
                self._most = self.first + max(1, round(duration * rate))
            elif not message.follows:
                if first < end_sample(held[-1], rate) - 1:
                    raise RecordingError(
                        f"the trajectory begins again at {first / rate:.9g} s, and no journal "
                        "shows which run it is of"
                    )
                yield from self._sample(held, end_sample(held[-1], rate))
                held = held[:0]
            covering = np.concatenate([held, message.segments])
            yield from self._sample(covering, first_sample(covering[-1], rate))
            # One more than needed, because a number that is rounded up may be before a start.
            held = covering[-2:]
        if begin < 0:
            raise RecordingError("the trajectory holds no segments")
        end = end_sample(held[-1], rate)
        if self.first >= end:
            raise RecordingError(
                f"start = {self._start:g} s is not in the {(end - begin) / rate:g} s that the "
                "bag holds",
                code=2,
            )
        yield from self._sample(held, end)

    def _sample(self, covering: np.ndarray, end: int) -> Iterator[_Rows]:
        end = min(end, self._most)
        lacking = min(first_sample(covering[0], self._rate), end)
        while self.place < end:
            missing = self.place < lacking
            count = min((lacking if missing else end) - self.place, _MOST)
            values = None
            if not missing:
                values = vars(sample(covering, Times.from_grid(self.place, count, self._rate)))
            yield self.place, count, values
            self.place += count


def _stamps(first: int, count: int, rate: int, origin: int) -> np.ndarray:
    times = Times.from_grid(first, count, rate)
    within = np.rint(times.fraction * SECOND).astype(np.int64)
    return origin + times.seconds * SECOND + within
