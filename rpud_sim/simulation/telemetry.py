"""Telemetry: the messages of each block, for publishers and bags alike."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation.block import Block, boundaries_until, boundary, join_blocks
from rpud_sim.simulation.fields import (
    Fields,
    actuator_state_fields,
    contact_force_fields,
    drill_tool_fields,
    joint_state_fields,
    nodal_plane_fields,
    reacting_force_fields,
    stamp_of,
    trajectory_fields,
    waveform_fields,
    wrench_fields,
)
from rpud_sim.simulation.ledger import FaultRecord
from rpud_sim.simulation.sampling import Times, join_samples
from rpud_sim.simulation.signals import SignalFaults

_SENSORS = (
    ("nodal_plane", nodal_plane_fields),
    ("drill_tool", drill_tool_fields),
    ("reacting_force", reacting_force_fields),
    ("wrench", wrench_fields),
)

_PART = 1000  # samples of a waveform that are made in one part, about 0.2 ms

# A message: simulation time at which it is published [ns], topic, fields.
Entry = tuple[int, str, Fields]
# Messages that may come later, with None between two parts of the work.
Stream = Iterator[Entry | None]


class Telemetry:
    """Messages of consecutive blocks, changed by the faults of their signals.

    Attributes:
        origin: stamp of simulation time zero [ns].

    Args:
        telemetry_rate: of the samples [Hz].
        sample_rate: of the waveform [Hz].
        block_duration: of waveform and trajectory [s], at least one telemetry period.
        wanted: whether a topic that no fault can touch has a subscriber; without one its messages
            are not made.
        seed: of random numbers of faulty signals.
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
        self.origin = 0
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
        if self._boundary(block) is not None:
            yield from self._samples(block, faults)
        for channel, values in self._signals.release(block.end, faults):
            yield block.end, channel, values

    def streams(self, block: Block) -> Stream | None:
        """Return waveform and trajectory if a period of theirs ends with this block, else None.

        They are made while they are taken, part by part, and later blocks do not change them.
        """
        self._pending.append(block)
        number = self._boundary(block)
        if number is not None and number % self._stream_period == 0:
            return self._take_pending()
        return None

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
            for values in trajectory_fields(block, first, origin):
                yield block.end, "trajectory", values

    def _boundary(self, block: Block) -> int | None:
        """Number of the telemetry period that ends with a block, if one does."""
        number = boundaries_until(block.end, self._rate)
        return number if boundary(number, self._rate) == block.end else None

    def _signal(
        self, channel: str, time: int, values: Fields, faults: Sequence[FaultRecord]
    ) -> Iterator[Entry]:
        """Yield a sensor's message after the faults of its channel."""
        for changed in self._signals.apply(channel, time, values, faults):
            yield time, channel, changed

    def _samples(self, block: Block, faults: Sequence[FaultRecord]) -> Iterator[Entry]:
        stamp = self.origin + block.end
        samples = block.sample(Times.from_nanoseconds(block.end))
        for channel, make in _SENSORS:
            yield from self._signal(channel, block.end, make(samples, 0, stamp), faults)
        if self._wanted("joint_states"):
            yield block.end, "joint_states", joint_state_fields(samples, 0, stamp)
        if (reading := block.actuator) is not None:
            work = reading.mechanical_work - self._actuator_work
            elapsed = block.end - self._actuator_time
            power = work * SECOND / elapsed if elapsed else 0.0
            self._actuator_time, self._actuator_work = block.end, reading.mechanical_work
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


def messages_of(stream: Stream | None) -> Iterator[Entry]:
    """Yield the messages of a stream, if there is one."""
    return (entry for entry in stream or () if entry is not None)
