"""A campaign: many hostile inputs, one after another, and their results."""

from __future__ import annotations

import dataclasses
import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

from fuzz.drill import Drill
from fuzz.inputs import RARE, WAYS

LONGEST_REASON = 20_000  # rclpy repeats the names that it does not know
MOST_GROWTH = 20_000_000  # of memory, whatever the number of inputs [byte]
WARM_UP = 0.2  # share of the inputs after which memory is expected to stand
PAGE = 4096


@dataclasses.dataclass
class Tally:
    """Counts of the inputs of one way."""

    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0  # [s]


@dataclasses.dataclass
class Outcome:
    """Result of a campaign."""

    tallies: dict[str, Tally] = dataclasses.field(
        default_factory=lambda: {way: Tally() for way in WAYS}
    )
    harms: list[str] = dataclasses.field(default_factory=list)
    blocks: int = 0
    deadlines_missed: int = 0
    lag: float = 0.0  # at the end [s]
    growth: int = 0  # of memory after the warm-up [byte]

    @property
    def unharmed(self) -> bool:
        """Whether the drill is what it was before."""
        return not self.harms and self.growth < MOST_GROWTH


def run(
    drill: Drill,
    inputs: int,
    seed: int,
    progress: Callable[[], object] = lambda: None,
) -> Outcome:
    """Send inputs, and check after each that it was answered and that a refusal changed nothing.

    Every input is drawn from the seed and its own number, so that one can be repeated alone.
    """
    outcome = Outcome()
    ways = list(WAYS)
    weights = [RARE.get(way, 1.0) for way in ways]
    warm = resident()
    timekeeper = Timekeeper(drill)
    for number in range(inputs):
        if number == round(inputs * WARM_UP):
            warm = resident()
        drawn = random.Random(f"{seed}:{number}")
        way = ways[number] if number < len(ways) else drawn.choices(ways, weights)[0]
        for harm in send(drawn, drill, way, outcome.tallies[way]):
            outcome.harms.append(f"input {number} of seed {seed}, {way}: {harm}")
        timekeeper.look()
        progress()
    outcome.growth = resident() - warm
    timekeeper.wait()
    outcome.blocks, outcome.deadlines_missed, outcome.lag = timekeeper.totals()
    return outcome


def send(drawn: random.Random, drill: Drill, way: str, tally: Tally) -> list[str]:
    """Send one input; return what is wrong with its result."""
    before = drill.state()
    harms = []
    began = time.perf_counter()
    try:
        reason = WAYS[way](drawn, drill)
    except Exception as error:
        harms.append(f"{type(error).__name__}: {error}"[:500])
        reason = None
    tally.slowest = max(tally.slowest, time.perf_counter() - began)
    tally.inputs += 1
    if reason is None:
        tally.accepted += not harms
        if not drill.sound():
            harms.append("what is in force is not finite")
        drill.restore()
    else:
        tally.refused += 1
        if not reason.strip() or "\n" in reason or len(reason) > LONGEST_REASON:
            harms.append(f"the reason is not one line: {reason[:500]!r}")
        if drill.state() != before:
            harms.append(f"refused, {reason}, but the state has changed")
    if drill.node.loop.failure is not None:
        harms.append(f"the drilling has ended: {drill.node.loop.failure}")
    return harms


class Timekeeper:
    """Adds up what the drill reports of its schedule, since a reset sets its counters to zero.

    Args:
        drill: that reports.
    """

    def __init__(self, drill: Drill) -> None:
        self._drill = drill
        self._before = Counter[str]()
        self._latest = drill.node.report

    def look(self) -> None:
        """Take the latest report."""
        report = self._drill.node.report
        if report.measured["blocks"] < self._latest.measured["blocks"]:
            self._before += self._counted()
        self._latest = report

    def wait(self) -> None:
        """Let the drill be until it has reported twice, at last of a second that was its own."""
        for _ in range(2):
            timing = self._latest.measured
            deadline = time.monotonic() + 10.0
            while self._latest.measured is timing and time.monotonic() < deadline:
                time.sleep(0.01)
                self.look()

    def totals(self) -> tuple[int, int, float]:
        """Give the blocks, the deadlines missed, and the lag at the end [s]."""
        total = self._before + self._counted()
        return total["blocks"], total["missed"], self._latest.measured["lag"]

    def _counted(self) -> Counter[str]:
        timing = self._latest.measured
        return Counter(blocks=timing["blocks"], missed=timing["deadlines_missed"])


def resident() -> int:
    """Memory of this process that is in use [byte]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE
