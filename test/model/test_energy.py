"""The energy account of segments, against quadrature, and what it finds in a broken trajectory."""

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.integrate import quad

from rpud_sim.model import energy, tally
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import preset
from rpud_sim.model.search import force_on_drill_tool
from rpud_sim.model.segment import IMPACT, motion_at, turns_at

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


# One segment of each contact, long enough for quadrature.
def segments_of_all_contacts():
    segments, _ = trajectory("drilling", rpud_damping_ratio=0.3, contact_model="rayleigh")
    pushed, _ = trajectory("drilling", weight_on_bit=500.0, gravity=0.0)
    free, _ = trajectory("free", weight_on_bit=300.0, actuator_restitution=0.1)
    found = {}
    for segment in np.concatenate([segments, pushed, free]):
        kept = found.get(int(segment["contact"]))
        if segment["duration"] > 1e-7 and (kept is None or segment["duration"] > kept["duration"]):
            found[int(segment["contact"])] = segment
    return found


CONTACTS = segments_of_all_contacts()


def integral(function, start, end):
    return quad(function, start, end, epsabs=0.0, epsrel=1e-10, limit=2000)[0]


def motion_added(segment, start, end):
    """Account of a part of a segment alone."""
    added = np.zeros(len(energy.TERMS))
    begun, ended = turns_at(segment, start), turns_at(segment, end)
    energy.add_motion(RPUD, segment, start, end, begun, ended, added)
    return added


@pytest.mark.parametrize("contact", [0, ACTUATOR, DRILL_TOOL, BOTH])
@pytest.mark.parametrize("share", [0.0, 0.4])
def test_the_dampers_take_the_integral_of_c_v_squared(contact, share):
    segment = CONTACTS[contact]
    end = min(segment["duration"], 5e-4)
    start = share * end
    added = motion_added(segment, start, end)
    for body, name, term in (
        (1, "load_spring_damping", energy.LOAD_DAMPER),
        (7, "drill_tool_damping", energy.DRILL_TOOL_DAMPER),
    ):
        expected = segment[name] * integral(
            lambda time, body=body: motion_at(segment, time)[body] ** 2, start, end
        )
        assert added[term] == pytest.approx(expected, rel=1e-7, abs=1e-18)


@pytest.mark.parametrize("contact", [0, ACTUATOR, DRILL_TOOL, BOTH])
def test_the_actuator_s_work_is_the_integral_of_its_force_and_the_vibration(contact):
    segment = CONTACTS[contact]
    end = min(segment["duration"], 2e-4)
    step = 1e-3 * end

    def force(time):
        """From the acceleration of the free mass, and the force on the drill tool."""
        ahead, behind = motion_at(segment, time + step)[5], motion_at(segment, time - step)[5]
        acceleration = (ahead - behind) / (2.0 * step)
        on_tool = force_on_drill_tool(segment, time)[0] if contact & DRILL_TOOL else 0.0
        return segment["free_mass"] * (acceleration - segment["gravity"]) + on_tool

    def power(time):
        phase = segment["vibration_phase"] + segment["vibration_frequency"] * time
        omega = 2.0 * np.pi * segment["vibration_frequency"]
        return force(time) * omega * segment["vibration_amplitude"] * np.cos(2.0 * np.pi * phase)

    expected = quad(power, 0.0, end, limit=500, epsrel=1e-7)[0] if contact & ACTUATOR else 0.0
    size = quad(lambda time: abs(power(time)), 0.0, end, limit=500, epsrel=1e-4)[0]
    work = motion_added(segment, 0.0, end)[energy.ACTUATOR_WORK]
    assert work == pytest.approx(expected, abs=1e-4 * size)


@given(real=st.floats(-1e4, 0.0), imaginary=st.floats(-1e6, 1e6), duration=st.floats(1e-9, 1e-2))
def test_the_integral_of_an_exponential_is_exact_near_zero_too(real, imaginary, duration):
    rate = complex(real, imaginary)
    assume(abs(rate) * duration < 50.0)
    value = energy.exponential_integral(rate, duration)
    if abs(rate) * duration < 1e-3:
        product = rate * duration
        expected = duration * (1.0 + product / 2.0 + product**2 / 6.0 + product**3 / 24.0)
    else:
        expected = (np.exp(rate * duration) - 1.0) / rate
    assert value == pytest.approx(expected, rel=1e-9)
    assert energy.exponential_integral(0j, duration) == duration
    assert energy.exponential_integral(complex(0.0, 1e-313), duration) == pytest.approx(duration)


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
