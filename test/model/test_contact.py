"""The contact in the rock and its release, against quadrature and the engine."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from rpud_sim.model import contact, contact_models
from rpud_sim.model.contact import effective_tool, single_contact
from rpud_sim.model.contact_models import CONTACT_MODELS
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import preset

FREE_MASS = 5e-3
DRILLING = preset("drilling")
K_1 = 1.96e11 * 7.8e-5 / 10e-3  # eq. (20)
K_2 = 1.96e11 * 2.0e-5 / 80e-3
M_1 = 7.9e3 * 7.8e-5 * 10e-3
M_2 = 7.9e3 * 2.0e-5 * 80e-3


@pytest.mark.parametrize("model", ["printed", "rayleigh"])
def test_the_parameter_chooses_the_model(model):
    tool = effective_tool(DRILLING.replace(contact_model=model))
    law = getattr(contact_models, f"{model}_tool")
    assert tool == pytest.approx(law(K_1, K_2, M_1, M_2))


@given(velocity=st.floats(0.01, 10.0), gravity=st.floats(0.0, 20.0))
def test_contact_is_left_when_its_force_returns_to_zero(velocity, gravity):
    tool = effective_tool(DRILLING)
    rest = FREE_MASS * gravity / tool.spring_rate
    blow = contact.UndisturbedContact(0.0, velocity, FREE_MASS, tool, gravity)
    omega = blow.angular_frequency
    time = contact.release_time(-rest, velocity / omega, omega, gravity)
    _, acceleration = blow.deformation(time)
    greatest = blow.greatest_force
    assert abs(FREE_MASS * (gravity - acceleration)) < 1e-9 * greatest + 1e-11
    # Close to eq. (39), which ends the contact when the deformation is back at zero.
    assert time == pytest.approx(blow.duration, rel=1e-2)


def test_a_mass_that_only_rests_is_not_released():
    assert contact.release_time(1e-9, 0.0, 1e5, 9.81 + 10.0) == math.inf


@given(st.floats(1e-3, 0.1), st.floats(1e-3, 1.0), st.floats(0.0, 1.0), st.floats(1e-3, 10.0))
def test_half_sine_carries_the_impulse_of_the_collision(m_1, m_2, e, speed):
    peak, duration, impulse = contact.half_sine_impulse(m_1, m_2, e, speed, 1e8)
    assert impulse == pytest.approx((1 + e) * m_1 * m_2 / (m_1 + m_2) * speed)
    assert quad(lambda t: peak * math.sin(math.pi * t / duration), 0, duration)[0] == pytest.approx(
        impulse
    )


@pytest.mark.parametrize("model", CONTACT_MODELS)
def test_an_undisturbed_impact_of_the_engine_is_a_single_contact(model):
    """Eqs. (21) and (36)-(39) against what the engine does with the same blow."""
    parameters = preset("drilling").replace(contact_model=model, gravity=0.0)
    engine = Engine(parameters, 0.2)
    engine.advance(5, 0.0)
    impacts = engine.drain()[1][1:]  # the first one is the start, the actuator upon the free mass
    velocities = impacts["impact_velocity"]
    contacts = [single_contact(parameters, float(velocity)) for velocity in velocities]
    durations = np.array([contact.duration for contact in contacts])
    alone = np.abs(impacts["contact_duration"] / durations - 1.0) < 1e-6
    assert np.count_nonzero(alone) > 0.5 * len(impacts)
    energies = 0.5 * FREE_MASS * velocities**2
    assert impacts["energy"][alone] == pytest.approx(energies[alone])
    forces = np.array([contact.peak_force for contact in contacts])
    assert impacts["peak_force"][alone] == pytest.approx(forces[alone], rel=1e-6)
    # What the mass brought, and what the tool's elasticity gave it back.
    together = FREE_MASS / (FREE_MASS + contacts[0].tool_mass)
    impulses = FREE_MASS * (1.0 + together) * velocities
    assert impacts["impulse"][alone] == pytest.approx(impulses[alone], rel=1e-3)
