"""Stages of signal faults: how each kind changes, delays or drops the messages of a channel.

Messages are dictionaries of fields; a stage changes a copy.
"""

from __future__ import annotations

import math
from collections import deque
from typing import Any

import numpy as np

from rpud_sim.foundation.time import SECOND
from rpud_sim.model.elementary import logarithm_one_plus, sin_cos_cycles
from rpud_sim.simulation.topics import Channel, FieldPath, Fields

# Share of the values of a garbage channel that are NaN or infinite, so that mission software meets
# them; of random bit patterns only one in two thousand is.
NOT_FINITE_SHARE = 0.1


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
