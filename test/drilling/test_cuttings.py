"""Cuttings collect with depth, and rotation, impacts and retracting carry them out."""

import copy
import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.borehole import BitParameters, Cuttings

BIT = BitParameters()
DEPTH = 0.05  # m
TURN = 2.0 * math.pi


def collect(produced=1e-9, turned=TURN, impacts=0, depth=DEPTH, clearing=1.0, of=None):
    cuttings = of or Cuttings(BIT)
    cuttings.step(produced, turned, impacts, depth, clearing)
    return cuttings


def test_without_rotation_and_impacts_all_of_it_stays_and_is_bulkier_than_the_rock():
    assert collect(turned=0.0).volume == pytest.approx(1.8e-9)


def test_the_steady_volume_is_the_inflow_times_the_way_over_the_speed():
    cuttings = Cuttings(BIT)
    for _ in range(2000):
        collect(of=cuttings)
    speed = 0.3 * 0.01 / (1.0 + DEPTH / 0.1)  # m/s at one turn a second
    assert cuttings.volume == pytest.approx(1.8e-9 * DEPTH / speed, rel=1e-9)
    assert cuttings.filling(DEPTH) == pytest.approx(1.8e-9 / speed / BIT.flute_area, rel=1e-9)


@given(st.floats(0.0, 50.0), st.integers(0, 500), st.integers(2, 20))
def test_it_does_not_depend_on_how_the_time_is_divided(turned, impacts, pieces):
    whole, divided = Cuttings(BIT), Cuttings(BIT)
    collect(1e-9, turned, impacts, of=whole)
    for _ in range(pieces):
        collect(1e-9 / pieces, turned / pieces, impacts / pieces, of=divided)
    assert whole.volume == pytest.approx(divided.volume, rel=1e-9)


@given(
    st.floats(0.0, 50.0),
    st.floats(0.0, 50.0),
    st.floats(0.001, 1.0),
    st.floats(0.001, 1.0),
    st.floats(0.0, 1.0),
)
def test_rotation_clears_and_depth_chokes(turned, more, depth, deeper, clearing):
    slow, fast = sorted((turned, more))
    shallow, deep = sorted((depth, deeper))
    assert collect(turned=fast).volume <= collect(turned=slow).volume * (1.0 + 1e-12)
    less = collect(turned=slow, clearing=clearing).volume
    assert less >= collect(turned=slow).volume * (1.0 - 1e-12)
    # So long a step ends in the steady state.
    steady = [collect(1e-10, 1e6 * (turned + 0.1), depth=end) for end in (shallow, deep)]
    assert steady[0].filling(shallow) <= steady[1].filling(deep) * (1.0 + 1e-9)
    assert steady[0].torque(shallow) <= steady[1].torque(deep) * (1.0 + 1e-9)


@given(st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_clogged_flutes_are_fuller_and_resist_more(full, clogged):
    cuttings = Cuttings(BIT)
    cuttings.volume = full * BIT.flute_area * DEPTH
    filling = cuttings.filling(DEPTH, clogged)
    assert 1.0 - filling == pytest.approx((1.0 - full) * (1.0 - clogged), abs=1e-12)
    assert cuttings.clearance(DEPTH, clogged) <= cuttings.clearance(DEPTH)
    assert cuttings.torque(DEPTH, clogged) >= cuttings.torque(DEPTH)


def test_impacts_lift_them_too():
    assert collect(turned=0.0, impacts=100).volume < collect(turned=0.0).volume


def test_the_flutes_hold_no_more_than_their_volume():
    full = collect(produced=1.0, turned=0.0)
    assert full.volume == pytest.approx(BIT.flute_area * DEPTH)
    assert full.filling(DEPTH) == 1.0
    assert full.clearance(DEPTH) == 0.0
    assert full.torque(DEPTH) == pytest.approx(0.05 * DEPTH)


def test_up_to_the_choke_they_hold_nothing_up_and_half_full_flutes_resist_by_half():
    half = collect(produced=0.5 * BIT.flute_area * DEPTH / 1.8, turned=0.0)
    assert half.filling(DEPTH) == pytest.approx(0.5)
    assert half.clearance(DEPTH) == pytest.approx(1.0)
    assert half.torque(DEPTH) == pytest.approx(0.5 * 0.05 * DEPTH)
    three_quarters = collect(produced=0.75 * BIT.flute_area * DEPTH / 1.8, turned=0.0)
    assert three_quarters.clearance(DEPTH) == pytest.approx(0.5)


def test_drawing_the_tool_back_takes_them_out():
    cuttings = collect()
    once = copy.deepcopy(cuttings)
    volume = cuttings.volume
    cuttings.withdraw(DEPTH, 0.02)
    assert cuttings.volume == pytest.approx(0.4 * volume)
    once.withdraw(DEPTH, 0.03)
    once.withdraw(0.03, 0.02)
    assert once.volume == pytest.approx(cuttings.volume)
    cuttings.withdraw(0.02, 0.0)
    assert cuttings.volume == 0.0
    assert cuttings.torque(0.0) == 0.0


def test_with_more_efficient_flutes_there_are_fewer():
    good = Cuttings(dataclasses.replace(BIT, flute_efficiency=0.6))
    assert collect(of=good).volume < collect().volume
