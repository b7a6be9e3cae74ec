"""Drawn order of topics: what is published in one period of the telemetry, topic by topic."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from itertools import groupby
from random import Random

from rpud_sim.simulation.block import first_sample

_PAUSES = (0.0, 0.0, 0.002, 0.005)  # between two topics, drawn [s]; a node sees the first one alone
_FIRST = "journal"  # a recorder must have an entry before what follows from it

Timed = tuple[int, str, bytes]  # simulation time [ns], topic, and serialized message


class ShuffledOrder:
    """Order among topics that a seed determines, of a drill with a whole ``telemetry_rate`` [Hz].

    ROS keeps the order within one topic only, and so does this. It differs from period to period
    of the telemetry, and no message changes its period: a node may rely on older samples.
    """

    def __init__(self, seed: int, rate: int) -> None:
        self._seed = seed
        self._rate = rate

    def order(self, time: int, topics: Iterable[str]) -> list[str]:
        """Return topics in their order in the period that has a simulation time [ns]."""
        period = self._period(time)
        return sorted({*topics}, key=lambda topic: self._place(period, topic))

    def parts(self, messages: Sequence[Timed]) -> Iterator[tuple[float, list[Timed]]]:
        """Yield the messages of each topic in each period, and how long to pause before [s]."""
        for period, group in groupby(messages, lambda each: self._period(each[0])):
            together = sorted(group, key=lambda each: self._place(period, each[1]))  # it is stable
            for topic, part in groupby(together, lambda each: each[1]):
                pause = Random(f"{self._seed} {period} {topic} pause").choice(_PAUSES)
                yield (0.0 if topic == _FIRST else pause), list(part)

    def _period(self, time: int) -> int:
        return first_sample(time, self._rate)

    def _place(self, period: int, topic: str) -> float:
        return -1.0 if topic == _FIRST else Random(f"{self._seed} {period} {topic}").random()
