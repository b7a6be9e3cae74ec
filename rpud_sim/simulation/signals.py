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
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.elementary import logarithm_one_plus, sin_cos_cycles
from rpud_sim.simulation.faults import Fault, FaultRecord
from rpud_sim.simulation.topics import CHANNELS, FieldPath, Fields

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
        """Note what makes the last message of a healthy channel that did not pass through here."""
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
            record.number: record.fault
            for record in records
            if record.fault.channel == channel and record.lasts_at(time)
        }
        for number in sorted(lasting.keys() - stages.keys()):
            last = self._last.get(channel)
            seeds = np.random.SeedSequence(self._seed, spawn_key=(number,))
            message = last() if callable(last) else last
            stages[number] = Stage(lasting[number], np.random.default_rng(seeds), message)
        for number in sorted(stages):
            if number in lasting:
                messages = stages[number].process(time, messages)
            else:  # what still waits when a fault ends goes out
                messages = [*(fields for _, fields in stages.pop(number).waiting), *messages]
        if not stages:
            del self._stages[channel]
        if messages:
            self._last[channel] = messages[-1]
        return messages


class Stage:
    """Fault on its channel, through which the messages of the channel pass."""

    def __init__(self, fault: Fault, random: np.random.Generator, last: Fields | None) -> None:
        self._fault = fault
        self._random = random
        self._last = last  # what the channel published before
        self._next = 0  # time of the next message of a slow channel [ns]
        self.waiting: deque[tuple[int, Fields]] = deque()  # messages that are late, and when due

    def process(self, time: int, messages: list[Fields]) -> list[Fields]:
        """Return the messages that go on, for those that come at a time [ns]."""
        kind, magnitude = self._fault.kind, self._fault.magnitude
        if kind == "off":
            return []
        if kind == "slow":
            if not messages or time < self._next:
                return []
            self._next = time + round(magnitude * SECOND)
            return messages[:1]
        if kind == "delayed":
            due = time + round(magnitude * SECOND)
            self.waiting.extend((due, fields) for fields in messages)
            late = []
            while self.waiting and self.waiting[0][0] <= time:
                late.append(self.waiting.popleft()[1])
            return late
        if kind == "intermittent":
            return [fields for fields in messages if self._random.random() >= magnitude]
        return [_replaced(fields, self._values(fields)) for fields in messages]

    def _values(self, fields: Fields) -> dict[FieldPath, Any]:
        """Return the values of a message that the fault changes, by their paths."""
        kind, magnitude, random = self._fault.kind, self._fault.magnitude, self._random
        channel = CHANNELS[self._fault.channel]
        main = channel.numbers[0]
        if kind == "bias":
            return {main: _at(fields, main) + magnitude}
        if kind == "noise":
            return {main: _at(fields, main) + magnitude * _normal(random)}
        if kind == "wrong":
            return {path: magnitude * _at(fields, path) for path in channel.numbers}
        if kind == "garbage":
            numbers = {path: _garbage_number(random) for path in channel.numbers}
            return {**numbers, **{path: random.random() < 0.5 for path in channel.flags}}
        assert kind == "stuck"
        self._last = self._last or fields
        return {path: _at(self._last, path) for path in (*channel.numbers, *channel.flags)}


def _garbage_number(random: np.random.Generator) -> float:
    """Return a random bit pattern."""
    if random.random() < NOT_FINITE_SHARE:
        return (math.nan, math.inf, -math.inf)[int(3.0 * random.random())]
    return float(np.uint64(random.bit_generator.random_raw()).view(np.float64))


def _normal(random: np.random.Generator) -> float:
    """Return a number of the standard normal distribution, by Box and Muller's transform."""
    size = math.sqrt(-2.0 * logarithm_one_plus(-random.random()))
    sine, _ = sin_cos_cycles(random.random())
    return float(size * sine)


def _at(fields: Fields, path: FieldPath) -> Any:
    value: Any = fields
    for name in path:
        value = value[name]
    return value


def _replaced(fields: Fields, values: dict[FieldPath, Any]) -> Fields:
    """Return a copy of a message with other values at some paths."""
    copy = _copy(fields)
    for path, value in values.items():
        _at(copy, path[:-1])[path[-1]] = value
    return copy


def _copy(fields: Fields) -> Fields:
    return {
        name: _copy(value) if isinstance(value, dict) else value for name, value in fields.items()
    }
