"""A warm body follows the exponential of one heat capacity and one resistance."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.heat import WarmBody


def test_it_warms_to_the_power_times_the_resistance():
    body = WarmBody(10.0, 293.15)
    body.step(63.0, 4.7 * 63.0, 6.3)
    assert body.temperature == pytest.approx(293.15 + 47.0 * (1.0 - math.exp(-1.0)))
    body.step(1e4, 4.7e4, 6.3)
    assert body.temperature == pytest.approx(340.15)
    body.step(1e4, 0.0, 6.3)
    assert body.temperature == pytest.approx(293.15)


@given(st.floats(0.0, 100.0), st.floats(1e-3, 100.0), st.integers(2, 20))
def test_it_does_not_depend_on_how_the_time_is_divided(power, seconds, pieces):
    whole, divided = WarmBody(10.0, 300.0), WarmBody(10.0, 300.0)
    whole.step(seconds, power * seconds, 6.3)
    for _ in range(pieces):
        divided.step(seconds / pieces, power * seconds / pieces, 6.3)
    assert whole.temperature == pytest.approx(divided.temperature, rel=1e-12)


def test_what_comes_in_is_stored_or_lost():
    body = WarmBody(1e5, 300.0)  # hardly anything is lost
    body.step(1.0, 63.0, 6.3)
    assert body.temperature - 300.0 == pytest.approx(10.0, rel=1e-5)
