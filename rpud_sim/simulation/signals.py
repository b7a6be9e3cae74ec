"""Signal faults: changed, late and lost messages of a healthy drill.

Each fault on a channel is a stage through which the channel's messages pass, in the order of
injection. Messages are the dictionaries of ``rpud_sim.simulation.fields``; a stage changes a copy.
Each fault has its own stream of random numbers, from the seed and the fault's number. So a fault on
one channel changes nothing on another.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from rpud_sim.simulation.fault_kinds import Stage
from rpud_sim.simulation.faults import FaultRecord
from rpud_sim.simulation.topics import Fields


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

        A healthy channel publishes the same object, which must not change from now on. Times [ns]
        do not go back. ``records`` are at least those that last; others are ignored.
        """
        if not records and channel not in self._stages:
            self._last[channel] = fields
            return [fields]
        return self._pass(channel, time, [fields], records)

    def release(self, time: int, records: Sequence[FaultRecord]) -> list[tuple[str, Fields]]:
        """Return the late messages that are due, with their channels; call it once a block."""
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
            magnitude, random = lasting[number].magnitude, np.random.default_rng(seeds)
            stages[number] = Stage(channel, magnitude, random, message)
        for number in sorted(stages):
            if number in lasting:
                act = lasting[number].declared.signal
                messages = act(stages[number], time, messages) if act else messages
            else:  # what still waits when a fault ends goes out
                messages = [*(fields for _, fields in stages.pop(number).waiting), *messages]
        if not stages:
            del self._stages[channel]
        if messages:
            self._last[channel] = messages[-1]
        return messages
