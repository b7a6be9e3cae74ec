"""The paper's equations against what they are derived from; test_mutations.py shows they bite.

Nothing here needs compiled kernels, so that a broken copy is checked in seconds.
"""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from rpud_sim.model import contact, contact_models
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
from rpud_sim.model.drill import STATE, derive
from rpud_sim.model.parameters import preset
from rpud_sim.model.resets import exchange_momentum
from rpud_sim.model.segment import CONTACT_ACTUATOR, CONTACT_DRILL_TOOL

DRILL = derive(preset("free").replace(actuator_restitution=0.8, drill_tool_restitution=0.6))

# Table 2: sections of the drill tool [m, m^2], steel [Pa, kg/m^3]
LENGTHS = np.array([10e-3, 80e-3])
AREAS = np.array([7.8e-5, 2.0e-5])
K_1, K_2 = 1.96e11 * AREAS / LENGTHS  # eq. (20)
MASSES = 7.9e3 * AREAS * LENGTHS


def check_collision(contact_bit, masses, names, speeds, restitution):
    """Check that momentum is kept and the closing velocity returned."""
    state = np.zeros(1, STATE).view(np.recarray)[0]
    for name, speed in zip(names, speeds, strict=True):
        setattr(state, name, speed)
    exchange_momentum(DRILL, state, contact_bit, turn_at(0.0))
    after = [getattr(state, name) for name in names]
    assert np.dot(masses, after) == pytest.approx(np.dot(masses, speeds))
    assert after[1] - after[0] == pytest.approx(restitution * (speeds[0] - speeds[1]))


def test_equation_6_keeps_momentum_and_returns_the_closing_velocity():
    masses = DRILL.rpud_mass, DRILL.free_mass
    # Without vibration the tip moves as the nodal plane.
    check_collision(CONTACT_ACTUATOR, masses, ("v_np", "v_fm"), (2.0, -1.5), 0.8)


def test_equation_13_keeps_momentum_and_returns_the_closing_velocity():
    masses = DRILL.free_mass, DRILL.tool_mass
    check_collision(CONTACT_DRILL_TOOL, masses, ("v_fm", "v_dt"), (4.0, -0.5), 0.6)


@settings(max_examples=15, deadline=None)
@given(
    damping_ratio=st.floats(0.0, 0.99),
    mass=st.floats(0.01, 2.0),
    spring_rate=st.floats(100.0, 1e5),
    force=st.floats(-50.0, 50.0),
    in_phase=st.floats(-100.0, 100.0),
    velocity=st.floats(-3.0, 3.0),
)
def test_equation_8_solves_equation_2(damping_ratio, mass, spring_rate, force, in_phase, velocity):
    frequency, phase, start, time = 900.0, 0.3, 1e-3, 7e-3
    omega = 2.0 * math.pi * frequency
    c = damping_coefficient(damping_ratio, mass, spring_rate)
    assert c == pytest.approx(2.0 * damping_ratio * math.sqrt(spring_rate * mass))
    body = oscillator(mass, c, spring_rate)
    drive = (force, in_phase, 7.0, frequency, turn_at(phase))
    motion = driven_vibration(body, *drive, start, velocity)

    def angle(t):
        return 2.0 * math.pi * phase + omega * t

    def equation(t, y):
        push = force + in_phase * math.sin(angle(t)) + 7.0 * math.cos(angle(t))
        return y[1], (push - c * y[1] - spring_rate * y[0]) / mass

    solution = solve_ivp(
        equation, (0, time), (start, velocity), method="DOP853", rtol=1e-11, atol=1e-13
    )
    displacement, speed = decaying_part(motion, time)
    sine, cosine = math.sin(angle(time)), math.cos(angle(time))
    in_step, across = motion.vibration_sine, motion.vibration_cosine
    displacement += motion.offset + in_step * sine + across * cosine
    speed += omega * (in_step * cosine - across * sine)
    assert (displacement, speed) == pytest.approx(solution.y[:, -1], rel=1e-6, abs=2e-10)


@given(st.floats(0.0, 1.0, exclude_max=True), st.floats(100.0, 2e5), st.floats(0.0, 0.01))
def test_equation_1_is_the_vibration_from_zero_to_zero(phase, frequency, duration):
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


def test_derivatives_and_integral_agree_with_the_displacement():
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


def section_energy(junction, section):
    """Integral of f^2 of eq. (24) over a section, as a share of it; f at the junction is given."""

    def shape(share):
        return 1.0 - (1.0 - junction) * share if section == 0 else junction * (1.0 - share)

    return quad(lambda share: shape(share) ** 2, 0.0, 1.0)[0]


def strain_energy(junction):
    return K_1 * (1.0 - junction) ** 2 + K_2 * junction**2


PRINTED, OPPOSITE = K_2 / (K_1 + K_2), K_1 / (K_1 + K_2)


