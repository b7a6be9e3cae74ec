"""No event is missed and none is late: against a dense search in independent closed forms."""

import math
from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq
from support import MANY_EXAMPLES, examples, extended
from trajectories import DRILL_TOOL, FREE_MASS, TIP, finished, gap, motion

from rpud_sim.model.closed_form import turn_at
from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.parameters import preset
from rpud_sim.model.segment import SEGMENT
from rpud_sim.model.strike import first_landing, first_strike
from rpud_sim.model.tolerances import LONGEST_SEARCH, TIME_RESOLUTION, TOUCHING, WEAKEST_PULL

SAMPLES_PER_CYCLE = 40
CASES = {
    "free": ("free", {}),
    "free, lossy": ("free", {"actuator_restitution": 0.6, "drill_tool_restitution": 0.3}),
    "free, pressed": ("free", {"weight_on_bit": 50.0, "actuator_restitution": 0.2}),
    "free, no gravity": ("free", {"gravity": 0.0, "weight_on_bit": 3.0}),
    "drilling": ("drilling", {}),
    "drilling, rayleigh": ("drilling", {"contact_model": "rayleigh", "free_mass": 0.02}),
    "drilling, pressed": ("drilling", {"weight_on_bit": 200.0, "actuator_restitution": 0.5}),
    "drilling, grazing": ("drilling", {"vibration_amplitude": 2e-6, "weight_on_bit": 40.0}),
    "drilling, sticky": ("drilling", {"actuator_restitution": 0.0, "gravity": 1.62}),
}

MAIN = ("free", "drilling", "drilling, sticky")


def force_on_tool(drill, segment, times):
    """Force of the contact of free mass and drill tool, from the motion alone."""
    if segment["contact"] == 2:
        return drill.free_mass * (drill.gravity - motion(segment, FREE_MASS, times, 2))
    u, v, a = (motion(segment, DRILL_TOOL, times, order) for order in range(3))
    return drill.tool_mass * a + drill.tool_damping * v + drill.tool_spring_rate * u


def force_on_tip(drill, segment, times):
    """Force of the contact of actuator and free mass, from the motion alone."""
    force = drill.free_mass * (motion(segment, FREE_MASS, times, 2) - drill.gravity)
    if segment["contact"] == 3:
        force = force + force_on_tool(drill, segment, times)
    return force


def guards_of(drill, segment):
    """What must not be negative during a segment, by name, and by how much it may be."""
    contact = int(segment["contact"])
    if contact & 1:
        yield "tip force", lambda t: force_on_tip(drill, segment, t), 2 * WEAKEST_PULL
    else:
        yield "tip gap", lambda t: gap(segment, FREE_MASS, TIP, t), 1.01 * TOUCHING
    if contact & 2:
        yield "tool force", lambda t: force_on_tool(drill, segment, t), 2 * WEAKEST_PULL
    else:
        yield "tool gap", lambda t: gap(segment, DRILL_TOOL, FREE_MASS, t), 1.01 * TOUCHING


# Parts of a dip in each step to its bottom, and steps until it is a billion times narrower.
PARTS = 8
NARROWINGS = 15


def lowest(function, duration, samples):
    """Least value between 0 and the duration: all dips together are followed to their bottoms."""
    times = np.linspace(0.0, duration, samples)
    values = function(times)
    least = values.min()
    before, inner, after = values[:-2], values[1:-1], values[2:]
    scale = np.maximum(before, after) - inner
    # Others cannot come near zero between the samples.
    dips = (inner <= before) & (inner < after) & (inner <= 10.0 * scale)
    start, step = times[:-2][dips], 2.0 * (times[1] - times[0]) / PARTS
    for _ in range(NARROWINGS if dips.any() else 0):
        between = function(start[:, None] + step * np.arange(PARTS + 1))
        least = min(least, between.min())
        start = start + step * np.clip(between.argmin(axis=1) - 1, 0, PARTS - 2)
        step *= 2.0 / PARTS
    return least


def trajectory(regime, changes):
    parameters = preset(regime).replace(**changes)
    engine = Engine(parameters, 0.37)
    engine.advance(0, 0.25)
    segments, _ = finished(engine)
    return derive(parameters), segments


