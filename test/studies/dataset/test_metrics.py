"""Metrics of detectors, on alarms that were made by hand."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.studies.dataset.metrics import RECOVERY, ScoredRun, choose_limit, evaluate, judge

ENDS = np.arange(1.0, 21.0)  # 20 windows of 1 s


def scored(alarms, **labels):
    """A run of 20 s with alarms in the windows that end at these seconds."""
    scores = np.zeros(len(ENDS))
    for end in alarms:
        scores[end == ENDS] = 1.0
    return ScoredRun(0.0, ENDS, scores, **labels)


def faulty(alarms, onset=9.5, clear=14.5):
    return scored(alarms, kind="choking", severity=1, onset=onset, clear=clear)


def test_the_first_alarm_in_a_fault_detects_it_and_its_delay_counts_from_the_onset():
    judged = judge(faulty([12, 14]), 0.5)
    assert judged.detected
    assert judged.delay == 12.0 - 9.5
    assert judged.false_alarms == 0


def test_windows_in_a_row_are_one_alarm():
    assert judge(scored([2, 3, 4, 8]), 0.5).false_alarms == 2


def test_an_alarm_that_was_raised_before_the_onset_detects_nothing():
    judged = judge(faulty([9, 10, 11, 12]), 0.5)
    assert not judged.detected
    assert judged.false_alarms == 1


def test_an_alarm_soon_after_a_fault_counts_neither_way_and_a_later_one_is_false():
    assert judge(faulty([15, 16]), 0.5).false_alarms == 0
    assert judge(faulty([17]), 0.5).false_alarms == 1
    assert not judge(faulty([15, 17]), 0.5).detected


def test_hours_are_those_in_which_an_alarm_would_be_false():
    assert judge(scored([]), 0.5).hours == pytest.approx(20.0 / 3600.0)
    assert judge(faulty([]), 0.5).hours == pytest.approx((20.0 - 5.0 - RECOVERY) / 3600.0)
    assert judge(faulty([], clear=math.inf), 0.5).hours == pytest.approx(9.5 / 3600.0)


def test_the_figures_of_hand_made_detections_are_those_of_the_definitions():
    runs = [faulty([10]), faulty([13, 14]), faulty([]), faulty([3, 12]), scored([5, 6, 9])]
    metrics = evaluate(runs, 0.5)
    assert (metrics.faults, metrics.detected, metrics.false_alarms) == (4, 3, 3)
    assert metrics.precision == 3 / 6
    assert metrics.recall == 3 / 4
    assert metrics.f1 == pytest.approx(2 * 0.5 * 0.75 / (0.5 + 0.75))
    assert metrics.delay_median == 2.5
    assert metrics.delay_greatest == 3.5
    hours = (4 * 13.0 + 20.0) / 3600.0
    assert metrics.hours == pytest.approx(hours)
    assert metrics.false_alarms_per_hour == pytest.approx(3 / hours)


def test_without_faults_or_detections_there_is_no_figure():
    metrics = evaluate([scored([])], 0.5)
    assert math.isnan(metrics.f1)
    assert math.isnan(metrics.recall)
    assert math.isnan(metrics.delay_median)
    assert evaluate([faulty([])], 0.5).f1 == 0.0


def test_missing_scores_raise_no_alarm():
    assert judge(ScoredRun(0.0, ENDS, np.full(20, np.nan)), 0.5).false_alarms == 0


def test_the_limit_separates_faults_from_healthy_windows():
    scores = np.where((ENDS > 9.5) & (ENDS < 14.5), 5.0, 1.0)
    scores[2] = 3.0
    run = ScoredRun(0.0, ENDS, scores, "choking", 1, 9.5, 14.5)
    assert 3.0 <= choose_limit([run]) < 5.0


@given(
    scores=st.lists(st.floats(0, 10), min_size=20, max_size=20),
    limit=st.floats(0, 10),
    onset=st.floats(0.0, 19.0),
    lasting=st.floats(0.1, 30.0),
)
def test_figures_stay_in_their_ranges(scores, limit, onset, lasting):
    run = ScoredRun(0.0, ENDS, np.array(scores), "choking", 1, onset, onset + lasting)
    judged = judge(run, limit)
    assert 0.0 <= judged.hours <= 20.0 / 3600.0
    assert math.isnan(judged.delay) or 0.0 <= judged.delay < lasting + 1e-9
    assert 0.0 <= evaluate([run], limit).f1 <= 1.0
