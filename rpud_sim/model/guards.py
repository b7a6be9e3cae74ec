"""Guards: functions of time that are positive while a segment lasts.

A guard is the gap between two bodies, the force of a contact, or the deformation of the drill tool
in the rock. Each comes with its derivatives at a time, and with bounds on them for the whole
segment, so that ``search`` knows for how long it certainly stays positive. Where the
actuator's tip takes part, the guard is also at least its *envelope*: the guard without the steady
vibration, less the most that the vibration takes from it.
"""

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.motion import CONTACT_BOTH
from rpud_sim.model.segment import (
    CONTACT_DRILL_TOOL,
    drill_tool_motion,
    drill_tool_swing,
    nodal_plane_motion,
    nodal_plane_swing,
    tip_motion,
    vibration_turn,
)
from rpud_sim.model.suspension import (
    decaying_amplitude,
    decaying_derivatives,
    decaying_part,
    swinging_part,
    undamped_frequency,
)
from rpud_sim.model.vibration import TWO_PI

# What ends a segment: a guard that reaches zero, a change of amplitude, or its greatest length.
END_ACTUATOR_IMPACT = 0
END_DRILL_TOOL_IMPACT = 1
END_ACTUATOR_RELEASE = 2
END_DRILL_TOOL_RELEASE = 3
END_DRILL_TOOL_REST = 4
END_AMPLITUDE = 5
END_LIMIT = 6

# Stands for a slow part that is not known.
NO_SLOW_PART = -math.inf


class Guard(NamedTuple):
    """Value and derivatives of a guard at one time; a gap in m or a force in N."""

    value: float
    slope: float
    curvature: float  # second derivative, or 0 where it is not known
    slow: float  # without the steady vibration
    slow_slope: float


class Bounds(NamedTuple):
    """Bounds on the derivatives of a guard during a segment."""

    second: float
    third: float  # infinite where it is not known
    slow_second: float
    vibration: float  # the most that the steady vibration takes from the guard


class Load(NamedTuple):
    """Load that the tip moves through a contact, and the constant force on it."""

    mass: float
    damping: float
    spring_rate: float
    force: float


@compiled
def held_tip_motion(segment, tip, turn):
    """Motion of the tip while the free mass is held against it.

    Args:
        tip: ``tip_motion`` at a time.

    Returns:
        Position [m] and velocity [m/s] without the steady vibration, and the whole acceleration
        [m/s^2].
    """
    u_np, v_np, u_ut, _ = tip
    omega = TWO_PI * segment.vibration_frequency
    in_phase = segment.nodal_plane_vibration_sine
    in_quadrature = segment.nodal_plane_vibration_cosine
    position = u_np - (in_phase * turn.sine + in_quadrature * turn.cosine)
    velocity = v_np - omega * (in_phase * turn.cosine - in_quadrature * turn.sine)
    acceleration, _ = decaying_derivatives(
        nodal_plane_motion(segment), position - segment.nodal_plane_offset, velocity
    )
    return position, velocity, acceleration - omega * omega * (u_ut - position)


@compiled
def tip_amplitude(segment):
    """Amplitude of the tip's steady vibration [m]."""
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    return math.sqrt(in_phase * in_phase + in_quadrature * in_quadrature)


@compiled
def gap_to_drill_tool(segment, time):
    """Gap u_dt - u_fm between drill tool and free mass, which the actuator touches."""
    motion = drill_tool_motion(segment)
    displacement, v_dt = swinging_part(motion, drill_tool_swing(segment, time))
    u_dt = segment.drill_tool_offset + displacement
    acceleration, _ = decaying_derivatives(motion, displacement, v_dt)
    turn = vibration_turn(segment, time)
    tip = tip_motion(segment, turn, nodal_plane_swing(segment, time))
    position, velocity, tip_acceleration = held_tip_motion(segment, tip, turn)
    _, _, u_fm, v_fm = tip
    return Guard(
        u_dt - u_fm,
        v_dt - v_fm,
        acceleration - tip_acceleration,
        u_dt - position,
        v_dt - velocity,
    )


@compiled
def load_of(segment, end):
    """The ``Load`` behind the contact that opens with the given end, all the way from the tip."""
    mass = 0.0
    force = 0.0
    damping = 0.0
    spring_rate = 0.0
    if end == END_ACTUATOR_RELEASE:
        mass += segment.free_mass
        force = segment.free_mass * segment.gravity
    if segment.contact == CONTACT_BOTH:
        mass += segment.drill_tool_mass
        damping = segment.drill_tool_damping
        spring_rate = segment.drill_tool_spring_rate
    return Load(mass, damping, spring_rate, force)


