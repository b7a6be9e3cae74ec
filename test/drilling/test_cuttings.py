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
ROOM = BIT.flute_area * DEPTH
TURN = 2.0 * math.pi
TURNED = st.floats(0.0, 50.0)


def collect(produced=1e-9, turned=TURN, impacts=0, depth=DEPTH, clearing=1.0, of=None):
    cuttings = of or Cuttings(BIT)
    cuttings.step(produced, turned, impacts, depth, clearing)
    return cuttings


def test_without_motion_all_stays_and_motion_and_better_flutes_carry_it_out():
    still = collect(turned=0.0).volume
    assert still == pytest.approx(1.8e-9)  # bulkier than the rock
    assert collect(turned=0.0, impacts=100).volume < still
    good = Cuttings(dataclasses.replace(BIT, flute_efficiency=0.6))
    assert collect(of=good).volume < collect().volume < still


def test_the_steady_volume_is_the_inflow_times_the_way_over_the_speed():
    cuttings = Cuttings(BIT)
    for _ in range(2000):
        collect(of=cuttings)
    speed = 0.3 * 0.01 / (1.0 + DEPTH / 0.1)  # m/s at one turn a second
    assert cuttings.volume == pytest.approx(1.8e-9 * DEPTH / speed, rel=1e-9)


@given(TURNED, st.integers(0, 500), st.integers(2, 20))
def test_it_does_not_depend_on_how_the_time_is_divided(turned, impacts, pieces):
    whole, divided = Cuttings(BIT), Cuttings(BIT)
    collect(1e-9, turned, impacts, of=whole)
    for _ in range(pieces):
        collect(1e-9 / pieces, turned / pieces, impacts / pieces, of=divided)
    assert whole.volume == pytest.approx(divided.volume, rel=1e-9)


@pytest.mark.parametrize(
    ("produced", "filling", "clearance"),
    [(0.5 * ROOM / 1.8, 0.5, 1.0), (0.75 * ROOM / 1.8, 0.75, 0.5), (1.0, 1.0, 0.0)],
)
def test_beyond_the_choke_the_flutes_hold_up_the_progress(produced, filling, clearance):
    cuttings = collect(produced, turned=0.0)
    assert cuttings.volume == pytest.approx(filling * ROOM)  # the flutes hold no more
    assert cuttings.filling(DEPTH) == pytest.approx(filling)
    assert cuttings.clearance(DEPTH) == pytest.approx(clearance)
    assert cuttings.torque(DEPTH) == pytest.approx(0.05 * DEPTH * filling)


def test_drawing_the_tool_back_takes_them_out():
    cuttings = collect()
    volume, twice = cuttings.volume, copy.deepcopy(cuttings)
    cuttings.withdraw(DEPTH, 0.02)
    assert cuttings.volume == pytest.approx(0.4 * volume)
    twice.withdraw(DEPTH, 0.03)
    twice.withdraw(0.03, 0.02)
    assert twice.volume == pytest.approx(cuttings.volume)
    cuttings.withdraw(0.02, 0.0)
    assert (cuttings.volume, cuttings.torque(0.0)) == (0.0, 0.0)
