"""The energy account of segments, against quadrature, and what it finds in a broken trajectory."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from rpud_sim.model import energy, integrals, tally
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import preset
from rpud_sim.model.segment import IMPACT, motion_at

RPUD = energy.RpudConstants(1.0, False, 0.0)
ACTUATOR, DRILL_TOOL, BOTH = 1, 2, 3
INFLOWS = slice(0, energy.LOAD_DAMPER)


def trajectory(regime, seconds=0.3, phase=0.2, **changes):
    """Give segments from time zero on, and the last time."""
    engine = Engine(preset(regime).replace(**changes), phase)
    engine.advance(0, seconds)
    return engine.drain()[0].copy(), seconds


def account(segments, seconds):
    tallies = tally.empty_tallies(1)
    room = np.zeros(tally.CLASSES, np.int64), np.zeros(tally.PART_ROOM)
    nothing = np.empty(0, IMPACT)
    tally.add_block(RPUD, segments, nothing, (0, 0.0), (0, seconds), False, tallies, *room)
    return tallies[0]["account"]


def residual(joules):
    """Give what flowed in less what was lost and stored, as a share of what flowed."""
    flow = abs(joules).sum()
    return (joules[INFLOWS].sum() - joules[energy.LOAD_DAMPER :].sum()) / flow


@given(real=st.floats(-1e4, 0.0), imaginary=st.floats(-1e6, 1e6), duration=st.floats(1e-9, 1e-2))
def test_the_integral_of_an_exponential_is_exact_near_zero_too(real, imaginary, duration):
    rate = complex(real, imaginary)
    assume(abs(rate) * duration < 50.0)
    value = integrals.exponential_integral(rate, duration)
    if abs(rate) * duration < 1e-3:
        product = rate * duration
        expected = duration * (1.0 + product / 2.0 + product**2 / 6.0 + product**3 / 24.0)
    else:
        expected = (np.exp(rate * duration) - 1.0) / rate
    assert value == pytest.approx(expected, rel=1e-9)
    assert integrals.exponential_integral(0j, duration) == duration
    assert integrals.exponential_integral(complex(0.0, 1e-313), duration) == pytest.approx(duration)


def test_a_collision_loses_what_its_restitution_says():
    changes = {"actuator_restitution": 0.6, "drill_tool_restitution": 0.7, "gravity": 0.0}
    segments, end = trajectory("free", **changes)
    lost = []
    for before in segments[:-1][segments["event"][1:] == 2]:
        motion = motion_at(before, before["duration"])
        masses = before["free_mass"], before["drill_tool_mass"]
        reduced = masses[0] * masses[1] / sum(masses)
        lost.append(0.5 * reduced * (1.0 - 0.7**2) * (motion[5] - motion[7]) ** 2)
    assert len(lost) > 20
    assert account(segments, end)[energy.IMPACTS] == pytest.approx(sum(lost), rel=1e-6)


def test_in_the_rock_all_that_is_transferred_is_absorbed():
    engine = Engine(preset("drilling"), 0.2)
    engine.advance(2, 0.0)
    segments, impacts = engine.drain()
    joules = account(segments, 2.0)
    absorbed = joules[energy.IMPACTS] + joules[energy.RELEASE]
    assert impacts["energy_transferred"].sum() == pytest.approx(absorbed, rel=2e-3)
    assert absorbed < impacts["energy"].sum()


@pytest.mark.parametrize(
    ("field", "contact", "factor"),
    [
        ("load_spring_rate", 0, 1.0 - 1e-4),
        ("nodal_plane_sine", 0, 1.0 + 1e-3),
        ("drill_tool_sine", DRILL_TOOL, 1.0 + 1e-3),
        ("nodal_plane_decay_rate", 0, 1.0 - 1e-3),
    ],
)
def test_a_segment_that_breaks_its_equation_of_motion_shows(field, contact, factor):
    segments, end = trajectory("drilling", rpud_damping_ratio=0.9)
    assert abs(residual(account(segments, end))) < 1e-12
    number = np.flatnonzero((segments["contact"] == contact) & (segments["duration"] > 1e-6))[20]
    segments[field][number] *= factor
    assert abs(residual(account(segments, end))) > 1e-12
