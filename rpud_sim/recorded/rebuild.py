"""Rebuilding of exact waveforms from a bag's trajectory, as a table of an export."""

from __future__ import annotations

import os
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import closing
from dataclasses import asdict, dataclass

import numpy as np

import rpud_sim.bag
from rpud_sim.bag import BagFormatError, BagReader, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.columns import Column, Kind
from rpud_sim.foundation.time import SECOND, join_seconds
from rpud_sim.recorded import RecordingError
from rpud_sim.recorded.export import describe_column, file_stem, make_table, write_account
from rpud_sim.recorded.journal import installed_codec
from rpud_sim.recorded.output import new_folder
from rpud_sim.simulation.sampling import (
    CHANNELS,
    Rebuilder,
    Samples,
    Times,
    end_sample,
    first_sample,
    to_segments,
)
from rpud_sim.simulation.topics import TOPICS

_TYPE = TOPICS["trajectory"].type
_MOST_SKIPPED = 100_000  # samples at once
_UNITS = {"position": "m", "displacement": "m", "velocity": "m/s", "force": "N"}
_FLOAT = np.dtype(np.float64)
_COLUMNS = (
    Column("time", Kind.TIME, np.dtype(np.int64), description="stamp of the sample, rounded"),
    *(
        Column(channel, Kind.NUMBER, _FLOAT, unit=_UNITS[channel.rpartition("_")[2]])
        for channel in CHANNELS
    ),
)


# Number of the first row, number of rows, and columns; None where samples lack.
_Rows = tuple[int, int, Mapping[str, np.ndarray] | None]

