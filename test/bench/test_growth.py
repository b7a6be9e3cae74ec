"""Growth: the exponent of a known curve is found, and a curve survives the file of results."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench import growth, lengths
from bench.growth import GOAL, Point, fit, points_of_rows, rows_of_points

AMOUNTS = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0, 1000.0)


def curve(cost, name="verify (s of bag)", noise=0.02, seed=5, repeats=3):
    random = np.random.default_rng(seed)
    return [
        Point(name, amount, cost(amount) * math.exp(random.normal(0.0, noise)))
        for _ in range(repeats)
        for amount in AMOUNTS
    ]


@given(exponent=st.floats(0.8, 2.0), start=st.floats(0.0, 3.0), factor=st.floats(0.1, 1.0))
def test_the_power_of_a_curve_is_found_beside_the_cost_of_starting(exponent, start, factor):
    found = fit(curve(lambda n: start + factor * n**exponent))

    assert found.value == pytest.approx(exponent, abs=0.15)
    assert found.low < found.value < found.high


def test_n_log_n_keeps_the_goal_and_a_square_does_not():
    assert GOAL.met(round(fit(curve(lambda n: 1.0 + 1e-3 * n * math.log(1e3 * n))).value, 2))
    assert not GOAL.met(fit(curve(lambda n: 2.0 + 1e-4 * n * n)).value)


@given(start=st.floats(0.1, 10.0))
def test_a_cost_that_does_not_grow_has_no_power(start):
    assert fit(curve(lambda n: start)).value == pytest.approx(0.0, abs=0.05)


def test_one_amount_has_no_exponent():
    assert math.isnan(fit([Point("x", 1.0, 1.0), Point("x", 1.0, 2.0)]).value)


def test_points_survive_the_rows_that_are_kept():
    points = curve(lambda n: n) + curve(lambda n: 2.0 * n, "replay at 1x (messages)")

    rows = list(rows_of_points(points))

    assert sorted(points_of_rows(rows)) == sorted(points)
    assert {row.name for row in rows if row.goal} == {
        "growth of verify (s of bag): exponent",
        "growth of replay at 1x (messages): exponent",
    }


@pytest.mark.parametrize("error", [OSError("no disk"), KeyboardInterrupt()])
def test_what_was_measured_before_a_source_failed_is_not_lost(error, monkeypatch):
    def fails():
        yield from curve(lambda n: n)
        raise error

    monkeypatch.setattr(lengths, "growth", fails)
    monkeypatch.setattr(growth, "SOURCES", ("bench.lengths",))

    rows = []
    with pytest.raises((RuntimeError, KeyboardInterrupt)):  # noqa: PT012
        for each in growth.growth():
            rows.append(each)

    assert len(rows) == len(AMOUNTS) + 1
