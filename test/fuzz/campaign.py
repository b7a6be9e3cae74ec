"""A campaign: many hostile inputs, one after another, and what came of them."""

from __future__ import annotations

import dataclasses
import random
import time
from collections.abc import Callable
from pathlib import Path

from fuzz.drill import Drill
from fuzz.inputs import RARE, WAYS
from rpud_sim.ros.pacing import Timing

LONGEST_REASON = 2_000
MOST_GROWTH = 20_000_000  # of memory, whatever the number of inputs [byte]
WARM_UP = 0.2  # share of the inputs after which memory is expected to stand
PAGE = 4096


@dataclasses.dataclass
class Tally:
    """What came of the inputs of one way."""

    inputs: int = 0
    refused: int = 0
    accepted: int = 0
    slowest: float = 0.0  # [s]


@dataclasses.dataclass
class Outcome:
    """What came of a campaign."""

    tallies: dict[str, Tally] = dataclasses.field(
        default_factory=lambda: {way: Tally() for way in WAYS}
    )
    harms: list[str] = dataclasses.field(default_factory=list)
    timing: Timing | None = None  # at the end
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
    for number in range(inputs):
        if number == round(inputs * WARM_UP):
            warm = resident()
        drawn = random.Random(f"{seed}:{number}")
        way = drawn.choices(ways, weights)[0]
        for harm in _send(drawn, drill, way, outcome.tallies[way]):
            outcome.harms.append(f"input {number} of seed {seed}, {way}: {harm}")
        progress()
    outcome.growth = resident() - warm
    outcome.timing = _timing(drill)
    return outcome


def _send(drawn: random.Random, drill: Drill, way: str, tally: Tally) -> list[str]:
    """Send one input; give what is wrong with what came of it."""
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
    if drill.node.failure is not None:
        harms.append(f"the drilling has ended: {drill.node.failure}")
    return harms


def _timing(drill: Drill) -> Timing | None:
    """How well the schedule was kept, as the next report tells it."""
    report = drill.node.report
    until = time.monotonic() + 10.0
    while drill.node.report is report and time.monotonic() < until:
        time.sleep(0.01)
    return drill.node.report.timing if drill.node.report else None


def resident() -> int:
    """Memory of this process that is in use [byte]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE
