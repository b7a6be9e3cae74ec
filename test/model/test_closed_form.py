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
    oscillator,
    swing_at,
    swung_integral,
    time_to_zero_displacement,
    turn_at,
    vibration_of,
)


@given(st.floats(0.0, 1.0, exclude_max=True), st.floats(100.0, 2e5), st.floats(0.0, 0.01))
def test_the_vibration_is_that_of_the_paper_from_zero_to_zero(phase, frequency, duration):
    u_hv, v_hv = vibration_of(35e-6, frequency, turn_at(phase))
    assert u_hv == pytest.approx(35e-6 * math.sin(2 * math.pi * phase), abs=1e-18)
    speed = 2 * math.pi * frequency * 35e-6
    assert v_hv == pytest.approx(speed * math.cos(2 * math.pi * phase), abs=1e-14 * speed)
    advanced = advance_phase(phase, frequency, duration)
    assert 0.0 <= advanced <= 1.0
    away = abs(advanced - (phase + frequency * duration) % 1.0)
    assert min(away, 1.0 - away) < 1e-12
    time = time_to_zero_displacement(phase, frequency)
    assert 0.0 < time <= 0.5 / frequency
    assert abs(vibration_of(1.0, frequency, turn_at(phase + frequency * time))[0]) < 1e-14


@settings(max_examples=15)
@given(
    damping_ratio=st.floats(0.0, 0.99),
    mass=st.floats(0.01, 2.0),
    spring_rate=st.floats(100.0, 1e5),
    force=st.floats(-50.0, 50.0),
    in_phase=st.floats(-100.0, 100.0),
    velocity=st.floats(-3.0, 3.0),
)
def test_closed_form_solves_the_equation_of_motion(
    damping_ratio, mass, spring_rate, force, in_phase, velocity
):
    frequency, phase, start, time = 900.0, 0.3, 1e-3, 7e-3
    c = damping_coefficient(damping_ratio, mass, spring_rate)
    assert c == pytest.approx(2.0 * damping_ratio * math.sqrt(spring_rate * mass))
    body = oscillator(mass, c, spring_rate)
    drive = (force, in_phase, 7.0, frequency, turn_at(phase))
    motion = driven_vibration(body, *drive, start, velocity)

    def angle(t):
        return 2 * math.pi * (phase + frequency * t)

    def equation(t, y):
        push = force + in_phase * math.sin(angle(t)) + 7.0 * math.cos(angle(t))
        return y[1], (push - c * y[1] - spring_rate * y[0]) / mass

    solved = solve_ivp(
        equation, (0, time), (start, velocity), method="DOP853", rtol=1e-11, atol=1e-13
    )
    steady = motion.vibration_sine * math.sin(angle(time))
    steady += motion.vibration_cosine * math.cos(angle(time))
    found = motion.offset + decaying_part(motion, time)[0] + steady
    assert found == pytest.approx(solved.y[0, -1], abs=2e-10)


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
