"""An arm's motion against an independent integration; its energies close."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from support import examples

from rpud_sim.drilling.arm import Arm, SpringLoad, arm_force, move_freely, move_rest_position

INTERVAL = 1e-3
arms = st.builds(
    Arm,
    st.one_of(st.just(0.0), st.floats(1e2, 1e6)),
    st.floats(1.0, 1e4),
    st.one_of(st.just(0.0), st.floats(1e-6, 1e-3)),
    st.floats(0.5, 200.0),
)
loads = st.builds(
    SpringLoad,
    st.floats(1e2, 1e5),
    st.one_of(st.just(0.0), st.floats(1.0, 1e3)),
    st.floats(-1e-2, 1e-2),
    st.floats(-30.0, 30.0),
)
places = st.floats(-1e-2, 1e-2)
shares = st.floats(-1.0, 1.0)  # of the arm's reach


def small(*energies):
    return 1e-9 * max(map(abs, (*energies, 1e-12))) + 1e-14


@given(arms, loads, places, shares, st.floats(0.0, 1.0))
@settings(max_examples=examples(150), deadline=None)
def test_a_drift_closes_its_account_and_has_two_parts(arm, load, rest, share, cut):
    start = rest + share * arm.reach
    moved = move_freely(arm, load, start, rest, INTERVAL)
    before = arm.stored(start - rest)
    given_up = before - arm.stored(moved.position - rest - moved.slipped)
    terms = (moved.damper, moved.slip, moved.work)
    assert given_up == pytest.approx(math.fsum(terms), abs=small(*terms, before))
    first = move_freely(arm, load, start, rest, cut * INTERVAL)
    second = move_freely(arm, load, first.position, rest + first.slipped, (1.0 - cut) * INTERVAL)
    size = max(abs(start), abs(moved.position), abs(rest), 1e-6)
    assert second.position == pytest.approx(moved.position, abs=1e-9 * size)


@given(arms, loads, places, shares, st.floats(-1e-3, 1e-3))
@settings(max_examples=examples(150), deadline=None)
def test_work_of_the_feed_is_stored_lost_or_works_on_the_drill(arm, load, rest, share, way):
    start = rest + share * arm.reach
    moved = move_rest_position(arm, load, start, rest, rest + way)
    deflection = moved.position - (rest + way + moved.slipped)
    stored = arm.stored(deflection) - arm.stored(start - rest)
    terms = (stored, moved.slip, moved.work)
    size = small(*terms, moved.shift_work, arm.stored(deflection))
    assert moved.shift_work == pytest.approx(math.fsum(terms), abs=size)
    assert abs(deflection) <= arm.reach * (1 + 1e-9) + 1e-15


@pytest.mark.parametrize("stiffness", [5e3, 2e5])
@pytest.mark.parametrize("play", [0.0, 2e-4])
@pytest.mark.parametrize("anchoring", [3.0, 100.0])
@pytest.mark.parametrize(("start", "damping"), [(-1e-3, 0.0), (4e-3, 300.0)])
def test_the_motion_is_that_of_a_numerical_integration(stiffness, play, anchoring, start, damping):
    arm = Arm(stiffness, 150.0, play, anchoring)
    load = SpringLoad(2000.0, damping, 1e-3, 1.5)
    rest = start - 0.7 * arm.reach

    def rate(_, state):
        elastic = min(max(stiffness * arm.stretch(state[0] - rest), -anchoring), anchoring)
        return [(-elastic - load.force(state[0])) / (arm.damping + damping)]

    found = solve_ivp(rate, (0.0, 0.02), [start], rtol=1e-10, atol=1e-13, max_step=1e-4)
    moved = move_freely(arm, load, start, rest, 0.02)
    assert moved.position == pytest.approx(found.y[0, -1], abs=1e-9)


def test_a_rigid_arm_carries_the_mount_until_its_host_slips():
    arm, load = Arm(0.0, 100.0, 0.0, 10.0), SpringLoad(2000.0, 0.0, 0.0, 0.0)
    moved = move_rest_position(arm, load, 0.004, 0.004, 0.006)
    # 10 N on 2000 N/m
    assert (moved.position, moved.slipped, moved.slip) == pytest.approx((0.005, -0.001, 0.01))
    assert arm_force(arm, load, moved.position, 0.006 + moved.slipped) == pytest.approx(10.0)
