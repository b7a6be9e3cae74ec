"""Telemetry: the messages of each block, for publishers and bags alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from rpud_sim.foundation.ragged import Ragged
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.actuator import ActuatorReading
from rpud_sim.simulation.block import Block, boundaries_until, boundary, join_blocks
from rpud_sim.simulation.channels import CHANNELS
from rpud_sim.simulation.fields import (
    Fields,
    actuator_state_fields,
    contact_force_fields,
    drill_tool_fields,
    header_fields,
    joint_state_fields,
    nodal_plane_fields,
    reacting_force_fields,
    stamp_of,
    trajectory_columns,
    trajectory_cuts,
    trajectory_fields,
    waveform_fields,
    wrench_fields,
)
from rpud_sim.simulation.ledger import FaultRecord
from rpud_sim.simulation.process_fields import (
    PROCESS_TOPICS,
    States,
    has_part,
    mount_torque,
    process_columns,
    process_fields,
    process_joints,
)
from rpud_sim.simulation.sampling import Times, join_samples
from rpud_sim.simulation.signals import SignalFaults
from rpud_sim.simulation.span import Span
from rpud_sim.simulation.together import Columns, Entry, Together

_SENSORS = (
    ("nodal_plane", nodal_plane_fields),
    ("drill_tool", drill_tool_fields),
    ("reacting_force", reacting_force_fields),
)

# Simulation time of the blocks that are done together, about [ns]: more takes more memory, and
# saves no time.
_TOGETHER = 4 * SECOND

_PART = 1000  # samples of a waveform that are made in one part, about 0.2 ms

# Messages that may come later, with None between two parts of the work.
Stream = Iterator[Entry | None]


class Telemetry:
    """Messages of consecutive blocks, changed by the faults of their signals.

    Args:
        block_duration: of waveform and trajectory [s], at least one telemetry period.
        wanted: whether a topic that no fault can touch has had a subscriber; without one its
            messages are not made.
    """

    def __init__(
        self,
        telemetry_rate: int,
        sample_rate: int,
        block_duration: float,
        wanted: Callable[[str], bool] = lambda topic: True,
        seed: int = 0,
    ) -> None:
        self._rate = telemetry_rate
        self._sample_rate = sample_rate
        self._stream_period = round(block_duration * telemetry_rate)
        self._wanted = wanted
        self._signals = SignalFaults(seed)
        self._pending: list[Block] = []
        self.origin = 0  # stamp of simulation time zero [ns]
        self._segments = 0
        # Time and work of the actuator's last sample.
        self._actuator_time = 0
        self._actuator_work = 0.0

    def prompt(self, block: Block, faults: Sequence[FaultRecord]) -> Iterator[Entry]:
        """Yield the messages that are due at once: impacts of a block and the sample at its end.

        Args:
            block: at most one telemetry period long, after that of the last call.
            faults: that lasted in the block, or in a part of it.
        """
        faults = [record for record in faults if record.fault.channel]
        for impact in block.impacts:
            values = contact_force_fields(impact, self.origin)
            began = max(block.start, stamp_of(values) - self.origin)
            yield from self._signal("contact_force", began, values, faults)
        if self._boundary(block.end) is not None:
            yield from self._samples(block, faults)
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

    def stride(self, start: int, time: int) -> int:
        """Return the number of blocks from ``start`` that can be done together, up to a time [ns].

        They are whole periods of waveform and trajectory, of about ``_TOGETHER`` [ns], and 0 if
        something has to be done block by block first.
        """
        number = self._boundary(start)
        if number is None or number % self._stream_period or self._pending or self._signals.busy:
            return 0
        most = max(1, _TOGETHER * self._rate // SECOND // self._stream_period)
        periods = (boundaries_until(time, self._rate) - number) // self._stream_period
        # Something that is due by now lies before the present boundary.
        return max(0, min(most, periods)) * self._stream_period

    def ends(self, start: int, count: int) -> np.ndarray:
        """Return the ends of the blocks that follow a boundary [ns]."""
        first = boundaries_until(start, self._rate) + 1
        return np.array([boundary(first + k, self._rate) for k in range(count)], np.int64)

    def together(self, span: Span) -> Together:
        """Return all messages of a span of healthy signals, for which ``stride`` gave the length.

        They are those that ``prompt`` and ``streams`` would yield block by block.
        """
        blocks = np.arange(len(span))
        ends = span.ends
        stamps = self.origin + ends
        samples = span.sample_ends()
        columns = []

        def add(topic: str, blocks: np.ndarray, times: np.ndarray, fields: Fields) -> None:
            columns.append(Columns(topic, blocks, times, fields))

        if len(span.impacts):
            blocks_of = np.searchsorted(span.struck, np.arange(len(span.impacts)), side="right")
            fields = contact_force_fields(span.impacts, self.origin)
            times = np.maximum(span.starts[blocks_of], stamp_of(fields) - self.origin)
            add("contact_force", blocks_of, times, fields)
            self._signals.note(
                "contact_force", partial(contact_force_fields, span.impacts[-1], self.origin)
            )
        for topic, make in _sensors(span.states):
            add(topic, blocks, ends, make(samples, None, stamps))
            last = partial(make, samples, len(span) - 1, self.origin + span.end)
            self._signals.note(topic, last)
        self._processes_together(span, blocks, add)
        if self._wanted("joint_states"):
            joints = tuple(process_joints(span.states))
            fields = joint_state_fields(samples, None, stamps, joints)
            add("joint_states", blocks, ends, fields)
        if span.readings:
            powers = self._powers(span)
            if self._wanted("actuator_state"):
                add("actuator_state", blocks, ends, _readings(span.readings, powers, stamps))
        self._streams_together(span, blocks, add)
        return Together(ends, tuple(columns))

    def _processes_together(self, span: Span, blocks: np.ndarray, add: Callable[..., None]) -> None:
        states = span.states
        for topic in PROCESS_TOPICS:
            if not has_part(states, topic):
                continue
            for among, fields in process_columns(topic, states, self.origin + span.ends):
                add(topic, blocks[among], span.ends[among], fields)
            if topic in CHANNELS:
                last = partial(process_fields, topic, states[-1], self.origin + span.end)
                self._signals.note(topic, last)

    def _powers(self, span: Span) -> list[float]:
        """Return the actuator's mean mechanical power in each block [W]."""
        powers = []
        for end, reading in zip(span.ends.tolist(), span.readings, strict=True):
            powers.append(self._power(end, reading))
        return powers

    def _power(self, end: int, reading: ActuatorReading) -> float:
        work = reading.mechanical_work - self._actuator_work
        elapsed = end - self._actuator_time
        self._actuator_time, self._actuator_work = end, reading.mechanical_work
        return work * SECOND / elapsed if elapsed else 0.0

    def _streams_together(self, span: Span, blocks: np.ndarray, add: Callable[..., None]) -> None:
        period = self._stream_period
        last = slice(period - 1, None, period)
        blocks, ends, finished = blocks[last], span.ends[last], span.finished[last]
        if self._wanted("waveform"):
            rate = self._sample_rate
            # Numbers of the samples, as of ``Block.grid``; 64 bits would overflow within days.
            cuts = np.array([-(-end * rate // SECOND) for end in (span.start, *ends.tolist())])
            counts = np.diff(cuts)
            times = Times.from_grid(int(cuts[0]), int(cuts[-1] - cuts[0]), rate)
            samples = span.sample_parts(period, cuts - cuts[0], times)
            stamps = self.origin + np.array([cut * SECOND // rate for cut in cuts[:-1].tolist()])
            held = np.flatnonzero(counts)
            if len(held):
                convert = partial(_by_message, counts=counts[held])
                fields = waveform_fields(samples, stamps[held], cuts[held], rate, convert)
                add("waveform", blocks[held], ends[held], fields)
        number, count = self._segments, int(finished[-1])
        self._segments += count
        if count and self._wanted("trajectory"):
            segments = span.covering[:count]
            # A message holds the segments of one period that have the same constants.
            firsts = np.unique([0, *finished[:-1].tolist(), *trajectory_cuts(segments).tolist()])
            firsts = firsts[firsts < count]
            periods = np.searchsorted(finished, firsts, side="right")
            fields = trajectory_columns(segments, np.append(firsts, count), number, self.origin)
            add("trajectory", blocks[periods], ends[periods], fields)

    def drop_pending(self) -> None:
        """Begin waveform and trajectory here; what is pending of them is not published."""
        wanted, self._wanted = self._wanted, lambda topic: False
        for _ in self.flush():
            pass
        self._wanted = wanted

    def flush(self) -> Iterator[Entry]:
        """Return the waveform and the trajectory up to the end of the last block."""
        return messages_of(self._take_pending())

    def _take_pending(self) -> Stream:
        if not self._pending:
            return iter(())
        block = join_blocks(self._pending)
        self._pending.clear()
        first = self._segments
        self._segments += len(block.segments)
        return self._stream(block, first, self.origin)

    def _stream(self, block: Block, first: int, origin: int) -> Stream:
        yield from self._waveform(block, origin)
        if self._wanted("trajectory"):
            yield None
            for values in trajectory_fields(block.segments, first, origin):
                yield block.end, "trajectory", values

    def _boundary(self, time: int) -> int | None:
        """Number of the telemetry period that ends at a time [ns], if one does."""
        number = boundaries_until(time, self._rate)
        return number if boundary(number, self._rate) == time else None

    def _signal(
        self, channel: str, time: int, values: Fields, faults: Sequence[FaultRecord]
    ) -> Iterator[Entry]:
        """Yield a sensor's message after the faults of its channel."""
        for changed in self._signals.apply(channel, time, values, faults):
            yield time, channel, changed

    def _samples(self, block: Block, faults: Sequence[FaultRecord]) -> Iterator[Entry]:
        stamp = self.origin + block.end
        samples = block.sample(Times.from_nanoseconds(block.end))
        states = (block.process,)
        for channel, make in _sensors(states):
            yield from self._signal(channel, block.end, make(samples, 0, stamp), faults)
        for topic in PROCESS_TOPICS:
            if has_part(states, topic):
                values = process_fields(topic, states[0], stamp)
                if topic in CHANNELS:
                    yield from self._signal(topic, block.end, values, faults)
                else:
                    yield block.end, topic, values
        if self._wanted("joint_states"):
            joints = tuple(process_joints(states))
            yield block.end, "joint_states", joint_state_fields(samples, 0, stamp, joints)
        if (reading := block.actuator) is not None:
            power = self._power(block.end, reading)
            if self._wanted("actuator_state"):
                yield block.end, "actuator_state", actuator_state_fields(reading, power, stamp)

    def _waveform(self, block: Block, origin: int) -> Stream:
        rate = self._sample_rate
        numbers = block.grid(rate)
        if numbers and self._wanted("waveform"):
            parts = []
            for first in numbers[::_PART]:
                count = min(_PART, numbers.stop - first)
                parts.append(block.sample(Times.from_grid(first, count, rate)))
                yield None
            stamp = origin + numbers.start * SECOND // rate
            values = waveform_fields(join_samples(parts), stamp, numbers.start, rate)
            yield block.end, "waveform", values


def _sensors(states: States) -> Iterator[tuple[str, Callable[..., Fields]]]:
    """Yield the topics of the sensors of the motion, each with a function of samples and stamp."""
    yield from _SENSORS
    yield "wrench", partial(wrench_fields, torques=mount_torque(states))


def _by_message(values: np.ndarray, counts: np.ndarray) -> np.ndarray | Ragged:
    """Return the values of consecutive messages, each with so many of them, as a column."""
    if (counts == counts[0]).all():
        return values.reshape(len(counts), -1)
    return Ragged(values, np.concatenate([[0], np.cumsum(counts)]))


def _readings(
    readings: Sequence[ActuatorReading], powers: Sequence[float], stamps: np.ndarray
) -> Fields:
    if all(reading is readings[0] for reading in readings):
        fields = actuator_state_fields(readings[0], 0.0, stamps)
    else:
        rows = [actuator_state_fields(reading, 0.0, 0) for reading in readings]
        fields = {name: np.array([row[name] for row in rows]) for name in rows[0]}
        fields["header"] = header_fields("actuator_state", stamps)
    return {**fields, "mechanical_power": np.array(powers)}


def messages_of(stream: Stream | None) -> Iterator[Entry]:
    """Yield the messages of a stream, if there is one."""
    return (entry for entry in stream or () if entry is not None)
