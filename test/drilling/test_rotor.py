"""The rotor follows its closed form, stalls and slips where theory says, and its works add up."""

import copy
import dataclasses
import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from rpud_sim.drilling.inputs import UNDISTURBED, Disturbances
from rpud_sim.drilling.rotor import RotationParameters, Rotor
from rpud_sim.drilling.rotor_values import Resistance, RotorWork
from rpud_sim.foundation.quantities import ParameterError

DRIVE = RotationParameters(
    rotation_model="friction_drive",
    rotor_stall_torque=0.1,
    rotor_no_load_rate=15.0,
    rotor_inertia=2e-6,
    rotor_preload=1000.0,  # never slips unless a test says so
    rotor_breakaway_ratio=1.0,
)
TIME_CONSTANT = DRIVE.rotor_inertia * DRIVE.rotor_no_load_rate / DRIVE.rotor_stall_torque  # s


def turn(seconds, torque=0.0, ratio=1.0, parameters=DRIVE, rotor=None):
    """Rotor after a step with a constant resistance."""
    rotor = rotor or Rotor(parameters)
    rotor.step(seconds, ratio, Resistance(cutting=torque), UNDISTURBED)
    return rotor


def turning(rate_ratio=1.0, **changes):
    """Rotor that turns steadily without load."""
    parameters = dataclasses.replace(DRIVE, **changes)
    return turn(1.0, ratio=rate_ratio, parameters=parameters)


@given(torque=st.floats(0.0, 0.099), ratio=st.floats(0.1, 2.0))
def test_the_steady_rate_lies_on_the_torque_speed_curve(torque, ratio):
    state = turn(1.0, torque, ratio).state
    expected = max(DRIVE.rotor_no_load_rate * (ratio - torque / DRIVE.rotor_stall_torque), 0.0)
    assert state.rate == pytest.approx(expected, abs=1e-9)
    if expected > 1e-6:
        assert state.drive_torque == pytest.approx(torque, abs=1e-12)


def test_it_starts_with_the_time_constant_of_inertia_and_curve():
    state = turn(TIME_CONSTANT).state
    assert state.rate == pytest.approx(15.0 * (1.0 - math.exp(-1.0)), rel=1e-12)
    assert state.angle == pytest.approx(15.0 * TIME_CONSTANT * math.exp(-1.0), rel=1e-12)


def test_it_stalls_at_the_exact_time():
    rotor = turning()
    # From w_0, with twice the stall torque the rate is w_0 (2 exp(-t/tau) - 1): zero at tau ln 2.
    before = copy.deepcopy(rotor)
    stop = TIME_CONSTANT * math.log(2.0)
    turn(stop * (1.0 - 1e-9), 0.2, rotor=before)
    assert 0.0 < before.state.rate < 1e-6
    angle = rotor.state.angle
    turn(stop * (1.0 + 1e-9), 0.2, rotor=rotor)
    assert rotor.state.rate == 0.0
    assert rotor.state.stalled
    assert rotor.state.angle - angle == pytest.approx(
        15.0 * TIME_CONSTANT * (1.0 - math.log(2.0)), rel=1e-9
    )


def test_a_stalled_tool_is_held_by_what_the_drive_gives_and_starts_beyond_the_breakaway_torque():
    held = dataclasses.replace(DRIVE, rotor_breakaway_ratio=1.5)
    rotor = turn(1.0, 0.2, parameters=held)
    assert rotor.state.stalled
    assert rotor.state.torque == rotor.state.drive_torque == pytest.approx(0.1)
    turn(1.0, 0.1 / 1.5, rotor=rotor)
    assert rotor.state.stalled
    turn(1.0, 0.0666, rotor=rotor)
    assert rotor.state.rate > 0.0
    assert not rotor.state.stalled
    # While it turns, it takes more to stop it.
    turn(1.0, 0.09, rotor=rotor)
    assert rotor.state.rate > 0.0


def test_a_drive_that_is_off_is_not_stalled_and_brakes_the_rotor():
    rotor = turning()
    turn(1.0, 0.01, ratio=0.0, rotor=rotor)
    assert rotor.state.rate == 0.0
    assert not rotor.state.stalled
    assert rotor.state.torque == 0.0


def test_the_preload_limits_the_torque_of_the_drive():
    # mu F r = 0.03 N m: the rotor slips, with constant acceleration, until it follows the stack.
    weak = dataclasses.replace(DRIVE, rotor_preload=10.0)
    rotor = turn(1e-4, 0.01, parameters=weak)
    assert rotor.state.slipping
    assert rotor.state.drive_torque == pytest.approx(0.03)
    assert rotor.state.rate == pytest.approx(0.02 / 2e-6 * 1e-4)
    turn(1.0, 0.01, rotor=rotor)
    assert not rotor.state.slipping
    assert rotor.state.rate == pytest.approx(15.0 * 0.9)
    # It stalls at the grip, not at the stall torque, and uniformly.
    rotor = turn(5e-4, 0.04, rotor=rotor)
    assert rotor.state.slipping
    turn(1.0, 0.04, rotor=rotor)
    assert rotor.state.stalled
    assert rotor.state.torque == pytest.approx(0.03)


def test_without_preload_nothing_turns():
    assert turn(1.0, parameters=dataclasses.replace(DRIVE, rotor_preload=0.0)).state.angle == 0.0


