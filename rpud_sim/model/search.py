"""Search for the end of the open segment: the only place that solves an equation numerically.

A guard is a function of time that is positive while a segment lasts: the gap between two bodies,
the force of a contact, or the deformation of the drill tool in the rock. The search makes steps
within which it is certain to stay positive (steps.py), from bounds on its derivatives. It cannot
pass a root, however near two roots are. A guard in which the tip takes part is also at least its
*envelope*: itself without the steady vibration, less the most that the vibration takes from it.
"""

import math
from typing import NamedTuple

from rpud_sim.model import steps, tolerances
from rpud_sim.model.closed_form import (
    TWO_PI,
    decaying_amplitude,
    decaying_derivatives,
    decaying_part,
    swinging_part,
    time_to_zero_displacement,
    undamped_frequency,
)
from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import release_time
from rpud_sim.model.resonator import time_to_update
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_BOTH,
    CONTACT_DRILL_TOOL,
    drill_tool_motion,
    drill_tool_swing,
    load_of,
    nodal_plane_motion,
    nodal_plane_swing,
    slow_tip_motion,
    tip_motion,
    vibration_turn,
)
from rpud_sim.model.strike import first_landing, first_strike
from rpud_sim.model.yielding import FREE_STEP, STEP, YIELDS_TO_ROCK

# What ends a segment: a guard that reaches zero, a change of amplitude, or its greatest length.
END_ACTUATOR_IMPACT, END_DRILL_TOOL_IMPACT = 0, 1
END_ACTUATOR_RELEASE, END_DRILL_TOOL_RELEASE, END_DRILL_TOOL_REST = 2, 3, 4
END_AMPLITUDE, END_LIMIT = 5, 6

# Placeholder for an unknown slow part.
NO_SLOW_PART = -math.inf


class Guard(NamedTuple):
    """Value and derivatives of a guard at one time; a gap in m or a force in N."""

    value: float
    slope: float
    curvature: float  # second derivative, or 0 where it is not known
    slow: float  # value without the steady vibration
    slow_slope: float


class Bounds(NamedTuple):
    """Bounds on the derivatives of a guard during a segment."""

    second: float
    third: float  # infinite where it is not known
    slow_second: float
    vibration: float  # the most that the steady vibration takes from the guard


@compiled
def gap_to_drill_tool(segment, time):
    """Gap u_dt - u_fm between drill tool and free mass, which the actuator touches."""
    motion = drill_tool_motion(segment)
    displacement, v_dt = swinging_part(motion, drill_tool_swing(segment, time))
    u_dt = segment.drill_tool_offset + displacement
    acceleration, _ = decaying_derivatives(motion, displacement, v_dt)
    turn = vibration_turn(segment, time)
    u_np, v_np, u_fm, v_fm = tip_motion(segment, turn, nodal_plane_swing(segment, time))
    omega = TWO_PI * segment.vibration_frequency
    in_phase = segment.nodal_plane_vibration_sine
    in_quadrature = segment.nodal_plane_vibration_cosine
    # Of the tip without the steady vibration; the acceleration is the whole.
    position = u_np - (in_phase * turn.sine + in_quadrature * turn.cosine)
    velocity = v_np - omega * (in_phase * turn.cosine - in_quadrature * turn.sine)
    slow, _ = decaying_derivatives(
        nodal_plane_motion(segment), position - segment.nodal_plane_offset, velocity
    )
    curvature = acceleration - (slow - omega * omega * (u_fm - position))
    return Guard(u_dt - u_fm, v_dt - v_fm, curvature, u_dt - position, v_dt - velocity)


@compiled
def force_from_tip(load, segment, time):
    """Force of a contact that holds a load against the tip: m u'' + c u' + k u - F at the tip."""
    motion = slow_tip_motion(segment)
    displacement, velocity = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    mass, damping, spring_rate, force = load
    slow = mass * acceleration + damping * velocity
    slow += spring_rate * (motion.offset + displacement) - force
    slow_slope = mass * jerk + damping * acceleration + spring_rate * velocity
    omega = TWO_PI * segment.vibration_frequency
    sine, cosine = vibration_turn(segment, time)
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    u = in_phase * sine + in_quadrature * cosine
    v = omega * (in_phase * cosine - in_quadrature * sine)
    stiffness = spring_rate - mass * omega * omega
    value = slow + stiffness * u + damping * v
    slope = slow_slope + stiffness * v - damping * omega * omega * u
    return Guard(value, slope, 0.0, slow, slow_slope)


