"""The soak: every check can fail, and the whole runs against a real drill."""

import re
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import soak_checks as checks
from bench.soak_checks import Tally

ROOT = Path(__file__).resolve().parents[2]
SECOND = 1_000_000_000
EPOCH = 1_795_251_166_866_606_964
SECONDS = np.arange(1801.0)


def tally(*numbers, length=1):
    counted = Tally()
    for number in numbers:
        counted.add(number, length)
    return counted


@pytest.mark.parametrize(
    ("sizes", "passed"),
    [
        (200_000.0 + 50_000.0 * np.minimum(SECONDS / 900.0, 1.0), True),  # it settles
        (200_000.0 + 0.5 * SECONDS, True),  # the bound of 1024 KiB in 900 s is 1.14 KiB/s
        (200_000.0 + 1.5 * SECONDS, False),
        (SECONDS[:10], False),  # too few samples
    ],
)
def test_memory_may_settle_in_the_first_half_and_hardly_grow_in_the_second(sizes, passed):
    noise = np.random.default_rng(5).normal(0.0, 100.0, len(SECONDS))[: len(sizes)]
    seconds = SECONDS[: len(sizes)]
    assert checks.memory_growth("drill", seconds, sizes + noise).passed == passed


@pytest.mark.parametrize(
    ("factor", "passed"), [(1.0, True), (1.0004, True), (0.9994, False), (1.0006, False)]
)
def test_the_real_time_factor_is_told_by_stamps_and_arrivals(factor, passed):
    elapsed = [second * SECOND for second in range(30)]
    late = np.random.default_rng(5).integers(0, 2_000_000, 30)  # up to 2 ms on their way
    stamps = [EPOCH + round(factor * time) for time in elapsed]
    arrivals = [777 + time + int(delay) for time, delay in zip(elapsed, late, strict=True)]
    verdict = checks.real_time(stamps, arrivals)
    assert verdict.passed == passed
    assert float(verdict.found) == pytest.approx(factor, abs=1e-4)


@given(first=st.integers(-3, 10**9), count=st.integers(2, 60), data=st.data())
def test_one_sample_that_is_missing_or_twice_there_fails(first, count, data):
    numbers = list(range(first, first + count))
    last = numbers[-1]
    assert checks.telemetry("wrench", tally(*numbers), last).passed
    assert not checks.telemetry("wrench", tally(*numbers), last + 1).passed
    chosen = data.draw(st.integers(1, count - 1))
    missing = numbers[:chosen] + numbers[chosen + 1 :]
    assert not checks.telemetry("wrench", tally(*missing), last).passed
    twice = numbers[:chosen] + numbers[chosen - 1 :]
    assert not checks.telemetry("wrench", tally(*twice), last).passed


@pytest.mark.extended
def test_the_whole_runs_against_a_real_drill(process):
    """A short run cannot show the growth of memory, and a busy machine misses deadlines."""
    run = process("env", "-C", ROOT, sys.executable, "-m", "bench.soak", "--duration", "3")
    run.wait()
    rows = re.findall(r"^\| (ok|FAILED) +\| ([^|]+?) +\|", run.output, re.MULTILINE)
    verdicts = {name: verdict for verdict, name in rows}
    assert len(verdicts) == 13, run.output
    assert verdicts.pop("drill: growth of memory in the second half") == "FAILED"
    for name in ("deadlines missed", "real-time factor"):
        verdicts.pop(name)
    assert set(verdicts.values()) == {"ok"}, run.output
    assert run.wait() == 1
    run.wait_for_line(r"^soak: \d of 13 failed$")
