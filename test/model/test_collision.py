"""Collisions, eqs. (4)-(7), (11)-(13) and (21)."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpud_sim.model.contact import collide, common_velocity

MASSES = st.floats(1e-4, 10.0)
VELOCITIES = st.floats(-20.0, 20.0)
RESTITUTIONS = st.floats(0.0, 1.0)


@given(MASSES, VELOCITIES, MASSES, VELOCITIES, RESTITUTIONS)
def test_momentum_restitution_and_energy(m_1, v_1, m_2, v_2, e):
    after_1, after_2 = collide(m_1, v_1, m_2, v_2, e)
    momentum = m_1 * abs(v_1) + m_2 * abs(v_2) + 1e-12
    assert m_1 * after_1 + m_2 * after_2 == pytest.approx(
        m_1 * v_1 + m_2 * v_2, abs=1e-13 * momentum
    )
    assert after_2 - after_1 == pytest.approx(e * (v_1 - v_2), abs=1e-12)
    before = m_1 * v_1**2 + m_2 * v_2**2
    after = m_1 * after_1**2 + m_2 * after_2**2
    lost = (1 - e**2) * m_1 * m_2 / (m_1 + m_2) * (v_1 - v_2) ** 2
    assert before - after == pytest.approx(lost, abs=1e-12 * (before + 1.0))


@given(MASSES, VELOCITIES, MASSES, VELOCITIES)
def test_bodies_that_go_on_together_have_the_common_velocity(m_1, v_1, m_2, v_2):
    together = collide(m_1, v_1, m_2, v_2, 0.0)
    assert together == pytest.approx([common_velocity(m_1, v_1, m_2, v_2)] * 2, abs=1e-12)
