"""The paper's equations against what they are derived from; test_mutations.py shows they bite.

Nothing here needs compiled kernels, so that a broken copy can be checked in a second.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad, solve_ivp

from rpud_sim.model import contact, contact_models
from rpud_sim.model.closed_form import (
    damping_coefficient,
    decaying_part,
    free_vibration,
    oscillator,
    turn_at,
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


def test_equation_8_solves_equation_2():
    mass, spring_rate, start = 1.0, 2000.0, (1e-3, -0.7)
    damping = damping_coefficient(0.5, mass, spring_rate)
    motion = free_vibration(oscillator(mass, damping, spring_rate), 0.0, *start)
    times = np.linspace(0.0, 0.2, 9)

    def equation(_, state):
        return state[1], -(damping * state[1] + spring_rate * state[0]) / mass

    solved = solve_ivp(equation, (0.0, 0.2), start, t_eval=times, rtol=1e-10, atol=1e-12)
    closed = np.array([decaying_part(motion, time) for time in times]).T
    np.testing.assert_allclose(closed, solved.y, rtol=1e-7, atol=1e-9)


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
    contact.UndisturbedContact,
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
    assert blow.greatest_force == pytest.approx(force)
    # Deformed as at the impact, and on the way back.
    back = (blow.displacement, -blow.velocity)
    assert solution(blow.duration) == pytest.approx(back, rel=1e-6, abs=1e-14)
