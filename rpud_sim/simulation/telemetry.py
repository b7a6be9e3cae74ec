"""Telemetry: the messages of each block, for publishers and bags alike."""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.messages.batch import Batch, Fields
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
    prefixed,
    process_fields,
    sampled_fields,
    stamp_of,
    trajectory_cuts,
    trajectory_fields,
    waveform_fields,
    wrench_fields,
)
from rpud_sim.simulation.sampling import Times, join_samples
from rpud_sim.simulation.topics import CHANNELS

# Order in which a block's messages are published.
_ORDER = (
    *("contact_force", *SAMPLED, "wrench", *PROCESS_TOPICS),
    *("joint_states", "actuator_state", "waveform", "trajectory"),
)


# Length of a span, about [ns]: twice as much takes 70 MB and
# saves 5 % of the time of a proof.
_SPAN = 4 * SECOND

_PART = 1000  # samples of a waveform that are made in one part, about 0.2 ms

# Batches that may come later, with None between two parts of the work.
Stream = Iterator[Batch | None]


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
        self._prefix = settings.frame_prefix
        self._wanted = wanted
        self._signals = SignalFaults(seed)
        self._pending: list[Block] = []
        self.origin = 0  # stamp of simulation time zero [ns]
        self._segments = 0  # segments in messages of the trajectory, or left out
        self._impacts = 0  # impacts that ended since simulation time zero
        # Time and work of the actuator's last sample.
        self._actuator_time = 0
        self._actuator_work = 0.0

    def batches(self, block: Block, faults: Sequence[FaultRecord], group: int) -> Iterator[Batch]:
        """Yield what has a deadline: impacts of a block and the samples at the ends of its parts.

        A part is at most one telemetry period long. ``faults`` lasted in a block of one part;
        there are none in one of several, whose batches are of the group.
        """
        for batch in self._sampled(block, group):
            yield from self._signals.apply(batch, faults) if batch.topic in CHANNELS else (batch,)
        yield from self._signals.release(block.end, faults)

    def streams(self, block: Block, group: int) -> Stream | None:
        """Return waveform and trajectory if a period of theirs ends with this block, else None.

        They are made while they are taken, part by part, and later blocks do not change them.
        """
        if group:  # whole periods
            return self._streams_of(block, self._stream_period, group)
        self._pending.append(block)
        number = self._boundary(block.end)
        if number is not None and number % self._stream_period == 0:
            return self.take_pending()
        return None

    def span_ends(self, start: int, time: int) -> np.ndarray:
        """Return the ends of the blocks from ``start`` that can be done together until a time [ns].

        They are whole periods of waveform and trajectory, of about ``_SPAN`` [ns], and none if
        something has to be done block by block first.
        """
        number, rate, period = self._boundary(start), self._telemetry_rate, self._stream_period
        if number is None or number % period or self._pending or self._signals.busy:
            return np.empty(0, np.int64)
        most = max(1, _SPAN * rate // SECOND // period)
        # Something that is due by now lies before the current boundary.
        periods = min(most, (boundaries_until(time, rate) - number) // period)
        last = number + periods * period
        return np.array([boundary(n + 1, rate) for n in range(number, last)], np.int64)

    def _sampled(self, block: Block, group: int) -> Iterator[Batch]:
        """Yield the impacts of a block, and what is due at its parts' ends if these are bounds."""
        parts, ends = np.arange(len(block)), block.ends
        # Not the messages of contact_force: a signal fault may lose some of them.
        impacts = self._impacts + block.struck
        self._impacts += len(block.impacts)
        if len(block.impacts):
            struck = block.struck.searchsorted(np.arange(len(block.impacts)), side="right")
            fields = contact_force_fields(block.impacts, self.origin)
            times = np.maximum(block.starts[struck], stamp_of(fields) - self.origin)
            yield self._batch("contact_force", struck, times, fields, group)
        if self._boundary(block.end) is None:
            return
        stamps = self.origin + ends
        samples = block.sample_ends()
        for topic in SAMPLED:
            yield self._batch(
                topic, parts, ends, sampled_fields(topic, samples, impacts, stamps), group
            )
        fields = wrench_fields(samples, stamps, block.states)
        yield self._batch("wrench", parts, ends, fields, group)
        for topic in PROCESS_TOPICS:
            if has_part(block.states, topic):
                for among, fields in process_fields(topic, block.states, stamps):
                    yield self._batch(topic, parts[among], ends[among], fields, group)
        if self._wanted("joint_states"):
            fields = joint_state_fields(samples, stamps, block.states)
            yield self._batch("joint_states", parts, ends, fields, group)
        if block.readings:
            powers = self._powers(block)
            if self._wanted("actuator_state"):
                fields = actuator_state_fields(block.readings, powers, stamps)
                yield self._batch("actuator_state", parts, ends, fields, group)

    def _powers(self, block: Block) -> np.ndarray:
        """Return the actuator's mean mechanical power up to the end of each block [W]."""
        powers = []
        for end, reading in zip(block.ends.tolist(), block.readings, strict=True):
            work = reading.mechanical_work - self._actuator_work
            elapsed = end - self._actuator_time
            self._actuator_time, self._actuator_work = end, reading.mechanical_work
            powers.append(work * SECOND / elapsed if elapsed else 0.0)
        return np.array(powers)

    def take_pending(self) -> Stream:
        """Return waveform and trajectory of what is pending, as ``streams`` does."""
        if not self._pending:
            return iter(())
        block = join_blocks(self._pending)
        self._pending.clear()
        return self._streams_of(block, len(block))

    def _streams_of(self, block: Block, period: int, group: int = 0) -> Stream:
        """Return waveform and trajectory of a block, a message of each in every ``period`` parts.

        There is a None after each ``_PART`` samples, unless they are of a group.
        """
        first = self._segments
        self._segments += int(block.finished[-1])
        return self._stream(block, period, group, first, self.origin)

    def _stream(self, block: Block, period: int, group: int, first: int, origin: int) -> Stream:
        groups = np.arange(period - 1, len(block), period)
        ends, finished = block.ends[groups], block.finished[groups]
        rate = self._sample_rate
        cuts = np.array([first_sample(end, rate) for end in (block.start, *ends.tolist())])
        held = np.flatnonzero(np.diff(cuts))
        if len(held) and self._wanted("waveform"):
            parts = []
            part = sys.maxsize if group else _PART
            for begin in range(int(cuts[0]), int(cuts[-1]), part):
                count = min(part, int(cuts[-1]) - begin)
                times = Times.from_grid(begin, count, rate)
                parts.append(block.sample_parts(period, np.clip(cuts - begin, 0, count), times))
                yield None
            samples = join_samples(parts)
            cuts = np.append(cuts[held], cuts[-1])
            fields = waveform_fields(samples, cuts, rate, origin)
            yield self._batch("waveform", groups[held], ends[held], fields, group)
        count = int(finished[-1])
        if count and self._wanted("trajectory"):
            yield None
            # A message holds the segments of one period that have the same constants.
            segments = block.covering[:count]
            firsts = np.unique([0, *finished[:-1].tolist(), *trajectory_cuts(segments).tolist()])
            firsts = firsts[firsts < count]
            periods = np.searchsorted(finished, firsts, side="right")
            fields = trajectory_fields(segments, np.append(firsts, count), first, origin)
            yield self._batch("trajectory", groups[periods], ends[periods], fields, group)

    def _boundary(self, time: int) -> int | None:
        """Number of the telemetry period that ends at a time [ns], if one does."""
        number = boundaries_until(time, self._telemetry_rate)
        return number if boundary(number, self._telemetry_rate) == time else None

    def _batch(
        self, topic: str, blocks: np.ndarray, times: np.ndarray, fields: Fields, group: int
    ) -> Batch:
        """Return a batch of messages that belong to blocks of a group, by their numbers."""
        order = blocks * len(_ORDER) + _ORDER.index(topic) if group else None
        return Batch(topic, times, prefixed(fields, self._prefix), group, order)
