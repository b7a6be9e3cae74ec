"""Signal faults: changed, late and lost messages of a healthy drill.

Each fault on a channel is a stage through which the channel's messages pass, in the order of
injection. Messages are the dictionaries of ``rpud_sim.simulation.fields``; a stage changes a copy.
Each fault has its own stream of random numbers, from the seed and the fault's number. So a fault on
one channel changes nothing on another.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.elementary import logarithm_one_plus, sin_cos_cycles
from rpud_sim.simulation.topics import CHANNELS, Channel, FieldPath

if TYPE_CHECKING:  # a kind of fault has its stage
    from rpud_sim.simulation.faults import FaultRecord
    from rpud_sim.simulation.fields import Fields

# Share of the values of a garbage channel that are NaN or infinite, so that mission software meets
# them; of random bit patterns only one in two thousand is.
NOT_FINITE_SHARE = 0.1


class SignalFaults:
    """Pipeline of the channels' messages through their faults."""

    def __init__(self, seed: int = 0) -> None:
        self._seed = seed
        self._last: dict[str, Fields | Callable[[], Fields]] = {}
        self._stages: dict[str, dict[int, Stage]] = {}

    @property
    def busy(self) -> bool:
        """Whether a fault acts on a channel, or holds messages of one."""
        return bool(self._stages)

    def note(self, channel: str, last: Callable[[], Fields]) -> None:
        """Note what a healthy channel published last, without its messages passing through here.

        last: makes this message, if a fault needs it.
        """
        self._last[channel] = last

    def apply(
        self, channel: str, time: int, fields: Fields, records: Sequence[FaultRecord]
    ) -> list[Fields]:
        """Return the messages that the channel publishes in place of one, in order; maybe none.

        A healthy channel publishes the same object.

        Args:
            time: simulation time of the message, never before the channel's last one [ns].
            fields: the message; it must not change from now on.
            records: at least those that last at this time; those that do not, and those of other
                channels, are ignored.
        """
        if not records and channel not in self._stages:
            self._last[channel] = fields
            return [fields]
        return self._pass(channel, time, [fields], records)

    def release(self, time: int, records: Sequence[FaultRecord]) -> list[tuple[str, Fields]]:
        """Return the late messages that are due, with their channels.

        Call it once a block: otherwise a late message would wait for the channel's next one.
        """
        return [
            (channel, fields)
            for channel in tuple(self._stages)
            for fields in self._pass(channel, time, [], records)
        ]

    def _pass(
        self, channel: str, time: int, messages: list[Fields], records: Sequence[FaultRecord]
    ) -> list[Fields]:
        stages = self._stages.setdefault(channel, {})
        lasting = {
            record.number: record
            for record in records
            if record.fault.channel == channel and record.lasts_at(time)
        }
        for number in sorted(lasting.keys() - stages.keys()):
            stages[number] = self._stage(lasting[number])
        for number in sorted(stages):
            if number in lasting:
                messages = stages[number].process(time, messages)
            else:
                messages = [*stages.pop(number).rest(), *messages]
        if not stages:
            del self._stages[channel]
        if messages:
            self._last[channel] = messages[-1]
        return messages

    def _stage(self, record: FaultRecord) -> Stage:
        fault = record.fault
        random = np.random.default_rng(
            np.random.SeedSequence(self._seed, spawn_key=(record.number,))
        )
        last = self._last.get(fault.channel)
        if callable(last):
            last = last()
        stage = fault.declared.stage
        assert stage is not None
        return stage(CHANNELS[fault.channel], fault.magnitude, random, last)


class Stage:
    """Stage of a fault, through which the messages of its channel pass."""

    def __init__(
        self, channel: Channel, magnitude: float, random: np.random.Generator, last: Fields | None
    ) -> None:
        self._channel = channel
        self._magnitude = magnitude
        self._random = random
        self._last = last  # what the channel published before

    def process(self, time: int, messages: list[Fields]) -> list[Fields]:
        """Return the messages that go on, for those that come at a time [ns]."""
        return [changed for fields in messages if (changed := self._change(fields)) is not None]

    def rest(self) -> list[Fields]:
        """Return the messages that are still held when the fault ends."""
        return []

    def _change(self, fields: Fields) -> Fields | None:
        raise NotImplementedError


