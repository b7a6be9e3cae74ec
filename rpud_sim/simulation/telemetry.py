"""Telemetry: the messages of each block, for publishers and bags alike."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from operator import itemgetter

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.foundation.values import Ragged, Shared
from rpud_sim.simulation.block import Block, boundaries_until, boundary, first_sample, join_blocks
from rpud_sim.simulation.configuration import Settings
from rpud_sim.simulation.faults import FaultRecord, SignalFaults
from rpud_sim.simulation.fields import (
    PROCESS_TOPICS,
    SAMPLED,
    actuator_state_fields,
    contact_force_fields,
    has_part,
    joint_state_fields,
    process_fields,
    sampled_fields,
    stamp_of,
    to_array,
    trajectory_cuts,
    trajectory_fields,
    waveform_fields,
    wrench_fields,
)
from rpud_sim.simulation.sampling import Times, join_samples
from rpud_sim.simulation.topics import CHANNELS, Fields

# A message: simulation time at which it is published [ns], topic, fields.
Entry = tuple[int, str, Fields]

# Order in which a block's messages are published.
_ORDER = (
    *("contact_force", *SAMPLED, "wrench", *PROCESS_TOPICS),
    *("joint_states", "actuator_state", "waveform", "trajectory"),
)


@dataclass(frozen=True)
class Columns(Shared):
    """Messages of one topic, as columns."""

    topic: str  # its name
    # number of the block in the span that each belongs to, ascending, shape (n,)
    blocks: np.ndarray
    times: np.ndarray  # simulation time at which each is published [ns], shape (n,), int64
    # as of one message, with an array in place of each value that differs. A sequence has a
    # row for each message, or is ``Ragged``.
    fields: Fields

    def __len__(self) -> int:
        return len(self.times)

    @property
    def places(self) -> np.ndarray:
        """Place of each among all messages of the span; equal where they follow each other."""
        return self.blocks * len(_ORDER) + _ORDER.index(self.topic)

    def messages(self) -> Iterator[Entry]:
        for number, time in enumerate(self.times.tolist()):
            yield time, self.topic, row_of(self.fields, number)


@dataclass(frozen=True)
class Together:
    """All messages of a span."""

    ends: np.ndarray  # of its blocks: simulation times [ns]
    columns: tuple[Columns, ...]  # of topics; those of a topic follow each other in time

    @property
    def end(self) -> int:
        return int(self.ends[-1])

    def messages(self) -> Iterator[Entry]:
        """Yield the messages in order."""
        found = [
            (place, number, columns)
            for columns in self.columns
            for number, place in enumerate(columns.places.tolist())
        ]
        for _, number, columns in sorted(found, key=itemgetter(0)):
            yield int(columns.times[number]), columns.topic, row_of(columns.fields, number)


def row_of(fields: Fields, number: int) -> Fields:
    """Return the fields of one message of columns."""
    row = {}
    for name, column in fields.items():
        kind = type(column)
        if kind is np.ndarray:
            row[name] = column.item(number) if column.ndim == 1 else to_array(column[number])
        elif kind is dict:
            row[name] = row_of(column, number)
        elif kind is Ragged:
            row[name] = to_array(column.sequence(number))
        else:
            row[name] = list(column) if kind is list else column
    return row


# Simulation time of the blocks that are done together, about [ns]: twice as much takes 70 MB and
# saves 5 % of the time of a proof.
_TOGETHER = 4 * SECOND

_PART = 1000  # samples of a waveform that are made in one part, about 0.2 ms

# Messages that may come later, with None between two parts of the work.
Stream = Iterator[Entry | None]


class Telemetry:
    """Messages of consecutive blocks, changed by the faults of their signals.

    ``seed`` is of the random numbers of these; ``wanted`` as of ``Run``.
    """

    def __init__(
        self, settings: Settings, seed: int = 0, wanted: Callable[[str], bool] = lambda topic: True
    ) -> None:
        rate = settings.telemetry_rate
        self._telemetry_rate = rate
        self._sample_rate = settings.sample_rate
        # Periods of telemetry in one of waveform and trajectory.
        self._stream_period = round(settings.block_duration * rate)
        self._wanted = wanted
        self._signals = SignalFaults(seed)
        self._pending: list[Block] = []
        self.origin = 0  # stamp of simulation time zero [ns]
        self._segments = 0  # in messages of the trajectory, or left out
        # Time and work of the actuator's last sample.
        self._actuator_time = 0
        self._actuator_work = 0.0

    def prompt(self, block: Block, faults: Sequence[FaultRecord]) -> Iterator[Entry]:
        """Yield the messages that are due at once: impacts of a block and the sample at its end.

        The block is at most one telemetry period long. ``faults`` lasted in it, or in a part of it.
        """
        faults = [record for record in faults if record.fault.channel]
        for columns in self._columns(block, sampled=self._boundary(block.end) is not None):
            for time, topic, values in columns.messages():
                if topic in CHANNELS:
                    for changed in self._signals.apply(topic, time, values, faults):
                        yield time, topic, changed
                else:
                    yield time, topic, values
        for channel, values in self._signals.release(block.end, faults):
            yield block.end, channel, values

    def streams(self, block: Block) -> Stream | None:
        """Return waveform and trajectory if a period of theirs ends with this block, else None.

        They are made while they are taken, part by part, and later blocks do not change them.
        """
        self._pending.append(block)
        number = self._boundary(block.end)
        if number is not None and number % self._stream_period == 0:
            return self._take_pending()
        return None

    def ends_together(self, start: int, time: int) -> np.ndarray:
        """Return the ends of the blocks from ``start`` that can be done together until a time [ns].

        They are whole periods of waveform and trajectory, of about ``_TOGETHER`` [ns], and none if
        something has to be done block by block first.
        """
        number, rate, period = self._boundary(start), self._telemetry_rate, self._stream_period
        if number is None or number % period or self._pending or self._signals.busy:
            return np.empty(0, np.int64)
        most = max(1, _TOGETHER * rate // SECOND // period)
        # Something that is due by now lies before the present boundary.
        periods = min(most, (boundaries_until(time, rate) - number) // period)
        last = number + periods * period
        return np.array([boundary(n + 1, rate) for n in range(number, last)], np.int64)

    def together(self, block: Block) -> Together:
        """Return all messages of a block of healthy signals, with parts of ``ends_together``.

        They are those that ``prompt`` and ``streams`` would yield block by block.
        """
        streams = self._streams_of(block, self._stream_period)
        columns = [*self._columns(block), *(each for each in streams if each is not None)]
        for each in columns:
            if each.topic in CHANNELS:
                self._signals.note(each.topic, partial(row_of, each.fields, len(each) - 1))
        return Together(block.ends, tuple(columns))

    def _columns(self, block: Block, sampled: bool = True) -> Iterator[Columns]:
        """Yield the impacts of a block and, if ``sampled``, what is due at its parts' ends."""
        parts, ends = np.arange(len(block)), block.ends
        if len(block.impacts):
            struck = block.struck.searchsorted(np.arange(len(block.impacts)), side="right")
            fields = contact_force_fields(block.impacts, self.origin)
            times = np.maximum(block.starts[struck], stamp_of(fields) - self.origin)
            yield Columns("contact_force", struck, times, fields)
        if not sampled:
            return
        stamps = self.origin + ends
        samples = block.sample_ends()
        for topic in SAMPLED:
            yield Columns(topic, parts, ends, sampled_fields(topic, samples, stamps))
        fields = wrench_fields(samples, stamps, block.states)
        yield Columns("wrench", parts, ends, fields)
        for topic in PROCESS_TOPICS:
            if has_part(block.states, topic):
                for among, fields in process_fields(topic, block.states, stamps):
                    yield Columns(topic, parts[among], ends[among], fields)
        if self._wanted("joint_states"):
            fields = joint_state_fields(samples, stamps, block.states)
            yield Columns("joint_states", parts, ends, fields)
        if block.readings:
            powers = self._powers(block)
            if self._wanted("actuator_state"):
                fields = actuator_state_fields(block.readings, powers, stamps)
                yield Columns("actuator_state", parts, ends, fields)

    def _powers(self, block: Block) -> np.ndarray:
        """Return the actuator's mean mechanical power up to the end of each block [W]."""
        powers = []
        for end, reading in zip(block.ends.tolist(), block.readings, strict=True):
            work = reading.mechanical_work - self._actuator_work
            elapsed = end - self._actuator_time
            self._actuator_time, self._actuator_work = end, reading.mechanical_work
            powers.append(work * SECOND / elapsed if elapsed else 0.0)
        return np.array(powers)

    def drop_pending(self) -> None:
        """Begin waveform and trajectory here; what is pending of them is not published."""
        self._segments += sum(len(block.segments) for block in self._pending)
        self._pending.clear()

    def flush(self) -> Iterator[Entry]:
        return messages_of(self._take_pending())

    def _take_pending(self) -> Stream:
        if not self._pending:
            return iter(())
        block = join_blocks(self._pending)
        self._pending.clear()
        columns = self._streams_of(block, len(block), _PART)
        return chain.from_iterable((None,) if c is None else c.messages() for c in columns)

    def _streams_of(
        self, block: Block, period: int, part: int = sys.maxsize
    ) -> Iterator[Columns | None]:
        """Return waveform and trajectory of a block, a message of each in every ``period`` parts.

        There is a None after each ``part`` samples.
        """
        first = self._segments
        self._segments += int(block.finished[-1])
        return self._stream(block, period, part, first, self.origin)

    def _stream(
        self, block: Block, period: int, part: int, first: int, origin: int
    ) -> Iterator[Columns | None]:
        groups = np.arange(period - 1, len(block), period)
        ends, finished = block.ends[groups], block.finished[groups]
        rate = self._sample_rate
        cuts = np.array([first_sample(end, rate) for end in (block.start, *ends.tolist())])
        held = np.flatnonzero(np.diff(cuts))
        if len(held) and self._wanted("waveform"):
            parts = []
            for begin in range(int(cuts[0]), int(cuts[-1]), part):
                count = min(part, int(cuts[-1]) - begin)
                times = Times.from_grid(begin, count, rate)
                parts.append(block.sample_parts(period, np.clip(cuts - begin, 0, count), times))
                yield None
            samples = join_samples(parts)
            cuts = np.append(cuts[held], cuts[-1])
            fields = waveform_fields(samples, cuts, rate, origin)
            yield Columns("waveform", groups[held], ends[held], fields)
        count = int(finished[-1])
        if count and self._wanted("trajectory"):
            yield None
            # A message holds the segments of one period that have the same constants.
            segments = block.covering[:count]
            firsts = np.unique([0, *finished[:-1].tolist(), *trajectory_cuts(segments).tolist()])
            firsts = firsts[firsts < count]
            periods = np.searchsorted(finished, firsts, side="right")
            fields = trajectory_fields(segments, np.append(firsts, count), first, origin)
            yield Columns("trajectory", groups[periods], ends[periods], fields)

    def _boundary(self, time: int) -> int | None:
        """Number of the telemetry period that ends at a time [ns], if one does."""
        number = boundaries_until(time, self._telemetry_rate)
        return number if boundary(number, self._telemetry_rate) == time else None


def messages_of(stream: Stream | None) -> Iterator[Entry]:
    return (entry for entry in stream or () if entry is not None)
