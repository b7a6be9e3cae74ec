"""Each impact and sample counts in its segment alone, wherever the messages are cut."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.inspection.report import periods as module
from rpud_sim.inspection.report.account_rows import period_rows
from rpud_sim.inspection.report.changes import Change
from rpud_sim.inspection.report.drill_topics import Fault
from rpud_sim.inspection.report.periods import to_periods

CHANGES = [Change(-1.0, "a", "weight on bit 10 N"), Change(2.0, "b", "weight on bit 20 N")]
FAULTS = [
    Fault(1, "bias", "wrench", 1.0, 2.0, 3.0),
    Fault(2, "free_mass_jammed", "", 1.0, 5.0, None),
]


def test_segments_end_at_commands_and_faults_and_know_what_is_in_force():
    found = to_periods(CHANGES, FAULTS)
    found.end_at(8.0)
    assert [(period.begin, period.end, period.commands, period.faults) for period in found.all] == [
        (0.0, 2.0, "weight on bit 10 N", ""),
        (2.0, 3.0, "weight on bit 20 N", "bias wrench"),
        (3.0, 5.0, "weight on bit 20 N", ""),
        (5.0, 8.0, "weight on bit 20 N", "free_mass_jammed"),
    ]


def test_a_run_without_commands_and_faults_is_one_segment():
    [period] = to_periods([], []).all
    assert (period.begin, period.end) == (0.0, math.inf)
    assert period_rows(to_periods([], []))[0][2:5] == ("not known", "none", "0")


@given(st.lists(st.floats(0.0, 9.9), min_size=1, max_size=60), st.integers(1, 20))
def test_sums_are_those_of_the_segment_alone(times, size):
    times = np.sort(np.array(times))
    forces, energies = 100.0 + times, 0.5 * times
    found = to_periods(CHANGES, FAULTS)
    for start in range(0, len(times), size):
        part = slice(start, start + size)
        columns = {"peak_force": forces[part], "energy": energies[part]}
        found.add_impacts(columns, times[part])
        found.add_force(-forces[part], times[part])
    found.end_at(10.0)
    for period in found.all:
        inside = (times >= period.begin) & (times < period.end)
        assert period.impacts == period.reacting_force.count == np.count_nonzero(inside)
        assert period.energy == pytest.approx(energies[inside].sum())
        if inside.any():
            assert period.peak_force.mean == pytest.approx(forces[inside].mean())
            assert period.reacting_force.least == -forces[inside].max()
        steps = np.diff(times[inside])
        assert period.intervals == np.count_nonzero(steps > 0.0)
        assert period.spanned == pytest.approx(steps.sum())


def test_rates_and_power_are_those_of_the_intervals():
    [period] = to_periods([], []).all
    found = to_periods([], [])
    found.add_impacts({"peak_force": np.ones(5), "energy": np.full(5, 2.0)}, np.arange(5.0) * 0.1)
    found.end_at(100.0)
    [period] = found.all
    assert period.impact_rate == pytest.approx(10.0)
    assert period.power == pytest.approx(20.0)


def test_there_is_an_end_to_the_number_of_segments(monkeypatch):
    monkeypatch.setattr(module, "MOST_PERIODS", 3)
    found = to_periods([Change(float(t), "a", str(t)) for t in range(1, 9)], [])
    assert ([period.begin for period in found.all], found.unlisted) == ([0.0, 1.0, 2.0], 6)
    assert found.all[-1].end == math.inf
