"""Vibration, bodies on springs and free flight: eqs. (1)-(3), (8)-(10) and (14)-(19)."""

import math

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from rpud_sim.model.closed_form import (
    advance_phase,
    damping_coefficient,
    decaying_derivatives,
    decaying_part,
    driven_vibration,
    free_vibration,
    harmonic_vibration,
    oscillator,
    reacting_force,
    swing_at,
    swung_integral,
    time_to_zero_displacement,
    turn_at,
)
from rpud_sim.model.segment import fall

PHASES = st.floats(0.0, 1.0, exclude_max=True)
FREQUENCIES = st.floats(100.0, 2e5)


@given(phase=PHASES)
def test_displacement_and_velocity_are_those_of_the_paper(phase):
    time = phase / 16000.0
    u_hv, v_hv = harmonic_vibration(35e-6, 16000.0, phase)
    assert u_hv == pytest.approx(35e-6 * math.sin(2 * math.pi * 16000 * time), abs=1e-18)
    speed = 2 * math.pi * 16000 * 35e-6
    assert v_hv == pytest.approx(speed * math.cos(2 * math.pi * 16000 * time), abs=1e-13)


@given(phase=PHASES, frequency=FREQUENCIES, duration=st.floats(0.0, 0.01))
def test_phase_stays_within_a_cycle(phase, frequency, duration):
    advanced = advance_phase(phase, frequency, duration)
    assert 0.0 <= advanced <= 1.0
    cycles = (phase + frequency * duration) % 1.0
    assert min(abs(advanced - cycles), 1.0 - abs(advanced - cycles)) < 1e-12


@given(phase=PHASES, frequency=FREQUENCIES)
def test_next_zero_comes_within_half_a_cycle(phase, frequency):
    time = time_to_zero_displacement(phase, frequency)
    assert 0.0 < time <= 0.5 / frequency
    u_hv, _ = harmonic_vibration(1.0, frequency, phase + frequency * time)
    assert abs(u_hv) < 1e-14


def position(motion, frequency, phase, time):
    displacement, _ = decaying_part(motion, time)
    angle = 2 * math.pi * (phase + frequency * time)
    steady = motion.vibration_sine * math.sin(angle) + motion.vibration_cosine * math.cos(angle)
    return motion.offset + displacement + steady


@settings(max_examples=15)
@given(
    damping_ratio=st.floats(0.0, 0.99),
    mass=st.floats(0.01, 2.0),
    spring_rate=st.floats(100.0, 1e5),
    force=st.floats(-50.0, 50.0),
    vibration_force=st.floats(-100.0, 100.0),
    velocity=st.floats(-3.0, 3.0),
)
def test_closed_form_solves_the_equation_of_motion(
    damping_ratio, mass, spring_rate, force, vibration_force, velocity
):
    frequency, phase, start, time = 900.0, 0.3, 1e-3, 7e-3
    c = damping_coefficient(damping_ratio, mass, spring_rate)

    motion = driven_vibration(
        oscillator(mass, c, spring_rate),
        force,
        vibration_force,
        7.0,
        frequency,
        turn_at(phase),
        start,
        velocity,
    )

    def equation(t, y):
        phi = 2 * math.pi * (phase + frequency * t)
        push = force + vibration_force * math.sin(phi) + 7.0 * math.cos(phi)
        return y[1], (push - c * y[1] - spring_rate * y[0]) / mass

    solution = solve_ivp(
        equation, (0, time), (start, velocity), method="DOP853", rtol=1e-11, atol=1e-13
    )
    assert position(motion, frequency, phase, time) == pytest.approx(solution.y[0, -1], abs=2e-10)


def test_damping_is_the_ratio_to_the_critical_one():
    assert damping_coefficient(0.5, 1.0, 2000.0) == pytest.approx(math.sqrt(2000.0))


def test_velocity_derivatives_and_integral_agree_with_the_displacement():
    motion = free_vibration(oscillator(0.5, 12.0, 3000.0), 10.0, -1e-3, 0.4)
    time, step = 3e-3, 1e-5

    def displacement(t):
        return decaying_part(motion, t)[0]

    x, v = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, x, v)
    before, after = displacement(time - step), displacement(time + step)
    assert v == pytest.approx((after - before) / (2 * step), rel=1e-5)
    assert acceleration == pytest.approx((after - 2 * x + before) / step**2, rel=1e-5)
    far = displacement(time + 2 * step) - displacement(time - 2 * step)
    assert jerk == pytest.approx((far - 2 * (after - before)) / (2 * step**3), rel=1e-3)
    swing = swing_at(motion.decay_rate, motion.angular_frequency, time)
    assert swung_integral(motion, swing) == pytest.approx(quad(displacement, 0, time)[0])


def test_reacting_force_at_rest_is_the_weight_on_bit():
    assert reacting_force(10.0, 2000.0, 44.7, 0.0, 0.0) == 10.0
    assert reacting_force(0.0, 2000.0, 40.0, -1e-3, -0.1) == pytest.approx(6.0)


@pytest.mark.parametrize("gravity", [0.0, 1.62, 9.81])
def test_fall_solves_the_equation_of_motion(gravity):
    solution = solve_ivp(
        lambda _, y: (y[1], gravity), (0, 0.3), (-0.01, -2.0), rtol=1e-12, atol=1e-14
    )
    assert fall(-0.01, -2.0, gravity, 0.3) == pytest.approx(solution.y[:, -1], rel=1e-11)
