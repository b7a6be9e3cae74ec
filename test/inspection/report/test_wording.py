"""Sentences have the numbers of their data, and name the moment of the greatest change."""

import numpy as np

from rpud_sim.inspection.report import wording
from rpud_sim.inspection.report.running_statistics import Distribution, Envelope
from rpud_sim.pages.plot import COMMAND, FAULT, GAP, Line, Mark

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


def test_without_marks_a_drift_is_named():
    text = said(TIMES + 1.0, [])
    assert "rises from" in text
    assert said(np.array([np.nan])) == "Force: no values."
    assert said(np.array([1.0])) == "Force over 60 s: between 0.001 and 0.001 kN, mean 0.001 kN."


def test_distributions_spectra_faults_lines_and_flows_have_their_numbers():
    values = Distribution()
    values.add(np.arange(1001.0))
    text = wording.of_distribution("Force", values, (1.0, "N"))
    assert text.startswith("Force of 1001 impacts: 90 % between 49.9 and 950.1 N")
    assert text.endswith("greatest 1000 N.")
    assert wording.of_distribution("Force", Distribution(), (1.0, "N")) == "Force: no values."
    frequencies = np.arange(1.0, 100.0)
    density = np.where(frequencies == 40.0, 5.0, 0.1)
    assert wording.of_spectrum("Tip", frequencies, density) == "Tip: most power near 40 Hz."
    assert wording.of_spectrum("Tip", np.empty(0), np.empty(0)) == "Tip: no power."
    lasting = [Mark(FAULT, float(n), "jam") for n in range(6)]
    assert wording.of_faults(MARKS) == "1 fault: bias from 45 s to 50 s."
    assert wording.of_faults(lasting).endswith("jam from 3 s on; and 2 more.")
    line = Line("tip", np.arange(3.0), np.array([-1.0, np.nan, 2.0]))
    assert wording.of_lines([line], "mm") == "Tip: between -1 and 2 mm."
    assert wording.of_flow({"a": 1.0, "b": 3.0}, {"rock": 4.0}) == (
        "4 W come in, most by b; 4 W go to: rock."
    )
    assert wording.of_flow({}, {}) == "No power flows."
