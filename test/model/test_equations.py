"""The paper's equations against what they are derived from; test_mutations.py shows they bite.

Nothing here needs compiled kernels, so that a broken copy can be checked in a second.
"""

import numpy as np
import pytest
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
MODULUS, DENSITY = 1.96e11, 7.9e3
SPRING_RATES = MODULUS * AREAS / LENGTHS
SECTION_MASSES = DENSITY * AREAS * LENGTHS

# A contact as in Fig. 12: displacement [m], velocity [m/s], free mass, tool mass [kg], k [N/m], g
CONTACT = contact.UndisturbedContact(2e-6, 3.0, 5e-3, contact_models.EffectiveTool(6e-3, 4e7), 9.81)


def collide(contact_bit, **velocities):
    state = np.zeros(1, STATE).view(np.recarray)[0]
    for name, velocity in velocities.items():
        setattr(state, name, velocity)
    exchange_momentum(DRILL, state, contact_bit, turn_at(0.0))
    return state


def test_equation_6_keeps_momentum_and_returns_the_closing_velocity():
    before = {"v_np": 2.0, "v_fm": -1.5}  # without vibration the tip moves as the nodal plane
    after = collide(CONTACT_ACTUATOR, **before)

    momentum = DRILL.rpud_mass * before["v_np"] + DRILL.free_mass * before["v_fm"]
    assert DRILL.rpud_mass * after.v_np + DRILL.free_mass * after.v_fm == pytest.approx(momentum)
    assert after.v_fm - after.v_np == pytest.approx(0.8 * (before["v_np"] - before["v_fm"]))


def test_equation_13_keeps_momentum_and_returns_the_closing_velocity():
    before = {"v_fm": 4.0, "v_dt": -0.5}
    after = collide(CONTACT_DRILL_TOOL, **before)

    momentum = DRILL.free_mass * before["v_fm"] + DRILL.tool_mass * before["v_dt"]
    assert DRILL.free_mass * after.v_fm + DRILL.tool_mass * after.v_dt == pytest.approx(momentum)
    assert after.v_dt - after.v_fm == pytest.approx(0.6 * (before["v_fm"] - before["v_dt"]))


def test_equation_8_solves_equation_2():
    mass, spring_rate = 1.0, 2000.0
    damping = damping_coefficient(0.5, mass, spring_rate)
    start = (1e-3, -0.7)

    motion = free_vibration(oscillator(mass, damping, spring_rate), 0.0, *start)
    times = np.linspace(0.0, 0.2, 9)
    solved = solve_ivp(
        lambda _, state: (state[1], -(damping * state[1] + spring_rate * state[0]) / mass),
        (0.0, 0.2),
        start,
        t_eval=times,
        rtol=1e-10,
        atol=1e-12,
    )

    closed = np.array([decaying_part(motion, time) for time in times]).T
    np.testing.assert_allclose(closed, solved.y, rtol=1e-7, atol=1e-9)


def mode_shape(junction, section, share):
    """f of eq. (24) within a section, its value at the junction given."""
    return 1.0 - (1.0 - junction) * share if section == 0 else junction * (1.0 - share)


def section_energy(junction, section):
    """Integral of f^2 over a section, as a share of the section."""
    return quad(lambda share: mode_shape(junction, section, share) ** 2, 0.0, 1.0)[0]


def test_equation_22_is_the_kinetic_energy_of_its_two_mode_shapes():
    k_1, k_2 = SPRING_RATES
    printed, opposite = k_2 / (k_1 + k_2), k_1 / (k_1 + k_2)

    mass = contact_models.printed_tool(k_1, k_2, *SECTION_MASSES).mass

    expected = SECTION_MASSES[0] * section_energy(printed, 0)
    expected += SECTION_MASSES[1] * section_energy(opposite, 1)
    assert mass == pytest.approx(expected, rel=1e-9)


def test_equation_27_is_the_strain_energy_of_the_printed_mode_shape():
    k_1, k_2 = SPRING_RATES
    junction = k_2 / (k_1 + k_2)

    spring_rate = contact_models.printed_tool(k_1, k_2, *SECTION_MASSES).spring_rate

    assert spring_rate == pytest.approx(k_1 * (1.0 - junction) ** 2 + k_2 * junction**2, rel=1e-9)


def test_the_rayleigh_tool_is_one_mode_shape_throughout():
    k_1, k_2 = SPRING_RATES
    junction = k_1 / (k_1 + k_2)

    tool = contact_models.rayleigh_tool(k_1, k_2, *SECTION_MASSES)

    mass = sum(SECTION_MASSES[i] * section_energy(junction, i) for i in (0, 1))
    assert tool.mass == pytest.approx(mass, rel=1e-9)
    strain = k_1 * (1.0 - junction) ** 2 + k_2 * junction**2
    assert tool.spring_rate == pytest.approx(strain, rel=1e-9)


def solve_equation_31(stop, events=None):
    displacement, velocity, free_mass, (tool_mass, spring_rate), gravity = CONTACT

    def derivative(_, state):
        force = free_mass * gravity - spring_rate * state[0]
        return state[1], force / (free_mass + tool_mass)

    return solve_ivp(
        derivative,
        (0.0, stop),
        (displacement, velocity),
        rtol=1e-10,
        atol=1e-14,
        events=events,
        dense_output=True,
    )


def test_equation_36_solves_equation_31():
    _, _, free_mass, (tool_mass, spring_rate), gravity = CONTACT
    solved = solve_equation_31(8e-5)

    for time in np.linspace(0.0, 8e-5, 9):
        eta, acceleration = CONTACT.deformation(time)
        expected = solved.sol(time)[0]
        assert eta == pytest.approx(expected, abs=1e-12)
        force = free_mass * gravity - spring_rate * expected
        assert acceleration == pytest.approx(force / (free_mass + tool_mass), abs=1e-2)


def test_equation_39_is_when_the_deformation_returns():
    def returned(_, state):
        return state[0] - CONTACT.displacement

    returned.direction = -1
    solved = solve_equation_31(2e-4, events=returned)

    assert CONTACT.duration == pytest.approx(solved.t_events[0][0], rel=1e-8)
