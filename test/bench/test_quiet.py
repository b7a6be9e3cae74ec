"""A turn in which others took much of the processors is measured again, and the best one counts."""

import pytest

from bench import quiet
from bench.quiet import ATTEMPTS, undisturbed


@pytest.mark.parametrize(
    ("stolen", "attempts", "chosen"),
    [
        ([0.0], 1, 0),
        ([0.5, 0.03], 2, 1),
        ([0.1, 0.5], 2, 0),
        ([0.2, 0.1], ATTEMPTS, 1),
    ],
)
def test_the_turn_in_which_others_took_least_counts(monkeypatch, stolen, attempts, chosen):
    clock = [0.0, 0.0]
    taken = []

    def measure():
        clock[0] += 2.0
        clock[1] += 2.0 * stolen[len(taken)]
        taken.append(len(taken))
        return taken[-1]

    monkeypatch.setattr(quiet, "processor_time", lambda: tuple(clock))
    assert undisturbed(measure) == chosen
    assert len(taken) == attempts