class Off(Stage):
    """No message goes on."""

    def _change(self, fields: Fields) -> None:
        return None


class Stuck(Stage):
    """Values last published, with new stamps."""

    def _change(self, fields: Fields) -> Fields:
        if self._last is None:
            self._last = fields
        paths = (*self._channel.numbers, *self._channel.flags)
        return _replaced(fields, {path: _at(self._last, path) for path in paths})


class Garbage(Stage):
    """Random bit patterns."""

    def _change(self, fields: Fields) -> Fields:
        values: dict[FieldPath, Any] = {
            path: _garbage_number(self._random) for path in self._channel.numbers
        }
        values.update({path: self._random.random() < 0.5 for path in self._channel.flags})
        return _replaced(fields, values)


def _garbage_number(random: np.random.Generator) -> float:
    if random.random() < NOT_FINITE_SHARE:
        return (math.nan, math.inf, -math.inf)[int(3.0 * random.random())]
    return float(np.uint64(random.bit_generator.random_raw()).view(np.float64))


class Wrong(Stage):
    """Every measured number times the magnitude."""

    def _change(self, fields: Fields) -> Fields:
        return _replaced(
            fields, {path: self._magnitude * _at(fields, path) for path in self._channel.numbers}
        )


class Slow(Stage):
    """At most one message in each period."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._period = round(self._magnitude * SECOND)
        self._next = 0

    def process(self, time: int, messages: list[Fields]) -> list[Fields]:
        if not messages or time < self._next:
            return []
        self._next = time + self._period
        return messages[:1]


class Delayed(Stage):
    """Messages that wait."""

    def __init__(self, *args: Any) -> None:
        super().__init__(*args)
        self._delay = round(self._magnitude * SECOND)
        self._waiting: deque[tuple[int, Fields]] = deque()

    def process(self, time: int, messages: list[Fields]) -> list[Fields]:
        self._waiting.extend((time + self._delay, fields) for fields in messages)
        due = []
        while self._waiting and self._waiting[0][0] <= time:
            due.append(self._waiting.popleft()[1])
        return due

    def rest(self) -> list[Fields]:
        return [fields for _, fields in self._waiting]


class Intermittent(Stage):
    """Messages that are lost at random."""

    def _change(self, fields: Fields) -> Fields | None:
        return None if self._random.random() < self._magnitude else fields


def _normal(random: np.random.Generator) -> float:
    """Return a number of the standard normal distribution, by Box and Muller's transform."""
    size = math.sqrt(-2.0 * logarithm_one_plus(-random.random()))
    sine, _ = sin_cos_cycles(random.random())
    return float(size * sine)


class Noise(Stage):
    """Gaussian noise on the main quantity."""

    def _change(self, fields: Fields) -> Fields:
        main = self._channel.numbers[0]
        disturbance = self._magnitude * _normal(self._random)
        return _replaced(fields, {main: _at(fields, main) + disturbance})


class Bias(Stage):
    """Offset on the main quantity."""

    def _change(self, fields: Fields) -> Fields:
        main = self._channel.numbers[0]
        return _replaced(fields, {main: _at(fields, main) + self._magnitude})


def _at(fields: Fields, path: FieldPath) -> Any:
    value: Any = fields
    for name in path:
        value = value[name]
    return value


def _replaced(fields: Fields, values: dict[FieldPath, Any]) -> Fields:
    """Return a copy of a message with other values at some paths."""
    copy = _copy(fields)
    for path, value in values.items():
        inner = copy
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = value
    return copy


def _copy(fields: Fields) -> Fields:
    return {
        name: _copy(value) if isinstance(value, dict) else value for name, value in fields.items()
    }
