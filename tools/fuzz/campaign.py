"""A campaign: many hostile inputs, one after another, and their results."""

from __future__ import annotations

import random
import time
from collections.abc import Callable
from pathlib import Path

from tools.fuzz.drill import Drill
from tools.fuzz.inputs import RARE, WAYS
from tools.fuzz.tally import Outcome, Tally

LONGEST_REASON = 20_000  # rclpy repeats the names that it does not know
MOST_GROWTH = 20_000_000  # of memory, whatever the number of inputs [byte]
WARM_UP = 0.2  # share of the inputs after which memory is expected to stand
PAGE = 4096


def run(
    drill: Drill,
    inputs: int,
    seed: int,
    progress: Callable[[], object] = lambda: None,
) -> Outcome:
    """Send inputs, and check after each that it was answered and that a refusal changed nothing.

    Every input is drawn from the seed and its own number, so that one can be repeated alone.
    """
    outcome = Outcome(WAYS)
    ways = list(WAYS)
    weights = [RARE.get(way, 1.0) for way in ways]
    warm = resident()
    for number in range(inputs):
        if number == round(inputs * WARM_UP):
            warm = resident()
        drawn = random.Random(f"{seed}:{number}")
        way = ways[number] if number < len(ways) else drawn.choices(ways, weights)[0]
        for harm in send(drawn, drill, way, outcome.tallies[way]):
            outcome.harms.append(f"input {number} of seed {seed}, {way}: {harm}")
        progress()
    growth = resident() - warm
    if growth > MOST_GROWTH:
        outcome.harms.append(f"memory has grown by {growth / 1e6:.1f} MB after the first fifth")
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
    tally.add(reason is not None, time.perf_counter() - began)
    if reason is None:
        if not drill.sound():
            harms.append("what is in force is not finite")
        drill.restore()
    else:
        if not reason.strip() or "\n" in reason or len(reason) > LONGEST_REASON:
            harms.append(f"the reason is not one line: {reason[:500]!r}")
        if drill.state() != before:
            harms.append(f"refused, {reason}, but the state has changed")
    if drill.node.loop.failure is not None:
        harms.append(f"the drilling has ended: {drill.node.loop.failure}")
    return harms


def resident() -> int:
    """Memory of this process that is in use [byte]."""
    return int(Path("/proc/self/statm").read_text().split()[1]) * PAGE