# Rounding of the times of consecutive segments [s]; at a reset, time steps back further.
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
    run: int  # number of the simulation in the bag, from 1; a reset begins the next one
    runs: int  # number of simulations in the bag
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
    the longest part [s]. ``run`` is the number of the simulation, if resets began several.
    """
    with rpud_sim.bag.open(path) as bag:
        topic = _topic(bag, topics)

        messages = bag.messages({topic})
        pieces = trajectory_pieces(messages, installed_codec(_TYPE), bag.path)
        waveform = _Waveform(rate, run, start, duration)
        about = {"bag": str(bag.path), "topic": topic, "rate": rate, "run": run}
        with new_folder(out) as folder:
            stem = folder / file_stem(topic)
            file = make_table(file_format, stem, _COLUMNS, {"rpud_sim": about})
            missing = 0
            with closing(file):
                for place, count, values in waveform.rows(pieces):
                    none = dict.fromkeys(CHANNELS, np.full(0 if values else count, np.nan))
                    stamps = _stamps(place, count, rate, waveform.origin)
                    file.write({"time": stamps, **(values or none)})
                    missing += 0 if values else count
                    report(count if values else 0)
            waveform.check()
            rebuilt = Rebuilt(
                path=os.fspath(out),
                format=file_format,
                topic=topic,
                table=file.path.name,
                rate=rate,
                first=waveform.first,
                count=waveform.end - waveform.first,
                missing=missing,
                origin=waveform.origin,
                run=run,
                runs=waveform.runs,
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
            f"{bag.path} holds several trajectories: choose one by --topics of {', '.join(names)}"
        )
    if not names:
        what = "no trajectory" if wanted is None else f"no trajectory named {' or '.join(wanted)}"
        raise RecordingError(f"{bag.path} holds {what}; record the topic trajectory")
    return names[0]


class _Waveform:
    """Samples of one run of a trajectory, from ``start`` [s] for a duration [s]; None for all."""

    def __init__(self, rate: int, run: int, start: float, duration: float | None) -> None:
        self.first = 0  # number of the first sample
        self.end = 0  # number after the last one
        self.origin = 0  # stamp of simulation time zero [ns]
        self.runs = 0  # number of runs so far
        self.size = 0  # of their messages [bytes]
        self._rate, self._run, self._start, self._duration = rate, run, start, duration
        self._begin = 0  # number of the run's first sample
        self._run_end = 0

    def rows(self, pieces: Iterable[TrajectoryPiece]) -> Iterator[_Rows]:
        """Yield number of the first row, number of rows and columns; None where samples lack."""
        place: int | None = None  # of the next row
        for number, samples in self._samples(pieces):
            place = self.first if place is None else place
            yield from _gap(place, min(number, self.end))
            place = max(place, min(number, self.end))
            last = min(number + len(samples.reacting_force), self.end)
            if last > place:
                part = slice(place - number, last - number)
                yield place, last - place, {n: getattr(samples, n)[part] for n in CHANNELS}
                place = last
        yield from _gap(self.first if place is None else place, self.end)

    def _samples(self, pieces: Iterable[TrajectoryPiece]) -> Iterator[tuple[int, Samples]]:
        """Yield the samples of the run, each array with its first number."""
        rebuilder = Rebuilder(self._rate)
        for piece in pieces:
            begun, self.runs = self.runs >= self._run, piece.run
            self.size += piece.size
            if piece.run != self._run:
                continue
            first = first_sample(piece.segments[0], self._rate)
            if not begun:
                self._begin, self.origin = first, piece.origin
                self.first = first + round(self._start * self._rate)
            self._run_end = end_sample(piece.segments[-1], self._rate)
            self.end = self._run_end
            if self._duration is not None:
                longest = max(1, round(self._duration * self._rate))
                self.end = min(self.end, self.first + longest)
            if not piece.follows:
                yield from rebuilder.finish()
            if first < self.end:
                yield from rebuilder.add(piece.segments)
        yield from rebuilder.finish()

    def check(self) -> None:
        """Raise an RecordingError if there is no such part, once all is read."""
        if not self.runs:
            raise RecordingError("the trajectory holds no segments")
        if not 1 <= self._run <= self.runs:
            raise RecordingError(
                f"--run = {self._run} is outside its range [1, {self.runs}]: resets begin new ones"
            )
        if self.first >= self._run_end:
            held = (self._run_end - self._begin) / self._rate
            raise RecordingError(
                f"--start = {self._start:g} s is not in the {held:g} s that the bag holds"
            )


def _gap(first: int, end: int) -> Iterator[_Rows]:
    while (count := min(end, first + _MOST_SKIPPED) - first) > 0:
        yield first, count, None
        first += count


@dataclass(frozen=True)
class TrajectoryPiece:
    """Segments of one message."""

    run: int  # number of the simulation, from 1; a reset begins the next one
    follows: bool  # whether they follow those of the piece before without a gap
    origin: int  # stamp of simulation time zero [ns]
    segments: np.ndarray  # ``SEGMENT`` records; at least one
    stamp: int  # of the message [ns]
    published: int  # when the message was sent [ns]
    size: int  # of the message [bytes]


def trajectory_pieces(
    messages: Iterable[Message], codec: Codec, path: object
) -> Iterator[TrajectoryPiece]:
    """Yield the pieces of a trajectory, one for each message with segments, from any one on."""
    run, following, end = 0, -1, 0.0
    for recorded in messages:
        message = codec.decode(recorded.data)
        try:
            segments = to_segments(message)
        except ValueError as error:
            raise BagFormatError(f"{path}: a trajectory is damaged: {error}") from None
        if not len(segments):
            continue
        start = int(segments["start_seconds"][0]) + float(segments["start_fraction"][0])
        if message.sequence < following or start < end - _ROUNDING or not run:
            run += 1
            following = -1
        origin = join_seconds(message.origin.sec, message.origin.nanosec)
        follows = message.sequence == following
        size = len(recorded.data)
        stamp = join_seconds(message.header.stamp.sec, message.header.stamp.nanosec)
        published = recorded.publish_time
        yield TrajectoryPiece(run, follows, origin, segments, stamp, published, size)
        following = message.sequence + len(segments)
        last = segments[-1]
        end = int(last["start_seconds"]) + float(last["start_fraction"] + last["duration"])


def _stamps(first: int, count: int, rate: int, origin: int) -> np.ndarray:
    times = Times.from_grid(first, count, rate)
    within = np.rint(times.fraction * SECOND).astype(np.int64)
    return origin + times.seconds * SECOND + within