@pytest.mark.parametrize("case", CASES)
def test_no_guard_is_negative_before_the_event(case):
    drill, segments = trajectory(*CASES[case])
    assert len(segments) > 25
    for segment in segments[:: max(1, len(segments) // 150)]:
        cycles = segment["duration"] * max(
            segment["vibration_frequency"], segment["drill_tool_angular_frequency"] / 6.0
        )
        samples = 64 + int(SAMPLES_PER_CYCLE * cycles)
        for name, guard, allowed in guards_of(drill, segment):
            assert lowest(guard, segment["duration"], samples) > -allowed, name


@pytest.mark.parametrize("case", [*MAIN, *(extended(each) for each in CASES if each not in MAIN)])
def test_impacts_are_exact_to_a_picosecond(case):
    _, segments = trajectory(*CASES[case])
    checked = 0
    for segment, after in pairwise(segments[: 5000 if MANY_EXAMPLES else 1000]):
        end = segment["duration"]
        for front, back in ((FREE_MASS, TIP), (DRILL_TOOL, FREE_MASS)):
            distance = gap(segment, front, back, end)
            closing = -gap(segment, front, back, end, 1)
            # A pair that has been well apart and meets with some speed.
            apart = gap(segment, front, back, np.linspace(0.0, end, 50)).max() > 1e-9
            if not (apart and closing > 0.01 and abs(distance) < 1e-11):
                continue
            assert int(after["event"]) & 3
            span = min(1e-9, 0.5 * end)
            root = brentq(
                lambda t, s=segment, f=front, b=back: float(gap(s, f, b, t)),
                end - span,
                end + span,
                xtol=1e-18,
            )
            assert abs(root - end) < 1e-12
            checked += 1
    assert checked > 25


def hanging_mass(clearance, **fields):
    """Make a segment in which the mass hangs by a clearance ahead of a vibrating tip."""
    segment = np.zeros(1, SEGMENT).view(np.recarray)[0]
    fields = {
        "vibration_frequency": 16000.0,
        "vibration_amplitude": 35e-6,
        "vibration_phase": 0.9,
        "nodal_plane_angular_frequency": 40.0,
        "free_mass_position": 35e-6 + clearance,
        "duration": 2e-4,
        **fields,
    }
    for name, value in fields.items():
        segment[name] = value
    return segment


def strike_of(segment, limit):
    time, struck, _ = first_strike(segment, limit, turn_at(segment.vibration_phase))
    return time, struck


def check_meeting(found, limit, guard, samples):
    """Check that a guard stays positive until it is found to end, and ends there."""
    time, met, steps = found
    assert lowest(guard, time, samples) > -1.01 * TOUCHING
    if met:
        assert float(guard(time)) < 1e-14 + TIME_RESOLUTION * abs(float(guard(time, 1)))
    else:
        assert time == limit or steps == LONGEST_SEARCH


FLYING = {
    "free_mass_velocity": st.floats(-10.0, 10.0),
    "free_mass_acceleration": st.sampled_from([0.0, 9.81, 500.0]),
}
TIPS = {
    "vibration_amplitude": st.sampled_from([0.0, 1e-9, 35e-6, 1e-3]),
    "vibration_frequency": st.sampled_from([50.0, 16000.0, 2e5]),
    "vibration_phase": st.floats(0.0, 1.0),
    "nodal_plane_angular_frequency": st.sampled_from([1e-3, 40.0, 3e4]),
    "nodal_plane_decay_rate": st.sampled_from([0.0, 20.0, 1e4]),
    "nodal_plane_sine": st.floats(-1e-3, 1e-3),
}
TOOLS = {
    "drill_tool_angular_frequency": st.sampled_from([1.0, 970.0, 3e4, 1e6]),
    "drill_tool_cosine": st.floats(-1e-3, 1e-3),
    "drill_tool_sine": st.floats(-1e-3, 1e-3),
}
LIMITS = st.sampled_from([1e-5, 1e-3, 1e-2])


@settings(max_examples=examples(300), deadline=None)
@given(
    clearance=st.one_of(st.floats(-7e-5, 1e-10), st.floats(0.0, 2e-3)),
    fields=st.fixed_dictionaries({**FLYING, **TIPS}),
    limit=LIMITS,
)
def test_no_strike_of_a_flying_mass_is_missed(clearance, fields, limit):
    segment = hanging_mass(clearance, **fields)
    guard = partial(gap, segment, FREE_MASS, TIP)
    segment.free_mass_position -= min(float(guard(0.0)), 0.0)
    found = first_strike(segment, limit, turn_at(segment.vibration_phase))
    fastest = max(segment.vibration_frequency, segment.nodal_plane_angular_frequency / 6.0)
    check_meeting(found, limit, guard, 200 + int(SAMPLES_PER_CYCLE * limit * fastest))


@settings(max_examples=examples(300), deadline=None)
@given(
    clearance=st.one_of(st.just(0.0), st.floats(0.0, 1e-10), st.floats(0.0, 2e-3)),
    damping=st.sampled_from([0.0, 0.01, 0.6, 10.0]),
    fields=st.fixed_dictionaries({**FLYING, **TOOLS}),
    limit=LIMITS,
)
def test_no_landing_of_a_flying_mass_is_missed(clearance, damping, fields, limit):
    angular = fields["drill_tool_angular_frequency"]
    segment = hanging_mass(0.0, **fields, drill_tool_decay_rate=damping * angular)
    segment.free_mass_position = segment.drill_tool_cosine - clearance
    samples = 200 + int(SAMPLES_PER_CYCLE * limit * angular / 6.0)
    guard = partial(gap, segment, DRILL_TOOL, FREE_MASS)
    check_meeting(first_landing(segment, limit), limit, guard, samples)


@pytest.mark.parametrize("depth", [1e-14, 1e-13, 1e-11, 1e-9, 1e-6])
def test_of_two_roots_in_one_cycle_the_first_is_found(depth):
    time, struck = strike_of(hanging_mass(-depth), 1e-3)
    crest = 0.35 / 16000.0
    before = math.acos(1.0 - depth / 35e-6) / (2 * math.pi * 16000.0)
    assert struck
    # Where the tip just touches, the gap is flat: a picometre counts there, not a picosecond.
    assert time < crest
    assert time == pytest.approx(crest - before, abs=1e-12 if depth > 1e-10 else 2e-10)