@compiled
def force_from_tip(load, segment, time):
    """Force of a contact that holds a load against the tip: m u'' + c u' + k u - F at the tip."""
    motion = nodal_plane_motion(segment)
    displacement, velocity = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    mass, damping, spring_rate, force = load
    slow = mass * acceleration + damping * velocity
    slow += spring_rate * (segment.nodal_plane_offset + displacement) - force
    slow_slope = mass * jerk + damping * acceleration + spring_rate * velocity
    omega = TWO_PI * segment.vibration_frequency
    sine, cosine = vibration_turn(segment, time)
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    u = in_phase * sine + in_quadrature * cosine
    v = omega * (in_phase * cosine - in_quadrature * sine)
    stiffness = spring_rate - mass * omega * omega
    return Guard(
        slow + stiffness * u + damping * v,
        slow_slope + stiffness * v - damping * omega * omega * u,
        0.0,
        slow,
        slow_slope,
    )


@compiled
def force_on_drill_tool(segment, time):
    """Force of the contact of free mass and drill tool: value [N] and slope [N/s]."""
    if segment.contact == CONTACT_BOTH:
        load = load_of(segment, END_DRILL_TOOL_RELEASE)
        force = force_from_tip(load, segment, time)
        return force.value, force.slope
    return force_of_swing(segment, drill_tool_swing(segment, time))


@compiled
def force_of_swing(segment, swing):
    """Return the same off the actuator, given the ``Swing`` of the drill tool at the time."""
    motion = drill_tool_motion(segment)
    displacement, velocity = swinging_part(motion, swing)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    # Eq. (30): the contact holds the free mass back from falling freely.
    return segment.free_mass * (segment.gravity - acceleration), -segment.free_mass * jerk


@compiled
def guard_at(segment, end, time):
    """The guard that ends a segment in the given way, at a time after its start.

    All but those of the meetings that strike.py seeks.
    """
    if end == END_DRILL_TOOL_IMPACT:
        return gap_to_drill_tool(segment, time)
    if end == END_DRILL_TOOL_REST:
        value, slope = decaying_part(drill_tool_motion(segment), time)
        return Guard(value, slope, 0.0, NO_SLOW_PART, 0.0)
    if segment.contact == CONTACT_DRILL_TOOL:
        value, slope = force_on_drill_tool(segment, time)
        return Guard(value, slope, 0.0, NO_SLOW_PART, 0.0)
    return force_from_tip(load_of(segment, end), segment, time)


@compiled
def bounds_of(motion):
    """Bounds on the derivatives of an ``Oscillation``: omega_n, and of the second and third."""
    rate = undamped_frequency(motion)
    second = rate * rate * decaying_amplitude(motion)
    return rate, second, rate * second


@compiled
def guard_bounds(segment, end):
    """Bounds on the derivatives of a guard, which hold for the whole segment."""
    if end == END_DRILL_TOOL_REST:
        _, second, _ = bounds_of(drill_tool_motion(segment))
        return Bounds(second, math.inf, 0.0, 0.0)
    if segment.contact == CONTACT_DRILL_TOOL:
        dt_rate, _, dt_third = bounds_of(drill_tool_motion(segment))
        return Bounds(segment.free_mass * dt_rate * dt_third, math.inf, 0.0, 0.0)
    np_rate, np_second, np_third = bounds_of(nodal_plane_motion(segment))
    omega = TWO_PI * segment.vibration_frequency
    amplitude = tip_amplitude(segment)
    vibration_second = omega * omega * amplitude
    vibration_third = omega * vibration_second
    if end == END_DRILL_TOOL_IMPACT:
        _, dt_second, dt_third = bounds_of(drill_tool_motion(segment))
        slow = np_second + dt_second
        third = np_third + dt_third + vibration_third
        return Bounds(slow + vibration_second, third, slow, amplitude)
    mass, damping, spring_rate, _ = load_of(segment, end)
    slow = np_second * (mass * np_rate * np_rate + damping * np_rate + spring_rate)
    vibration = vibration_second * (mass * omega * omega + damping * omega + spring_rate)
    stiffness = spring_rate - mass * omega * omega
    resistance = damping * omega
    force = math.sqrt(stiffness * stiffness + resistance * resistance) * amplitude
    return Bounds(slow + vibration, math.inf, slow, force)