def test_equation_22_is_the_kinetic_energy_of_its_two_mode_shapes():
    mass = contact_models.printed_tool(K_1, K_2, *MASSES).mass
    energies = section_energy(PRINTED, 0), section_energy(OPPOSITE, 1)
    assert mass == pytest.approx(np.dot(MASSES, energies), rel=1e-9)


def test_equation_27_is_the_strain_energy_of_the_printed_mode_shape():
    spring_rate = contact_models.printed_tool(K_1, K_2, *MASSES).spring_rate
    assert spring_rate == pytest.approx(strain_energy(PRINTED), rel=1e-9)


def test_the_rayleigh_tool_is_one_mode_shape_throughout():
    tool = contact_models.rayleigh_tool(K_1, K_2, *MASSES)
    energies = [section_energy(OPPOSITE, i) for i in (0, 1)]
    assert tool.mass == pytest.approx(np.dot(MASSES, energies), rel=1e-9)
    assert tool.spring_rate == pytest.approx(strain_energy(OPPOSITE), rel=1e-9)


CONTACTS = st.builds(
    contact.Contact,
    st.floats(-1e-6, 2e-5),
    st.floats(0.05, 8.0),
    st.just(5e-3),
    st.builds(contact_models.EffectiveTool, st.floats(1e-3, 1e-2), st.floats(1e7, 1e8)),
    st.sampled_from([0.0, 1.62, 9.81]),
)


def solved(blow):
    """Solution of eq. (31), the acceleration that it has, and the times of its extremes."""

    def acceleration(eta):
        force = blow.free_mass * blow.gravity - blow.tool.spring_rate * eta
        return force / (blow.free_mass + blow.tool.mass)

    def turns(_, state):
        return state[1]

    turns.direction = -1
    found = solve_ivp(
        lambda _, state: (state[1], acceleration(state[0])),
        (0.0, 1.1 * blow.duration),
        (blow.displacement, blow.velocity),
        method="DOP853",
        rtol=1e-12,
        atol=1e-16,
        events=turns,
        dense_output=True,
    )
    return found.sol, acceleration, found.t_events[0]


@settings(max_examples=20, deadline=None)
@given(CONTACTS)
def test_equation_36_solves_equation_31(blow):
    solution, acceleration, _ = solved(blow)
    for time in np.linspace(0.0, blow.duration, 9):
        eta, eta_second = blow.deformation(time)
        assert eta == pytest.approx(solution(time)[0], abs=1e-14)
        assert eta_second == pytest.approx(acceleration(solution(time)[0]), rel=1e-7, abs=1e-3)
        # Eqs. (29) and (30) are two sides of one force.
        force = blow.free_mass * (blow.gravity - eta_second)
        other = blow.tool.mass * eta_second + blow.tool.spring_rate * eta
        assert force == pytest.approx(other, abs=1e-8)


@settings(max_examples=20, deadline=None)
@given(CONTACTS)
def test_equation_39_is_when_the_deformation_returns_and_38_the_first_maximum(blow):
    solution, _, (turning, *_) = solved(blow)
    assert blow.time_of_maximum == pytest.approx(turning, abs=1e-12)
    _, eta_second = blow.deformation(turning)
    force = blow.free_mass * (blow.gravity - eta_second)
    assert blow.peak_force == pytest.approx(force)
    # Deformed as at the impact, and on the way back.
    back = (blow.displacement, -blow.velocity)
    assert solution(blow.duration) == pytest.approx(back, rel=1e-6, abs=1e-14)


@given(CONTACTS)
def test_contact_is_left_when_its_force_returns_to_zero(blow):
    blow = blow._replace(displacement=0.0)
    rest = blow.free_mass * blow.gravity / blow.tool.spring_rate
    omega = math.sqrt(blow.tool.spring_rate / (blow.free_mass + blow.tool.mass))  # eq. (32)
    time = contact.release_time(-rest, blow.velocity / omega, omega, blow.gravity)
    _, acceleration = blow.deformation(time)
    force = blow.free_mass * (blow.gravity - acceleration)
    assert abs(force) < 1e-9 * blow.peak_force + 1e-11
    # Close to eq. (39), which ends the contact when the deformation is back at zero.
    assert time == pytest.approx(blow.duration, rel=1e-2)
    # A mass that only rests is not released.
    assert contact.release_time(1e-9, 0.0, 1e5, 9.81 + 10.0) == math.inf


@given(st.floats(1e-3, 0.1), st.floats(1e-3, 1.0), st.floats(0.0, 1.0), st.floats(1e-3, 10.0))
def test_half_sine_carries_the_impulse_of_the_collision(m_1, m_2, e, speed):
    peak, duration, impulse = contact.half_sine_impulse(m_1, m_2, e, speed, 1e8)
    assert impulse == pytest.approx((1 + e) * m_1 * m_2 / (m_1 + m_2) * speed)
    area = quad(lambda t: peak * math.sin(math.pi * t / duration), 0, duration)[0]
    assert area == pytest.approx(impulse)