@compiled
def force_on_drill_tool(segment, time):
    """Force of the contact of free mass and drill tool: value [N] and slope [N/s]."""
    if segment.contact == CONTACT_BOTH:
        force = force_from_tip(load_of(segment, False), segment, time)
        return force.value, force.slope
    return force_of_swing(segment, drill_tool_swing(segment, time))


@compiled
def force_of_swing(segment, swing):
    """Return the same off the actuator, given the swing of the drill tool."""
    motion = drill_tool_motion(segment)
    displacement, velocity = swinging_part(motion, swing)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    # Eq. (30): the contact holds the free mass back from falling freely.
    return segment.free_mass * (segment.gravity - acceleration), -segment.free_mass * jerk


@compiled
def guard_at(segment, end, time):
    """Guard of the given end of a segment; strike.py has the guards of the free mass."""
    if end == END_DRILL_TOOL_IMPACT:
        return gap_to_drill_tool(segment, time)
    if end == END_DRILL_TOOL_REST:
        value, slope = decaying_part(drill_tool_motion(segment), time)
        return Guard(value, slope, 0.0, NO_SLOW_PART, 0.0)
    if segment.contact == CONTACT_DRILL_TOOL:
        value, slope = force_on_drill_tool(segment, time)
        return Guard(value, slope, 0.0, NO_SLOW_PART, 0.0)
    return force_from_tip(load_of(segment, end == END_ACTUATOR_RELEASE), segment, time)


@compiled
def bounds_of(motion):
    """Bounds on the derivatives of an ``Oscillation``: omega_n, and of the second and third."""
    rate = undamped_frequency(motion)
    second = rate * rate * decaying_amplitude(motion)
    return rate, second, rate * second


@compiled
def positive_bounds(second, third, slow_second, vibration):
    least = steps.LEAST_BOUND
    return Bounds(max(second, least), max(third, least), max(slow_second, least), vibration)


@compiled
def guard_bounds(segment, end):
    """Bounds on the derivatives of a guard, which hold for the whole segment."""
    dt_rate, dt_second, dt_third = bounds_of(drill_tool_motion(segment))
    if end == END_DRILL_TOOL_REST:
        return positive_bounds(dt_second, math.inf, 0.0, 0.0)
    if segment.contact == CONTACT_DRILL_TOOL:
        return positive_bounds(segment.free_mass * dt_rate * dt_third, math.inf, 0.0, 0.0)
    np_rate, np_second, np_third = bounds_of(slow_tip_motion(segment))
    omega = TWO_PI * segment.vibration_frequency
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    amplitude = math.sqrt(in_phase * in_phase + in_quadrature * in_quadrature)
    vibration_second = omega * omega * amplitude
    if end == END_DRILL_TOOL_IMPACT:
        slow = np_second + dt_second
        third = np_third + dt_third + omega * vibration_second
        return positive_bounds(slow + vibration_second, third, slow, amplitude)
    mass, damping, spring_rate, _ = load_of(segment, end == END_ACTUATOR_RELEASE)
    slow = np_second * (mass * np_rate * np_rate + damping * np_rate + spring_rate)
    vibration = vibration_second * (mass * omega * omega + damping * omega + spring_rate)
    stiffness = spring_rate - mass * omega * omega
    resistance = damping * omega
    force = math.sqrt(stiffness * stiffness + resistance * resistance) * amplitude
    return positive_bounds(slow + vibration, math.inf, slow, force)


# How far two forces are followed at first [s].
FIRST_SPAN = 1e-5


@compiled
def first_root(segment, end, limit):
    """Seek the first root of a guard, up to a limit [s].

    Returns the time until which the guard is certain to be positive, whether it is zero there, and
    the number of steps.
    """
    if segment.contact == 0 and end == END_DRILL_TOOL_IMPACT:
        return first_landing(segment, limit)
    bounds = guard_bounds(segment, end)
    # How far below zero a guard may be that was not yet as far above zero.
    allowance = tolerances.TOUCHING if end == END_DRILL_TOOL_IMPACT else tolerances.WEAKEST_PULL
    if end == END_DRILL_TOOL_REST:
        allowance = 0.0
    time = 0.0
    for number in range(tolerances.LONGEST_SEARCH):
        guard = guard_at(segment, end, time)
        slope = guard.slope
        if allowance > 0.0 and steps.is_above(guard.value, slope, bounds.second, allowance):
            allowance = 0.0
        value = guard.value + allowance
        envelope = guard.slow - bounds.vibration
        longest = 0.0
        if envelope > 0.0:
            longest = steps.safe_step(envelope, guard.slow_slope, -bounds.slow_second)
        step = steps.step_with_curvature(value, slope, guard.curvature, bounds.second, bounds.third)
        step = steps.at_least(step, slope, longest)
        time, outcome = steps.after_step(time, step, steps.is_root(value, slope, step), limit)
        if outcome != steps.RUNNING:
            return time, outcome == steps.MET, number + 1
    return time, False, tolerances.LONGEST_SEARCH


