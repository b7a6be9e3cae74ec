"""Disturbances of the nodes under test: drawn from a seed, the same for the same step."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from random import Random
from typing import TYPE_CHECKING, NamedTuple

from rpud_sim.foundation.time import SECOND

if TYPE_CHECKING:
    from rpud_sim.testing.systems import SystemUnderTest

_SHUFFLED = 0.6  # chance of a step whose messages are shuffled
_STOPPED = 0.3  # chance of a process to be stopped in a step
_BEFORE = 0.5  # chance of a stop to begin before the drill advances
_LATEST = 10  # after which it begins at most [ms]
_LONGEST = 60  # of a stop [ms]
_SEEDS = 1 << 32  # of an order: 0 is for none


class Stop(NamedTuple):
    """Process that is stopped for a real time."""

    name: str
    delay: int  # since the step began [ms]
    length: int  # [ms]

    def __str__(self) -> str:
        late = f", {self.delay} ms after it began" if self.delay else ""
        return f"{self.name} was stopped for {self.length} ms{late}"


class DisturbedStep(NamedTuple):
    """Step and what disturbs it."""

    until: int  # its end [ns]
    shuffle: int  # seed of the order among topics, 0 for none
    stops: tuple[Stop, ...]

    def __str__(self) -> str:
        order = [f"topics were shuffled with {self.shuffle}"] if self.shuffle else []
        what = "; ".join([*map(str, self.stops), *order]) or "nothing"
        return f"step to {self.until / SECOND:.9g} s: {what}"


class Disturbances:
    """Disturbances of one drill and its nodes in one attempt; ``seed`` draws them."""

    def __init__(self, seed: str) -> None:
        self.steps: list[DisturbedStep] = []
        self._seed = seed

    @contextmanager
    def step(self, until: int, systems: Sequence[SystemUnderTest]) -> Iterator[int]:
        """Disturb a step to a simulation time [ns], and yield the seed of its order.

        Every process that was stopped continues before the end, also of a step that fails.
        """
        named = {each.name: each for each in systems if each.running and not each.paused}
        step = self._drawn(until, list(named))
        self.steps.append(step)
        with carried_out([(stop, named[stop.name]) for stop in step.stops]):
            yield step.shuffle

    def _drawn(self, until: int, names: Sequence[str]) -> DisturbedStep:
        random = Random(f"{self._seed} {len(self.steps)}")
        shuffle = random.randrange(1, _SEEDS) if random.random() < _SHUFFLED else 0
        drawn = [(random.random(), _drawn_stop(name, random)) for name in names]
        stops = tuple(stop for chance, stop in drawn if chance < _STOPPED)
        return DisturbedStep(until, shuffle, stops)


def _drawn_stop(name: str, random: Random) -> Stop:
    delay = 0 if random.random() < _BEFORE else random.randint(1, _LATEST)
    return Stop(name, delay, random.randint(1, _LONGEST))


@contextmanager
def carried_out(stops: Sequence[tuple[Stop, SystemUnderTest]]) -> Iterator[None]:
    """Stop processes and let them continue at their times; all of them continue in the end."""
    if not stops:
        yield
        return
    failed = threading.Event()
    for stop, system in stops:
        if not stop.delay:
            system.disturb(signal.SIGSTOP)
    thread = threading.Thread(target=_stop_and_go, args=(stops, failed), name="disturbances")
    thread.start()
    try:
        yield
    except BaseException:
        failed.set()
        raise
    finally:
        thread.join()


def _stop_and_go(stops: Sequence[tuple[Stop, SystemUnderTest]], failed: threading.Event) -> None:
    begun = time.monotonic()
    signals = [
        (milliseconds, number, system)
        for stop, system in stops
        for milliseconds, number in (
            (stop.delay, signal.SIGSTOP),
            (stop.delay + stop.length, signal.SIGCONT),
        )
    ]
    try:
        for milliseconds, number, system in sorted(signals, key=lambda each: each[0]):
            if failed.wait(max(0.0, begun + milliseconds / 1e3 - time.monotonic())):
                return
            system.disturb(number)
    finally:
        for _, system in stops:
            system.disturb(signal.SIGCONT)