STEPS = st.lists(
    st.tuples(
        st.floats(1e-5, 2e-3),  # length [s]
        st.floats(0.0, 2.0),  # amplitude ratio
        st.floats(0.0, 0.3),  # torque [N m]
    ),
    min_size=1,
    max_size=12,
)
PARAMETERS = st.builds(
    RotationParameters,
    rotation_model=st.just("friction_drive"),
    rotor_stall_torque=st.floats(0.01, 1.0),
    rotor_no_load_rate=st.floats(1.0, 100.0),
    rotor_inertia=st.floats(1e-7, 1e-3),
    rotor_preload=st.floats(0.0, 100.0),
    rotor_breakaway_ratio=st.floats(1.0, 3.0),
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
        for name in ("drive", "slip", "cutting"):
            expected = getattr(other.work, name)
            assert getattr(one.work, name) == pytest.approx(expected, rel=1e-7, abs=1e-12)


@given(STEPS, PARAMETERS)
def test_the_works_add_up_and_nothing_comes_from_nowhere(steps, parameters):
    rotor = Rotor(parameters)
    stack = 0.0  # work that the stack can give at most [J]
    for seconds, ratio, torque in steps:
        parts = Resistance(0.4 * torque, 0.3 * torque, 0.2 * torque, 0.1 * torque, True)
        slip = rotor.state.work.slip
        angle = rotor.state.angle
        rotor.step(seconds, ratio, parts, UNDISTURBED)
        work = rotor.state.work
        size = abs(work.drive) + abs(work.slip) + work.resisted + work.kinetic
        assert abs(work.residual) <= 1e-12 * size + 1e-18
        assert work.slip >= slip - 1e-12 * size
        assert rotor.state.rate >= 0.0
        assert rotor.state.angle >= angle
        stack += parameters.rotor_stall_torque * ratio**2 * parameters.rotor_no_load_rate * seconds
    assert rotor.state.work.drive + rotor.state.work.slip <= stack * (1.0 + 1e-9) + 1e-12


@settings(max_examples=20)
@given(PARAMETERS, st.floats(0.2, 2.0), st.floats(0.0, 0.5))
def test_it_agrees_with_a_numerical_integration(parameters, ratio, share):
    grip = 0.003 * parameters.rotor_preload
    stall = parameters.rotor_stall_torque
    torque = share * min(stall * ratio, grip)  # it turns

    def drive(rate):
        return min(max(stall * (ratio - rate / parameters.rotor_no_load_rate), -grip), grip)

    seconds = 5e-3
    found = solve_ivp(
        lambda _, motion: [motion[1], (drive(motion[1]) - torque) / parameters.rotor_inertia],
        (0.0, seconds),
        (0.0, 0.0),
        method="LSODA",
        rtol=1e-9,
        atol=1e-11,
    )
    state = turn(
        seconds,
        torque,
        ratio,
        dataclasses.replace(parameters, rotor_breakaway_ratio=1.0),
    ).state
    if grip > 0.0:
        assert state.angle == pytest.approx(found.y[0][-1], rel=1e-5, abs=1e-9)
        assert state.rate == pytest.approx(found.y[1][-1], rel=1e-5, abs=1e-6)


@given(st.floats(0.0, 0.2), st.floats(0.0, 0.2), st.floats(0.0, 2.0), st.floats(0.0, 2.0))
def test_more_torque_turns_less_and_more_amplitude_turns_more(torque, other, ratio, more):
    low, high = sorted((torque, other))
    assert turn(1e-3, low, ratio).state.angle >= turn(1e-3, high, ratio).state.angle - 1e-15
    small, large = sorted((ratio, more))
    assert turn(1e-3, low, large).state.angle >= turn(1e-3, low, small).state.angle - 1e-15


def test_gravel_resists_once_in_its_period_and_in_a_hole_alone():
    gravel = Disturbances(gravel_torque=0.02, gravel_period=math.pi)
    rotor, torques, angles = Rotor(DRIVE), [], []
    for _ in range(2000):
        angles.append(rotor.state.angle)
        torques.append(rotor.step(1e-3, 1.0, Resistance(in_hole=True), gravel).torque)
    assert min(torques) < 1e-4
    assert max(torques) == pytest.approx(0.02, rel=1e-3)
    peaks = [
        angle
        for angle, before, now, after in zip(
            angles[1:], torques, torques[1:], torques[2:], strict=False
        )
        if before < now >= after
    ]
    assert len(peaks) >= 3
    assert peaks == pytest.approx([math.pi * (n + 0.5) for n in range(len(peaks))], abs=0.02)
    assert rotor.state.work.faults > 0.0
    assert Rotor(DRIVE).step(1e-3, 1.0, Resistance(), gravel).torque == 0.0


def test_the_account_by_name_has_all_terms_and_the_residual():
    work = turn(1.0, 0.05).state.work
    account = work.to_dict()
    assert account.pop("residual") == work.residual
    assert RotorWork(**account) == work


def test_a_new_rotor_is_at_rest_and_has_done_no_work():
    state = Rotor(DRIVE).state
    assert (state.angle, state.rate, state.work) == (0.0, 0.0, RotorWork())


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("rotor_inertia", 0.0, r"rotor_inertia = 0 kg m\^2 is outside its range \[1e-12, 1\] kg m"),
        ("rotor_stall_torque", math.nan, r"rotor_stall_torque = nan N m is outside"),
        ("rotor_preload", -1.0, r"rotor_preload = -1 N is outside its range \[0, 10000\] N"),
    ],
)
def test_a_value_outside_its_range_is_refused(name, value, said):
    with pytest.raises(ParameterError, match=said):
        RotationParameters(**{name: value})
