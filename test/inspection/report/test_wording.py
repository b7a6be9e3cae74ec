"""Sentences have the numbers of their data, and name the moment of the greatest change."""

import numpy as np

from rpud_sim.inspection.report import wording
from rpud_sim.inspection.report.running_statistics import Distribution, Envelope
from rpud_sim.pages.plot import COMMAND, FAULT, GAP, Mark

MARKS = [
    Mark(COMMAND, 31.0, "weight on bit 5 N"),
    Mark(FAULT, 45.0, "bias", 50.0),
    Mark(GAP, 10.0, "missing", 11.0),
]
TIMES = np.arange(0.0, 60.0, 0.01)


def said(values, marks=MARKS):
    distribution, envelope = Distribution(), Envelope(60.0)
    distribution.add(values)
    valid = np.isfinite(values)
    envelope.add(TIMES[: len(values)][valid], values[valid])
    return wording.over_time("Force", distribution, envelope, (1e-3, "kN"), 60.0, marks)


def test_the_greatest_change_is_named_with_its_reason():
    values = np.where(TIMES < 31.0, 2000.0, 800.0) + np.sin(1e3 * TIMES)
    assert said(values) == (
        "Force over 60 s: between 0.799 and 2.001 kN, mean 1.42 kN; "
        "its mean falls from 2 to 0.8 kN at 31 s, with the command weight on bit 5 N."
    )
    jump = np.where((TIMES >= 45.0) & (TIMES < 50.0), 2000.0, 800.0)
    assert "rises from 0.8 to 2 kN at 45 s, when the fault bias begins" in said(jump)


def test_chance_and_small_changes_are_no_words():
    noise = np.random.default_rng(1).normal(1000.0, 300.0, len(TIMES))
    assert said(noise).endswith(" kN.")
    assert "its mean" not in said(noise)
    assert "its mean" not in said(np.where(TIMES < 31.0, 1000.0, 1050.0))