@compiled
def fall_time(gap, velocity, gravity):
    """Time in which the free mass falls onto a tool at rest [s]; infinite if it does not."""
    if velocity <= 0.0 and gravity == 0.0:
        return math.inf
    if velocity <= 0.0 and gap + velocity * velocity / (2.0 * gravity) <= tolerances.TOUCHING:
        gap += tolerances.TOUCHING
    gap = max(gap, 0.0)
    speed = math.sqrt(velocity * velocity + 2.0 * gravity * gap)
    if velocity > 0.0:
        return 2.0 * gap / (velocity + speed)
    return (speed - velocity) / gravity


@compiled
def sooner_of(state, found, end, duration, event):
    """Return the given duration and event, or what a search has found if it is sooner."""
    time, met, count = found
    state.effort += count * tolerances.STEP_EFFORT
    if time < duration:
        return time, end if met else END_LIMIT
    return duration, event


@compiled
def sooner(state, segment, end, duration, event):
    return sooner_of(state, first_root(segment, end, duration), end, duration, event)


@compiled
def sooner_release(state, segment, duration, event):
    """Return the given duration and event, or the release of the three bodies if sooner.

    Either force may vanish long before the other: both are followed by turns, in growing spans.
    """
    span = FIRST_SPAN
    while True:
        span = min(span, duration)
        time, end = sooner(state, segment, END_DRILL_TOOL_RELEASE, span, event)
        time, end = sooner(state, segment, END_ACTUATOR_RELEASE, time, end)
        if time < span or span == duration:
            return time, end
        span *= 8.0


@compiled
def next_event(drill, state, segment, turn):
    """Return the duration of the segment [s] and what ends it, one of END_*."""
    duration = tolerances.LONGEST_SEGMENT
    event = END_LIMIT
    change = math.inf
    if state.resonant and (state.fine or state.yields == YIELDS_TO_ROCK):
        step = STEP if state.yields == YIELDS_TO_ROCK else FREE_STEP
        change = step / state.drive_frequency
    elif state.resonant and not state.steady:
        change = time_to_update(
            state.update_due, segment.vibration_phase, segment.vibration_frequency
        )
    elif not state.resonant and state.target_amplitude != state.amplitude:
        change = time_to_zero_displacement(state.phase, state.frequency)
    if change < duration:
        duration = change
        event = END_AMPLITUDE
    contact = state.contact
    if contact == CONTACT_BOTH:
        if drill.jammed:
            return sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
        return sooner_release(state, segment, duration, event)
    on_tool = contact & CONTACT_DRILL_TOOL
    wedged = drill.jammed and on_tool
    end = END_DRILL_TOOL_RELEASE if on_tool else END_DRILL_TOOL_IMPACT
    root = math.inf
    if contact == CONTACT_DRILL_TOOL and not wedged and segment.drill_tool_decay_rate == 0.0:
        root = release_time(
            segment.drill_tool_cosine,
            segment.drill_tool_sine,
            segment.drill_tool_angular_frequency,
            drill.gravity,
        )
    elif contact == 0 and state.tool_at_rest:
        root = fall_time(-state.u_fm, state.v_fm, drill.gravity)
    elif not wedged:
        duration, event = sooner(state, segment, end, duration, event)
    if root < duration:
        duration = root
        event = end
    if drill.in_rock and not on_tool and not state.tool_at_rest:
        duration, event = sooner(state, segment, END_DRILL_TOOL_REST, duration, event)
    if contact & CONTACT_ACTUATOR:
        return sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
    strike = first_strike(segment, duration, turn)
    return sooner_of(state, strike, END_ACTUATOR_IMPACT, duration, event)
