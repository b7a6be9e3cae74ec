"""Random parameter sets over the whole documented ranges: none may hang.

Each is simulated for a fifth of a second. It must finish, or end with one line of an EngineError,
within a limit of CPU time. `make random-sets` draws SETS of them.
"""

import os
import re
import signal

import numpy as np
import pytest

from rpud_sim.foundation.quantities import Choice, Flag, declarations
from rpud_sim.foundation.time import SECOND
from rpud_sim.model.parameters import Parameters
from rpud_sim.simulation import EngineError
from rpud_sim.simulation.simulation import Simulation

SETS = int(os.environ.get("RPUD_SETS", "24"))
SEED = int(os.environ.get("RPUD_SEED", "1"))
LIMIT = 20.0  # of CPU time [s]
DECADES = (3, 6, 9, 12)  # of a set, down from the maximum of a parameter that has no least value
AT_AN_END = 0.1  # share of the values that are an end of their range
ALLOWED = {name: item.allowed for name, item in declarations(Parameters).items()}


def value(allowed, decades, random):
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
    drawn = np.exp(random.uniform(np.log(low), np.log(allowed.maximum)))
    return float(drawn.clip(low, allowed.maximum))


@pytest.fixture
def limited():
    """Let a test fail that takes too much CPU time."""

    def time_out(*_):
        raise TimeoutError

    before = signal.signal(signal.SIGPROF, time_out)
    signal.setitimer(signal.ITIMER_PROF, LIMIT)
    yield
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.signal(signal.SIGPROF, before)


@pytest.fixture(scope="module")
def compiled():
    Simulation(Parameters()).advance_to(SECOND // 1000)


@pytest.mark.extended
@pytest.mark.parametrize("number", range(SETS))
@pytest.mark.usefixtures("compiled", "limited")
def test_a_random_set_finishes_or_says_in_one_line_why_not(number):
    random = np.random.default_rng([SEED, number])
    decades = int(random.choice(DECADES))
    values = {name: value(allowed, decades, random) for name, allowed in ALLOWED.items()}
    reason = ""
    try:
        Simulation(Parameters(**values)).advance_to(SECOND // 5)
    except EngineError as error:
        reason = str(error)
    assert not reason or re.fullmatch(r".* at \S+ s, with \S+ = .*", reason)
