"""No event is missed and none is late: against a dense search in independent closed forms."""

import math
from itertools import pairwise

import numpy as np
import pytest
from closed_forms import DRILL_TOOL, FREE_MASS, TIP, gap, motion
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize_scalar
from support import examples

from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine
from rpud_sim.model.guards import END_ACTUATOR_IMPACT, gap_to_actuator, slow_gap
from rpud_sim.model.parameters import preset
from rpud_sim.model.search import fall_time
from rpud_sim.model.segment import SEGMENT, nodal_plane_swing, vibration_turn
from rpud_sim.model.steps import (
    certain_step,
    envelope_step,
    is_above,
    is_root,
    positive_bounds,
)
from rpud_sim.model.strike import first_strike
from rpud_sim.model.tolerances import LONGEST_SEARCH, TOUCHING, WEAKEST_PULL
from rpud_sim.model.vibration import turn_at

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


def lowest(function, duration, samples):
    """Least value between 0 and the duration: every dip is followed to its bottom."""
    times = np.linspace(0.0, duration, samples)
    values = function(times)
    least = values.min()
    inner = values[1:-1]
    for i in 1 + np.flatnonzero((inner <= values[:-2]) & (inner <= values[2:])):
        scale = max(np.ptp(values[i - 1 : i + 2]), 1e-300)
        if values[i] > 10.0 * scale:
            continue  # it cannot come near zero between the samples
        bounds = (times[i - 1], times[i + 1])
        dip = minimize_scalar(function, bounds=bounds, options={"xatol": 1e-16}, method="bounded")
        least = min(least, dip.fun)
    return least


def trajectory(regime, changes):
    parameters = preset(regime).replace(**changes)
    engine = Engine(parameters, 0.37)
    engine.advance(0, 0.25)
    segments, _ = engine.drain()
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


@pytest.mark.parametrize("case", CASES)
def test_impacts_are_exact_to_a_picosecond(case):
    _, segments = trajectory(*CASES[case])
    checked = 0
    for segment, after in pairwise(segments):
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


def hanging_mass(clearance, velocity=0.0):
    """Make a segment in which the mass hangs by a clearance ahead of a vibrating tip."""
    segment = np.zeros(1, SEGMENT)[0]
    segment["vibration_frequency"] = 16000.0
    segment["vibration_amplitude"] = 35e-6
    segment["vibration_phase"] = 0.9
    segment["nodal_plane_angular_frequency"] = 40.0
    segment["free_mass_position"] = 35e-6 + clearance
    segment["free_mass_velocity"] = velocity
    segment["duration"] = 2e-4
    return np.rec.array(np.array([segment], SEGMENT))[0]


def strike_of(segment, limit):
    strike = first_strike(segment, limit, turn_at(segment.vibration_phase))
    return strike.time, strike.struck


def every_part_computed(segment, limit):
    """Search as ``first_strike`` does, with the vibration at every step."""
    bounds = positive_bounds(segment, END_ACTUATOR_IMPACT)
    allowance, time = TOUCHING, 0.0
    for steps in range(1, LONGEST_SEARCH + 1):
        gap = slow_gap(segment, time, nodal_plane_swing(segment, time))
        guard = gap_to_actuator(segment, gap, vibration_turn(segment, time))
        if is_above(guard, bounds, allowance):
            allowance = 0.0
        least = envelope_step(guard.slow - bounds.vibration, guard.slow_slope, bounds)
        step = certain_step(guard, bounds, allowance, least)
        if is_root(guard, allowance, step):
            return time, True, steps
        time += step
        if not time < limit:
            return limit, False, steps
    return time, False, LONGEST_SEARCH


@settings(max_examples=examples(300), deadline=None)
@given(
    clearance=st.one_of(st.floats(-7e-5, 1e-10), st.floats(0.0, 2e-3)),
    velocity=st.floats(-10.0, 10.0),
    acceleration=st.sampled_from([0.0, 9.81, 500.0]),
    amplitude=st.sampled_from([0.0, 1e-9, 35e-6, 1e-3]),
    frequency=st.sampled_from([50.0, 16000.0, 2e5]),
    angular=st.sampled_from([0.0, 40.0, 3e4]),
    decay=st.sampled_from([0.0, 20.0, 1e4]),
    swing=st.floats(-1e-3, 1e-3),
    limit=st.sampled_from([1e-5, 1e-3, 1e-2]),
)
def test_what_is_left_out_far_from_the_tip_changes_no_bit(
    clearance, velocity, acceleration, amplitude, frequency, angular, decay, swing, limit
):
    segment = hanging_mass(clearance, velocity)
    segment.free_mass_acceleration = acceleration
    segment.gravity = acceleration
    segment.vibration_amplitude = amplitude
    segment.vibration_frequency = frequency
    segment.nodal_plane_angular_frequency = angular
    segment.nodal_plane_decay_rate = decay
    segment.nodal_plane_sine = swing
    strike = first_strike(segment, limit, turn_at(segment.vibration_phase))
    expected = every_part_computed(segment, limit)
    assert (strike.time, strike.struck, strike.steps) == expected


@pytest.mark.parametrize("clearance", [1e-15, 1e-13, 1e-11, 1e-8])
def test_a_tip_that_just_misses_does_not_strike(clearance):
    time, struck = strike_of(hanging_mass(clearance), 1e-3)
    assert (time, struck) == (1e-3, False)


@pytest.mark.parametrize("depth", [1e-14, 1e-13, 1e-11, 1e-9, 1e-6])
def test_of_two_roots_in_one_cycle_the_first_is_found(depth):
    time, struck = strike_of(hanging_mass(-depth), 1e-3)
    crest = 0.35 / 16000.0
    before = math.acos(1.0 - depth / 35e-6) / (2 * math.pi * 16000.0)
    assert struck
    # Where the tip just touches, the gap is flat: a picometre counts there, not a picosecond.
    assert time < crest
    assert time == pytest.approx(crest - before, abs=1e-12 if depth > 1e-10 else 2e-10)


@pytest.mark.parametrize("velocity", [-1e-3, -0.05, -1.0])
def test_a_mass_that_drifts_into_the_vibration_is_struck_at_the_first_touch(velocity):
    segment = hanging_mass(2e-6, velocity)
    time, struck = strike_of(segment, 1.0)
    assert struck
    earlier = np.linspace(0.0, time * (1 - 1e-9), 200_001)
    assert gap(segment, FREE_MASS, TIP, earlier).min() > 0.0
    assert abs(float(gap(segment, FREE_MASS, TIP, time))) < 1e-15


@pytest.mark.parametrize(("velocity", "gravity"), [(0.0, 9.81), (-0.3, 9.81), (2.0, 0.0)])
def test_fall_onto_a_tool_at_rest(velocity, gravity):
    time = fall_time(1e-3, velocity, gravity)
    assert velocity * time + 0.5 * gravity * time**2 == pytest.approx(1e-3)


def test_without_gravity_a_mass_that_leaves_the_tool_does_not_return():
    assert fall_time(1e-3, -0.1, 0.0) == math.inf
    assert fall_time(1e-3, 0.0, 0.0) == math.inf
