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
    CONTACT_ACTUATOR,
    CONTACT_DRILL_TOOL,
    drill_tool_motion,
    motion_at,
    nodal_plane_motion,
)
from rpud_sim.model.suspension import (
    decaying_amplitude,
    decaying_derivatives,
    decaying_part,
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
def tip_motion_at(segment, time, motion):
    """Motion of the actuator's tip, given ``motion_at`` the same time.

    Returns:
        Position [m] and velocity [m/s] without the steady vibration, and the whole acceleration
        [m/s^2].
    """
    u_np, v_np, u_ut, _, _, _, _, _ = motion
    omega = TWO_PI * segment.vibration_frequency
    steady = 0.0
    steady_rate = 0.0
    if segment.contact & CONTACT_ACTUATOR:
        angle = TWO_PI * (segment.vibration_phase + segment.vibration_frequency * time)
        sine = math.sin(angle)
        cosine = math.cos(angle)
        in_phase = segment.nodal_plane_vibration_sine
        in_quadrature = segment.nodal_plane_vibration_cosine
        steady = in_phase * sine + in_quadrature * cosine
        steady_rate = omega * (in_phase * cosine - in_quadrature * sine)
    position = u_np - steady
    velocity = v_np - steady_rate
    acceleration, _ = decaying_derivatives(
        nodal_plane_motion(segment), position - segment.nodal_plane_offset, velocity
    )
    return position, velocity, acceleration - omega * omega * (u_ut - position)


@compiled
def drill_tool_acceleration_at(segment, motion):
    """Acceleration of the drill tool, given ``motion_at`` the same time [m/s^2]."""
    _, _, _, _, _, _, u_dt, v_dt = motion
    acceleration, _ = decaying_derivatives(
        drill_tool_motion(segment), u_dt - segment.drill_tool_offset, v_dt
    )
    return acceleration


@compiled
def tip_amplitude(segment):
    """Amplitude of the tip's steady vibration [m]."""
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    return math.sqrt(in_phase**2 + in_quadrature**2)


@compiled
def gap_to_actuator(segment, time):
    """Gap u_fm - u_ut between free mass and actuator."""
    motion = motion_at(segment, time)
    _, _, u_ut, v_ut, u_fm, v_fm, _, _ = motion
    if segment.contact == 0:
        acceleration = segment.free_mass_acceleration
    else:
        acceleration = drill_tool_acceleration_at(segment, motion)
    position, velocity, tip_acceleration = tip_motion_at(segment, time, motion)
    return Guard(
        u_fm - u_ut,
        v_fm - v_ut,
        acceleration - tip_acceleration,
        u_fm - position,
        v_fm - velocity,
    )


@compiled
def gap_to_drill_tool(segment, time):
    """Gap u_dt - u_fm between drill tool and free mass."""
    motion = motion_at(segment, time)
    _, _, _, _, u_fm, v_fm, u_dt, v_dt = motion
    acceleration = drill_tool_acceleration_at(segment, motion)
    if segment.contact == 0:
        curvature = acceleration - segment.free_mass_acceleration
        return Guard(u_dt - u_fm, v_dt - v_fm, curvature, NO_SLOW_PART, 0.0)
    position, velocity, tip_acceleration = tip_motion_at(segment, time, motion)
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
    angle = TWO_PI * (segment.vibration_phase + segment.vibration_frequency * time)
    sine = math.sin(angle)
    cosine = math.cos(angle)
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
    motion = drill_tool_motion(segment)
    displacement, velocity = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    # Eq. (30): the contact holds the free mass back from falling freely.
    return segment.free_mass * (segment.gravity - acceleration), -segment.free_mass * jerk


@compiled
def guard_at(segment, end, time):
    """The guard that ends a segment in the given way, at a time after its start."""
    if end == END_ACTUATOR_IMPACT:
        return gap_to_actuator(segment, time)
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
def guard_bounds(segment, end):
    """Bounds on the derivatives of a guard, which hold for the whole segment."""
    nodal_plane = nodal_plane_motion(segment)
    drill_tool = drill_tool_motion(segment)
    omega = TWO_PI * segment.vibration_frequency
    np_rate = undamped_frequency(nodal_plane)
    dt_rate = undamped_frequency(drill_tool)
    np_second = np_rate**2 * decaying_amplitude(nodal_plane)
    dt_second = dt_rate**2 * decaying_amplitude(drill_tool)
    amplitude = tip_amplitude(segment)
    vibration_second = omega**2 * amplitude
    np_third = np_rate * np_second
    dt_third = dt_rate * dt_second
    vibration_third = omega * vibration_second
    if end == END_DRILL_TOOL_REST:
        return Bounds(dt_second, math.inf, 0.0, 0.0)
    if end in (END_ACTUATOR_IMPACT, END_DRILL_TOOL_IMPACT):
        if segment.contact != 0:
            slow = np_second + dt_second
            third = np_third + dt_third + vibration_third
            return Bounds(slow + vibration_second, third, slow, amplitude)
        if end == END_DRILL_TOOL_IMPACT:
            return Bounds(dt_second + segment.gravity, dt_third, 0.0, 0.0)
        slow = np_second + segment.gravity
        return Bounds(slow + vibration_second, np_third + vibration_third, slow, amplitude)
    if segment.contact == CONTACT_DRILL_TOOL:
        return Bounds(segment.free_mass * dt_rate * dt_third, math.inf, 0.0, 0.0)
    mass, damping, spring_rate, _ = load_of(segment, end)
    slow = np_second * (mass * np_rate**2 + damping * np_rate + spring_rate)
    vibration = vibration_second * (mass * omega**2 + damping * omega + spring_rate)
    stiffness = spring_rate - mass * omega**2
    resistance = damping * omega
    force = math.sqrt(stiffness**2 + resistance**2) * amplitude
    return Bounds(slow + vibration, math.inf, slow, force)
