"""Baselines: what they find, and that they look at no later window."""

import importlib

import numpy as np
import pytest

from rpud_sim.studies.dataset import detectors, evaluation
from rpud_sim.studies.dataset.detectors import Changepoynt, Threshold

TRAINING = [np.column_stack([np.linspace(-1.0, 1.0, 50), np.full(50, 7.0)]) for _ in range(3)]


def fitted(detector):
    detector.fit(TRAINING)
    return detector


def test_a_threshold_counts_standard_deviations_of_the_farthest_feature():
    deviation = TRAINING[0][:, 0].std()
    scores = fitted(Threshold()).scores(np.array([[0.0, 7.0], [3.0 * deviation, 7.0]]))
    assert scores == pytest.approx([0.0, 3.0], abs=1e-12)


def test_a_feature_that_was_constant_in_training_does_not_count():
    assert fitted(Threshold()).scores(np.array([[0.0, 8.0]])) == pytest.approx([0.0], abs=1e-12)


def test_a_feature_that_is_missing_counts_where_it_never_was_in_training():
    score = fitted(Threshold()).scores(np.array([[np.nan, 7.0]]))
    assert score[0] > 1e6
    some = [np.array([[1.0], [np.nan], [2.0]])]
    detector = Threshold()
    detector.fit(some)
    assert detector.scores(np.array([[np.nan]])) == [0.0]


def test_a_baseline_that_is_not_installed_is_left_out_and_named(monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "changepoynt.algorithms.esst", None)
    found, left_out = evaluation.baselines()
    assert [detector.name for detector in found] == ["threshold"]
    assert left_out == [evaluation.MISSING]


class Sum:
    """Stand-in for ESST, of the same shape: sums, each at the middle of the windows it is of."""

    def __init__(self, window_length, scale):
        assert not scale
        self.length = 2 * window_length

    def covered_regions(self):
        return self.length, self.length

    def compute_offset(self):
        return self.length // 2

    def transform(self, series):
        scores = np.zeros(len(series))
        for last in range(self.length, len(series)):
            course = series[last - self.length : last]
            # As the package, a share of zero of zero for a course that does not vary.
            scores[last - self.length // 2] = np.ptp(course) if np.ptp(course) else np.nan
        return scores


@pytest.fixture(params=["stand-in", "changepoynt"])
def changepoynt(request, monkeypatch):
    if request.param == "changepoynt":
        request.getfixturevalue("optional_packages")
        # As Numba does by itself where it finds the package when it first compiles.
        importlib.import_module("rocket_fft")
    else:
        esst = type("Module", (), {"ESST": Sum})
        modules = __import__("sys").modules
        monkeypatch.setitem(modules, "changepoynt", type("Module", (), {"algorithms": None}))
        monkeypatch.setitem(modules, "changepoynt.algorithms", type("Module", (), {"esst": esst}))
        monkeypatch.setitem(modules, "changepoynt.algorithms.esst", esst)
    return Changepoynt()


def test_change_points_are_looked_for_in_counts_and_main_quantities(changepoynt):
    wanted = {
        "wrench.count": True,
        "wrench.wrench.force.z.mean": True,
        "wrench.wrench.force.x.mean": False,
        "wrench.wrench.force.z.max": False,
        "wrench.delay": False,
        "status.depth.mean": True,
        "status.depth.std": False,
    }
    assert {name: changepoynt.wants(name) for name in wanted} == wanted


def wave(count=60):
    return np.column_stack([np.sin(0.9 * np.arange(count)), np.full(count, 7.0)])


def test_a_change_has_a_greater_score_than_any_healthy_window(changepoynt):
    changepoynt.fit([wave(), wave()])
    assert changepoynt.scores(wave()).max() <= 1.0
    changed = wave(80)
    changed[50:, 0] += 1.5
    scores = changepoynt.scores(changed)
    assert scores[:50].max() <= 1.0 + 1e-9
    assert scores[50:].max() > 1.0


def test_a_course_that_does_not_vary_is_no_change(changepoynt):
    changepoynt.fit([wave()])
    flat = np.broadcast_to(wave()[:1], wave().shape).copy()
    scores = changepoynt.scores(np.concatenate([flat, flat]))
    assert np.isfinite(scores).all()
    assert scores[len(flat) :].max() < 1.0


def test_no_score_depends_on_a_later_window(changepoynt):
    changepoynt.fit([wave()])
    changed = wave(80)
    changed[50:, 0] = 2.0
    whole = changepoynt.scores(changed)
    for count in (30, 50, 55):
        assert changepoynt.scores(changed[:count]) == pytest.approx(whole[:count], abs=1e-12)


def test_equal_runs_have_equal_scores_and_the_global_random_numbers_stay(changepoynt):
    changepoynt.fit([wave()])
    before = np.random.get_state()[1].tolist()  # noqa: NPY002
    one, two = changepoynt.scores(wave()), changepoynt.scores(wave())
    assert one.tolist() == two.tolist()
    assert np.random.get_state()[1].tolist() == before  # noqa: NPY002


def test_a_run_that_is_too_short_has_no_score(changepoynt):
    changepoynt.fit([wave()])
    assert changepoynt.scores(wave(5)).tolist() == [0.0] * 5


def test_gaps_hold_the_value_before():
    held = detectors._held(np.array([np.nan, 1.0, np.nan, np.inf, 2.0]))
    assert held.tolist() == [0.0, 1.0, 1.0, 1.0, 2.0]
