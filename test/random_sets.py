"""Random parameter sets over the whole documented ranges: none may hang.

Each set is simulated for a fifth of a second. It must finish, or end with one line of an
EngineError, within a limit of CPU time. Exit 1 if one does not.
"""

from __future__ import annotations

import argparse
import dataclasses
import multiprocessing
import os
import signal
import sys
from collections import Counter

import numpy as np

from rpud_sim.foundation.quantities import Choice, Flag, Quantity, declarations
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation import EngineError, Simulation
from rpud_sim.simulation.ensemble import compile_kernels

DURATION = 0.2  # simulated [s]
LIMIT = 20.0  # of CPU time [s]
DECADES = (3, 6, 9, 12)  # of a set, down from the maximum of a parameter that has no least value
AT_AN_END = 0.1  # share of the values that are an end of their range
ALLOWED = {name: item.allowed for name, item in declarations(Parameters).items()}


@dataclasses.dataclass(frozen=True)
class Outcome:
    """What one set led to; ``reason`` is None if it finished."""

    number: int
    reason: str | None
    hung: bool


def draw(seed: int, number: int) -> Parameters:
    """Return one set; it depends on nothing but seed and number."""
    random = np.random.default_rng([seed, number])
    decades = int(random.choice(DECADES))
    values = {name: _value(allowed, decades, random) for name, allowed in ALLOWED.items()}
    return Parameters(**values)


def _value(
    allowed: Choice | Flag | Quantity, decades: int, random: np.random.Generator
) -> float | str | bool:
    if isinstance(allowed, Choice):
        return str(random.choice(allowed.choices))
    if isinstance(allowed, Flag):
        return bool(random.integers(2))
    ends = [allowed.minimum] * (not allowed.exclusive) + [allowed.maximum] * (not allowed.below)
    if random.random() < AT_AN_END:
        return float(random.choice(ends))
    if not allowed.unit:
        return float(random.uniform(allowed.minimum, allowed.maximum))
    low = max(allowed.minimum, allowed.maximum / 10.0**decades)
    value = np.exp(random.uniform(np.log(low), np.log(allowed.maximum)))
    return float(value.clip(low, allowed.maximum))


def simulate(parameters: Parameters, number: int = 0) -> Outcome:
    """Simulate one set and return what it led to."""
    signal.signal(signal.SIGPROF, _time_out)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    reason = None
    hung = False
    try:
        Simulation(parameters).advance_to(round(DURATION * SECOND))
    except EngineError as error:
        reason = str(error)
    except TimeoutError:
        hung = True
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
    return Outcome(number, reason, hung)


def _time_out(*_: object) -> None:
    raise TimeoutError


def _numbered(job: tuple[int, int]) -> Outcome:
    return simulate(draw(*job), job[1])


def main() -> int:
    """Simulate the sets on all cores and print what they led to."""
    parser = argparse.ArgumentParser(prog="random_sets", description=__doc__)
    parser.add_argument("--count", type=int, default=400)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    compile_kernels(Parameters())
    jobs = [(arguments.seed, number) for number in range(arguments.count)]
    context = multiprocessing.get_context("spawn")
    with context.Pool(os.cpu_count()) as pool:
        outcomes = list(pool.imap_unordered(_numbered, jobs))
    kinds = Counter(_kind(outcome) for outcome in outcomes)
    for kind, count in kinds.most_common():
        print(f"{count:5} {kind}")
    return 1 if any(outcome.hung for outcome in outcomes) else 0


def _kind(outcome: Outcome) -> str:
    if outcome.hung:
        return f"hung: set {outcome.number} took more than {LIMIT:g} s"
    return "finished" if outcome.reason is None else outcome.reason.partition(" at ")[0]


if __name__ == "__main__":
    sys.exit(main())
