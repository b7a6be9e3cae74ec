"""Rebuilding of exact waveforms from a bag's trajectory: one NumPy file for each channel."""

from __future__ import annotations

import json
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.lib.format import write_array_header_1_0

import rpud_sim.bag
from rpud_sim.bag import BagReader, Message
from rpud_sim.bag.cdr import Codec
from rpud_sim.bag.definitions import find_definition
from rpud_sim.inspection.output import new_folder
from rpud_sim.inspection.trajectory_pieces import TrajectoryPiece, trajectory_pieces
from rpud_sim.simulation.rebuilding import Rebuilder, end_sample, first_sample
from rpud_sim.simulation.sampling import CHANNELS, Samples
from rpud_sim.simulation.topics import TOPICS

_TYPE = TOPICS["trajectory"].type
_MOST_SKIPPED = 100_000  # samples at once


class RebuildError(Exception):
    """Waveform that cannot be rebuilt; the text gives the reason in one line."""


@dataclass(frozen=True)
class Rebuilt:
    """Result of rebuilding the waveforms of one run."""

    path: str  # folder of the files, each named after its channel, of shape (count,), float64, SI
    rate: int  # of the samples [Hz]
    first: int  # number of the first sample: simulation time is number / rate
    count: int  # of samples of each channel
    missing: int  # samples that no segment covers; they are NaN in all files
    origin: int  # stamp of simulation time zero [ns]
    run: int  # number of the simulation in the bag, from 1; a reset begins the next one
    runs: int  # number of simulations in the bag
    trajectory_size: int  # of all messages of the trajectory [bytes]
    size: int  # of the files [bytes]


def rebuild(
    path: str | os.PathLike[str],
    out: str | os.PathLike[str],
    rate: int,
    start: float = 0.0,
    duration: float | None = None,
    run: int = 1,
    topic: str | None = None,
    report: Callable[[int], object] = lambda samples: None,
) -> Rebuilt:
    """Write every channel of a bag's trajectory at any whole rate [Hz], without a simulation.

    ``start`` and ``duration`` [s] count from the beginning of the trajectory. ``run`` and ``topic``
    choose one of several. ``out`` appears when all of it is complete.
    """
    with rpud_sim.bag.open(path) as bag:
        pieces = _Pieces(bag, _topic(bag, topic))
        begin, end, origin, runs = _survey(pieces, rate, run)
        first = begin + round(start * rate)
        if first >= end:
            held = (end - begin) / rate
            raise RebuildError(f"--start = {start:g} s is not in the {held:g} s that the bag holds")
        if duration is not None:
            end = min(end, first + max(1, round(duration * rate)))
        with new_folder(out, RebuildError) as folder:
            with _Files(folder, first, end - first) as files:
                for number, samples in _samples(pieces, rate, run, end):
                    report(files.write(number, samples))
                files.finish()
            rebuilt = Rebuilt(
                path=os.fspath(out),
                rate=rate,
                first=first,
                count=end - first,
                missing=files.missing,
                origin=origin,
                run=run,
                runs=runs,
                trajectory_size=pieces.size,
                size=files.size,
            )
            content = json.dumps(vars(rebuilt), indent=2) + "\n"
            (folder / "rebuilt.json").write_text(content, encoding="utf-8")
    return rebuilt


def _topic(bag: BagReader, wanted: str | None) -> str:
    names = [
        summary.topic.name
        for summary in bag.topics
        if summary.topic.type == _TYPE and summary.message_count
    ]
    if wanted is not None:
        names = [name for name in names if name == wanted]
    if not names:
        what = "no trajectory" if wanted is None else f"no trajectory named {wanted}"
        raise RebuildError(f"{bag.path} holds {what}; record the topic trajectory")
    if len(names) > 1:
        raise RebuildError(f"{bag.path} holds several trajectories: choose of {', '.join(names)}")
    return names[0]


def _survey(pieces: _Pieces, rate: int, run: int) -> tuple[int, int, int, int]:
    """Return first sample, end and first origin of a run, and the number of runs."""
    first = end = origin = runs = 0
    for piece in pieces:
        if piece.run == run:
            if runs < run:
                first, origin = first_sample(piece.segments[0], rate), piece.origin
            end = end_sample(piece.segments[-1], rate)
        runs = piece.run
    if not runs:
        raise RebuildError("the trajectory holds no segments")
    if not 1 <= run <= runs:
        raise RebuildError(f"--run = {run} is outside its range [1, {runs}]: resets begin new ones")
    return first, end, origin, runs


def _samples(pieces: _Pieces, rate: int, run: int, end: int) -> Iterator[tuple[int, Samples]]:
    """Yield the samples of a run before sample ``end``, each array with its first number."""
    rebuilder = Rebuilder(rate)
    for piece in pieces:
        if piece.run != run:
            continue
        if not piece.follows:
            yield from rebuilder.finish()
        if first_sample(piece.segments[0], rate) >= end:
            break
        yield from rebuilder.add(piece.segments)
    yield from rebuilder.finish()


class _Pieces:
    """Pieces of a trajectory, one for each message; it can be iterated several times."""

    def __init__(self, bag: BagReader, topic: str) -> None:
        self._bag = bag
        self._topic = topic
        self._codec = Codec(_TYPE, find_definition(_TYPE))
        self.size = 0  # of the messages of the last iteration [bytes]

    def __iter__(self) -> Iterator[TrajectoryPiece]:
        self.size = 0
        return trajectory_pieces(self._counted(), self._codec, self._bag.path)

    def _counted(self) -> Iterator[Message]:
        for message in self._bag.messages({self._topic}):
            self.size += len(message.data)
            yield message


class _Files:
    """Growing NumPy files, one for each channel; gaps between written samples are NaN."""

    def __init__(self, folder: Path, first: int, count: int) -> None:
        self._paths = {channel: folder / f"{channel}.npy" for channel in CHANNELS}
        self._first = self._next = first
        self._end = first + count
        self._open = ExitStack()
        self._streams = {
            channel: self._open.enter_context(path.open("xb"))
            for channel, path in self._paths.items()
        }
        header = {"descr": "<f8", "fortran_order": False, "shape": (count,)}
        for stream in self._streams.values():
            write_array_header_1_0(stream, header)
        self.missing = 0  # number of samples in gaps

    @property
    def size(self) -> int:
        """Size of all files [bytes]."""
        return sum(path.stat().st_size for path in self._paths.values())

    def write(self, number: int, samples: Samples) -> int:
        """Write samples that begin with a number; return how many of them lie in the files."""
        self._skip_to(min(number, self._end))
        begin = max(self._next, number)
        end = min(self._end, number + len(samples.reacting_force))
        if end <= begin:
            return 0
        for channel, stream in self._streams.items():
            values = getattr(samples, channel)[begin - number : end - number]
            stream.write(np.ascontiguousarray(values, "<f8").data)
        self._next = end
        return end - begin

    def __enter__(self) -> _Files:
        return self

    def __exit__(self, *_: object) -> None:
        self._open.close()

    def finish(self) -> None:
        self._skip_to(self._end)

    def _skip_to(self, number: int) -> None:
        while (count := min(number - self._next, _MOST_SKIPPED)) > 0:
            for stream in self._streams.values():
                stream.write(np.full(count, np.nan, "<f8").data)
            self._next += count
            self.missing += count
