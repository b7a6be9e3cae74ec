"""Rows stand beside their goals, commits are compared by turns, and the soak can fail."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from support import PATIENCE

from bench import soak
from bench.bare_timer import LATE, PERIOD, BareTimer
from bench.compare import ratio, verdict
from bench.soak import growth, pace
from bench.table import row, table
from bench.talk import Talk

ROOT = Path(__file__).resolve().parents[2]
SECONDS = np.arange(1801.0)


def test_a_table_shows_each_row_beside_its_goal():
    rows = [
        row("engine: speed over that of C", [1.4, 1.7, 1.6], least=1.5),
        row("engine: time", 1.2, "s", most=1.0),
        row("engine: events", 3.1e6, "1/s"),
    ]
    assert list(table(rows))[2:] == [
        "| engine: speed over that of C | 1.60 | 1.40 to 1.70 |  | >= 1.5 | yes |",
        "| engine: time | 1.20 |  | s | <= 1 | **no** |",
        "| engine: events | 3,100,000 |  | 1/s |  |  |",
    ]
    assert row("failed", float("nan"), most=1.0).missed


@pytest.mark.parametrize(
    ("factor", "word"), [(1.0, "no difference seen"), (1.2, "slower"), (0.8, "faster")]
)
def test_a_verdict_is_that_of_the_ratio_whatever_the_machine_does(factor, word):
    machine = 2.0 + np.arange(8) / 8  # it becomes slower as the times are taken
    spread = np.exp(np.random.default_rng(5).normal(0.0, 0.02, (8, 2)))
    pairs = [(m * a, m * b * factor) for m, (a, b) in zip(machine, spread, strict=True)]
    found = ratio(pairs)
    assert verdict(*found).startswith(f"{word}: ")
    assert found[0] == pytest.approx(factor, rel=0.03)


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
    assert (growth(SECONDS[: len(sizes)], sizes + noise) <= 1024.0) == passed


@pytest.mark.parametrize("processor", sorted(os.sched_getaffinity(0)))
def test_a_bare_timer_keeps_to_its_processor_and_counts_a_stop_of_it(processor):
    with BareTimer(0, processor) as timer:
        assert os.sched_getaffinity(timer.process.pid) == {processor}
        timer.process.send_signal(signal.SIGSTOP)
        time.sleep(2.0 * PERIOD)  # what the machine does to it
        timer.process.send_signal(signal.SIGCONT)
        assert timer.end()[LATE] >= 1


def test_the_pace_is_that_of_stamps_over_arrivals():
    elapsed = [second * 1_000_000_000 for second in range(30)]
    late = np.random.default_rng(5).integers(0, 2_000_000, 30)  # up to 2 ms on their way
    pairs = [
        (10**18 + round(1.0006 * at), at + int(d)) for at, d in zip(elapsed, late, strict=True)
    ]
    assert pace(pairs) == pytest.approx(1.0006, abs=1e-4)


@pytest.mark.extended
def test_a_short_soak_runs_and_cannot_tell_the_growth_of_memory():
    words = (sys.executable, "-m", "bench", "soak", "--seconds", "3")
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    rows = [line.split("|")[1:] for line in done.stdout.splitlines() if line.startswith("| soak")]
    met = {name.strip(): met.strip() for name, *_, met, _ in rows}
    assert met.pop("soak: growth of memory in the second half") == "**no**", done.stderr
    assert met.pop("soak: wakes of a bare timer late by half a period, worst processor") == ""
    for name in ("blocks late by a period", "real-time factor less one"):  # a busy machine
        met.pop(f"soak: {name}")
    assert met == dict.fromkeys(met, "yes"), done.stdout
    assert len(met) == 5
    assert done.returncode == 1


@pytest.mark.extended
def test_a_soak_takes_messages_until_the_drill_has_ended_however_long_its_timers_take(monkeypatch):
    drill_ended = threading.Event()

    class SlowTimer(BareTimer):
        def end(self):
            assert drill_ended.wait(PATIENCE)
            return super().end()

    class EndingTalk(Talk):
        def end(self):
            code = super().end()
            drill_ended.set()
            return code

    monkeypatch.setattr(soak, "BareTimer", SlowTimer)
    monkeypatch.setattr(soak, "Talk", EndingTalk)
    missed = [each.name for each in soak.soak(1.0) if each.missed]
    assert "soak: growth of memory in the second half" in missed
    assert "soak: impacts not received" not in missed
