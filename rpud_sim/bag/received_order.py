"""Bags whose recorder's clock was set back: their messages in the order in which they came."""

from __future__ import annotations

import os
import warnings
from collections.abc import Collection, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

import rpud_sim.bag
from rpud_sim.bag.mcap_reader import BagChunk
from rpud_sim.bag.reader import BagReader
from rpud_sim.messages.batch import LATEST, Batch
from rpud_sim.messages.errors import BagFormatError

_NONE = np.empty(0, np.int64)


def open_received(path: str | os.PathLike[str]) -> BagReader:
    """Open a bag in the order in which its messages came, as far as it shows.

    It is the order of log times, unless a clock was set back.
    """
    bag = rpud_sim.bag.open(path)
    with suppress(BagFormatError), ExitStack() as opened, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # which the bag itself has given already
        if _goes_back(bag):
            received = ReceivedOrder(path)
            opened.callback(received.close)
            if received.set_back:
                bag.close()
                opened.pop_all()
                return received
    return bag


def _goes_back(bag: BagReader) -> bool:
    """Whether log times of a topic go back: a recorder writes its messages as they come."""
    reached: dict[str, int] = {}
    for topic, times in bag._written_times():
        if len(times):
            if times[0] < reached.get(topic, 0) or (times[1:] < times[:-1]).any():
                return True
            reached[topic] = int(times[-1])
    return False


class _Steps(NamedTuple):
    """Steps by which log times go back in the order of the files."""

    first: int  # log time of the message that was written first [ns]
    last: int  # log time of the message that was written last [ns]
    total: int  # sum of all steps [ns]
    # by chunk, the places from which on log times are earlier, and by how much [ns]
    chunks: list[tuple[np.ndarray, np.ndarray]]


class ReceivedOrder(BagReader):
    """Open bag that is read in the order of its files; its times are shifted and never go back.

    Where a clock was set back, the shift grows by that step.
    """

    @property
    def set_back(self) -> bool:
        """Whether log times go back somewhere, by steps that a clock can be set."""
        return 0 < self._steps.total < LATEST - super().end_time

    @property
    def start_time(self) -> int:
        """Log time of the message that was written first [ns]; 0 in an empty bag."""
        return self._steps.first

    @property
    def end_time(self) -> int:
        """Shifted log time of the last message [ns]; 0 in an empty bag."""
        return self._steps.last + self._steps.total

    def chunks(self) -> list[BagChunk]:
        """Return the chunks in the order of the files."""
        ordered = (sorted(each.chunks(), key=lambda c: c.place.start) for each in self._files)
        return [chunk for chunks in ordered for chunk in chunks]

    @cached_property
    def _steps(self) -> _Steps:
        chunks: list[tuple[np.ndarray, np.ndarray]] = []
        first = last = -1
        total = 0
        for chunk in self.chunks():
            batches = chunk.batches()
            places = np.concatenate([_NONE, *(each.starts for each in batches)])
            times = np.concatenate([_NONE, *(each.log_times for each in batches)])
            order = np.argsort(places)
            places, times = places[order], times[order]
            if len(times) and first < 0:
                first = last = int(times[0])
            back = -np.diff(times, prepend=last)
            chunks.append((places[back > 0], back[back > 0]))
            total += sum(chunks[-1][1].tolist())
            last = int(times[-1]) if len(times) else last
        return _Steps(max(0, first), max(0, last), total, chunks)

    def _due(
        self, topics: Collection[str] | None, start: int, duration: int | None
    ) -> Iterator[list[Batch]]:
        shift = 0
        for chunk, (places, steps) in zip(self.chunks(), self._steps.chunks, strict=True):
            shifts = shift + np.cumsum([0, *steps.tolist()])
            shift = int(shifts[-1])
            if topics is None or not chunk.topics.isdisjoint(topics):
                shifted = [_shifted(batch, places, shifts) for batch in chunk.batches(topics)]
                begin = self.start_time + start if start > 0 else 0
                end = LATEST if duration is None else self.start_time + start + duration
                yield [
                    batch.part(slice(*np.searchsorted(batch.log_times, [begin, end])))
                    for batch in shifted
                    if batch.log_times[-1] >= begin and batch.log_times[0] < end
                ]


def _shifted(batch: Batch, places: np.ndarray, shifts: np.ndarray) -> Batch:
    """Return the messages of a chunk in their order there, with shifted times."""
    ordered = batch.part(np.argsort(batch.starts))
    own = shifts[np.searchsorted(places, ordered.starts, "right")]
    logged = ordered.log_times + own
    # What was sent before a step and received after it has the publishing time of before.
    sent = np.minimum(np.minimum(ordered.publish_times, LATEST - own) + own, logged)
    return replace(ordered, log_times=logged, publish_times=sent)
