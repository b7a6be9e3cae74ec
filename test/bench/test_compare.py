"""Verdicts on two versions' times: differences are found, and copies of one version have none."""

import numpy as np
import pytest

from bench.compare import ratio


def pairs(factor, count=8, noise=0.02, seed=5):
    """Return times with a spread, on a machine that becomes slower as they are taken."""
    machine = 2.0 + np.arange(count) / count
    spread = np.exp(np.random.default_rng(seed).normal(0.0, noise, (count, 2)))
    return [(m * a, m * b * factor) for m, (a, b) in zip(machine, spread, strict=True)]


@pytest.mark.parametrize(
    ("factor", "verdict"),
    [(1.0, "no difference seen"), (1.01, "no difference seen"), (1.2, "slower"), (0.8, "faster")],
)
def test_a_verdict_is_that_of_the_ratio(factor, verdict):
    found = ratio(pairs(factor))

    assert str(found).startswith(f"{verdict}: ")
    assert found.value == pytest.approx(factor, rel=0.03)
