"""The rotor follows its closed form, stalls where theory says, and its works add up."""

import copy
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.drilling.rotor import Resistance, RotationParameters, Rotor

DRIVE = RotationParameters("friction_drive", 0.1, 15.0, 2e-6)  # N m, rad/s, kg m^2
TIME_CONSTANT = 2e-6 * 15.0 / 0.1  # s


def turn(seconds, torque=0.0, ratio=1.0, parameters=DRIVE, rotor=None):
    """Rotor after a step with a constant resistance."""
    rotor = rotor or Rotor(parameters)
    rotor.step(seconds, ratio, Resistance(cutting=torque))
    return rotor


@given(torque=st.floats(0.0, 0.2), ratio=st.floats(0.1, 2.0))
def test_the_steady_rate_lies_on_the_torque_speed_curve_and_the_slip_takes_the_rest(torque, ratio):
    rotor = turn(1.0, torque, ratio)
    state, (power, before) = rotor.state, rotor.draw
    expected = max(15.0 * (ratio - torque / 0.1), 0.0)
    assert state.rate == pytest.approx(expected, abs=1e-9)
    if expected > 1e-6:
        assert state.drive_torque == pytest.approx(torque, abs=1e-12)
    # The stack gives the torque of the drive at its own rate.
    assert power == pytest.approx(state.drive_torque * 15.0 * ratio, rel=1e-9, abs=1e-12)
    turn(2.0, torque, ratio, rotor=rotor)
    drawn = rotor.draw[1] - before
    assert drawn == pytest.approx(2.0 * power, rel=1e-9, abs=1e-9)
    lost = drawn - (rotor.state.work.drive - state.work.drive)
    slip = state.drive_torque * (15.0 * ratio - state.rate)
    assert lost == pytest.approx(2.0 * slip, rel=1e-6, abs=1e-9)


def test_it_stalls_at_the_exact_time():
    rotor = turn(1.0)
    # From w_0, with twice the stall torque the rate is w_0 (2 exp(-t/tau) - 1): zero at tau ln 2.
    before = copy.deepcopy(rotor)
    stop = TIME_CONSTANT * math.log(2.0)
    turn(stop * (1.0 - 1e-9), 0.2, rotor=before)
    assert 0.0 < before.state.rate < 1e-6
    angle = rotor.state.angle
    turn(stop * (1.0 + 1e-9), 0.2, rotor=rotor)
    assert (rotor.state.rate, rotor.state.stalled) == (0.0, True)
    turned = 15.0 * TIME_CONSTANT * (1.0 - math.log(2.0))
    assert rotor.state.angle - angle == pytest.approx(turned, rel=1e-9)


STEPS = st.lists(
    # length [s], amplitude ratio, torque [N m]
    st.tuples(st.floats(1e-5, 2e-3), st.floats(0.0, 2.0), st.floats(0.0, 0.3)),
    min_size=1,
    max_size=12,
)
PARAMETERS = st.builds(
    RotationParameters,
    rotation_model=st.just("friction_drive"),
    rotor_stall_torque=st.floats(0.01, 1.0),
    rotor_no_load_rate=st.floats(1.0, 100.0),
    rotor_inertia=st.floats(1e-7, 1e-3),
)


@given(STEPS, PARAMETERS, st.integers(2, 5))
def test_the_result_does_not_depend_on_how_the_time_is_divided(steps, parameters, pieces):
    whole, divided = Rotor(parameters), Rotor(parameters)
    for seconds, ratio, torque in steps:
        turn(seconds, torque, ratio, rotor=whole)
        for _ in range(pieces):
            turn(seconds / pieces, torque, ratio, rotor=divided)
        one, other = whole.state, divided.state
        assert one.rate == pytest.approx(other.rate, rel=1e-8, abs=1e-8)
        assert one.angle == pytest.approx(other.angle, rel=1e-8, abs=1e-12)
        for name in ("drawn", "drive", "cutting"):
            expected = getattr(other.work, name)
            assert getattr(one.work, name) == pytest.approx(expected, rel=1e-7, abs=1e-12)


@given(STEPS, PARAMETERS)
def test_the_works_add_up_and_nothing_comes_from_nowhere(steps, parameters):
    rotor, size = Rotor(parameters), 0.0
    for seconds, ratio, torque in steps:
        parts = Resistance(0.4 * torque, 0.3 * torque, 0.2 * torque, 0.1 * torque)
        angle = rotor.state.angle
        rotor.step(seconds, ratio, parts)
        work = rotor.state.work
        size += abs(work.drive) + work.resisted + work.kinetic
        assert abs(work.residual) <= 1e-11 * size + 1e-18
        assert rotor.state.rate >= 0.0
        assert rotor.state.angle >= angle
        assert work.drawn >= work.drive - 1e-12 * size
