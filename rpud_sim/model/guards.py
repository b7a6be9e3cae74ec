"""Guards: when the open segment ends. The only place where an equation is solved numerically.

Each guard is a function of time that is positive while the segment lasts: a gap between two bodies, or the force of a
contact. Its second derivative has a bound B, so that from a value g and a slope g' it cannot reach zero within

    step = (g' + sqrt(g'^2 + 2 B g)) / B

The search makes such steps, one after another. It cannot pass a root, however near two roots are, and near a simple
root the steps converge to it quadratically from the left. Where the vibrating tip is concerned, the step is taken
from the slower gap to the tip's envelope whenever that is longer.
"""

import math

from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import release_time
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
from rpud_sim.model.vibration import TWO_PI, time_to_zero_displacement

# What ends a segment.
END_ACTUATOR_IMPACT = 0
END_DRILL_TOOL_IMPACT = 1
END_ACTUATOR_RELEASE = 2
END_DRILL_TOOL_RELEASE = 3
END_DRILL_TOOL_REST = 4
END_AMPLITUDE = 5
END_LIMIT = 6

# No segment is longer than this [s]: what is known ahead stays bounded, and the bodies at rest are still reported.
LONGEST_SEGMENT = 0.01

# An approach that is this near to its root is an event [s]; a departing body is given at least ten times as long.
TIME_RESOLUTION = 1e-15

# Velocities that differ by less are the same [m/s]: touching bodies with the same velocity do not collide.
SAME_VELOCITY = 1e-9


@compiled
def gap_to_actuator(segment, time):
    """Gap u_fm - u_ut between free mass and actuator: value [m], slope [m/s], and value to the tip's envelope."""
    u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt = motion_at(segment, time)
    return u_fm - u_ut, v_fm - v_ut, u_fm - u_np - segment.vibration_amplitude, v_fm - v_np


@compiled
def gap_to_drill_tool(segment, time):
    """Gap u_dt - u_fm between drill tool and free mass: value [m] and slope [m/s]."""
    u_np, v_np, u_ut, v_ut, u_fm, v_fm, u_dt, v_dt = motion_at(segment, time)
    return u_dt - u_fm, v_dt - v_fm


@compiled
def tip_force(mass, damping, spring_rate, constant, segment, time):
    """Force that a body held against the tip needs: value and slope of constant + m u'' + c u' + k u at the tip.

    Returns:
        Value [N] and slope [N/s].
    """
    motion = nodal_plane_motion(segment)
    displacement, velocity = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    omega = TWO_PI * segment.vibration_frequency
    angle = TWO_PI * (segment.vibration_phase + segment.vibration_frequency * time)
    sine = math.sin(angle)
    cosine = math.cos(angle)
    in_phase = segment.nodal_plane_vibration_sine + segment.vibration_amplitude
    in_quadrature = segment.nodal_plane_vibration_cosine
    x = in_phase * sine + in_quadrature * cosine
    v = omega * (in_phase * cosine - in_quadrature * sine)
    square = omega * omega
    value = (
        constant
        + mass * (acceleration - square * x)
        + damping * (velocity + v)
        + spring_rate * (segment.nodal_plane_offset + displacement + x)
    )
    slope = (
        mass * (jerk - square * v)
        + damping * (acceleration - square * x)
        + spring_rate * (velocity + v)
    )
    return value, slope


@compiled
def force_on_actuator(drill, segment, time):
    """Contact force between actuator and free mass while they are in contact: value [N] and slope [N/s]."""
    weight = drill.free_mass * drill.gravity
    if segment.contact == CONTACT_BOTH:
        return tip_force(
            drill.free_mass + drill.tool_mass,
            drill.tool_damping,
            drill.tool_spring_rate,
            -weight,
            segment,
            time,
        )
    return tip_force(drill.free_mass, 0.0, 0.0, -weight, segment, time)


@compiled
def force_on_drill_tool(drill, segment, time):
    """Contact force between free mass and drill tool while they are in contact: value [N] and slope [N/s]."""
    if segment.contact == CONTACT_BOTH:
        return tip_force(
            drill.tool_mass, drill.tool_damping, drill.tool_spring_rate, 0.0, segment, time
        )
    motion = drill_tool_motion(segment)
    displacement, velocity = decaying_part(motion, time)
    acceleration, jerk = decaying_derivatives(motion, displacement, velocity)
    # Eq. (30): the contact holds the free mass back from falling freely.
    return drill.free_mass * (drill.gravity - acceleration), -drill.free_mass * jerk


@compiled
def tip_amplitude(segment):
    """Amplitude of the tip's steady vibration [m]."""
    return math.hypot(
        segment.nodal_plane_vibration_sine + segment.vibration_amplitude,
        segment.nodal_plane_vibration_cosine,
    )


@compiled
def curvature_bounds(drill, segment, end):
    """Bounds on the second derivative of a guard: of the guard itself, and of the gap to the tip's envelope."""
    nodal_plane = nodal_plane_motion(segment)
    drill_tool = drill_tool_motion(segment)
    omega = TWO_PI * segment.vibration_frequency
    np_rate = undamped_frequency(nodal_plane)
    dt_rate = undamped_frequency(drill_tool)
    np_acceleration = np_rate**2 * decaying_amplitude(nodal_plane)
    dt_acceleration = dt_rate**2 * decaying_amplitude(drill_tool)
    tip = tip_amplitude(segment)
    if end == END_ACTUATOR_IMPACT:
        in_flight = segment.contact == 0
        slow = np_acceleration + (drill.gravity if in_flight else dt_acceleration)
        return slow + omega**2 * tip, slow
    if end == END_DRILL_TOOL_IMPACT:
        if segment.contact == CONTACT_ACTUATOR:
            bound = np_acceleration + omega**2 * tip + dt_acceleration
        else:
            bound = drill.gravity + dt_acceleration
        return bound, bound
    if end == END_DRILL_TOOL_REST:
        return dt_acceleration, dt_acceleration
    if segment.contact == CONTACT_DRILL_TOOL:
        bound = drill.free_mass * dt_rate**2 * dt_acceleration
        return bound, bound
    mass = 0.0
    damping = 0.0
    spring_rate = 0.0
    if end == END_ACTUATOR_RELEASE:
        mass += drill.free_mass
    if segment.contact == CONTACT_BOTH:
        mass += drill.tool_mass
        damping = drill.tool_damping
        spring_rate = drill.tool_spring_rate
    bound = np_acceleration * (mass * np_rate**2 + damping * np_rate + spring_rate)
    bound += omega**2 * tip * (mass * omega**2 + damping * omega + spring_rate)
    return bound, bound


@compiled
def safe_step(value, slope, bound):
    """Time within which a guard cannot reach zero [s]."""
    return (slope + math.sqrt(slope * slope + 2.0 * bound * max(value, 0.0))) / bound


@compiled
def first_root(drill, segment, end, limit):
    """First time before the limit at which a guard reaches zero from above [s]; infinite if there is none."""
    bound, envelope_bound = curvature_bounds(drill, segment, end)
    # A guard that cannot bend still needs a bound to divide by.
    bound = max(bound, 1e-9)
    envelope_bound = max(envelope_bound, 1e-9)
    time = 0.0
    while time < limit:
        step = 0.0
        if end == END_ACTUATOR_IMPACT:
            value, slope, envelope, envelope_slope = gap_to_actuator(segment, time)
            if envelope > 0.0:
                step = safe_step(envelope, envelope_slope, envelope_bound)
        elif end == END_DRILL_TOOL_IMPACT:
            value, slope = gap_to_drill_tool(segment, time)
        elif end == END_ACTUATOR_RELEASE:
            value, slope = force_on_actuator(drill, segment, time)
        elif end == END_DRILL_TOOL_RELEASE:
            value, slope = force_on_drill_tool(drill, segment, time)
        else:
            value, slope = decaying_part(drill_tool_motion(segment), time)
        step = max(step, safe_step(value, slope, bound))
        if slope < 0.0 and (value <= 0.0 or step < TIME_RESOLUTION):
            parting = time == 0.0 and slope > -SAME_VELOCITY
            if not (parting and end <= END_DRILL_TOOL_IMPACT):
                return time
        time += max(step, 10.0 * TIME_RESOLUTION)
    return math.inf


@compiled
def fall_time(gap, velocity, gravity):
    """Time in which the free mass falls through a gap to a tool at rest [s]; infinite if it does not."""
    if velocity <= 0.0 and gravity == 0.0:
        return math.inf
    gap = max(gap, 0.0)
    speed = math.sqrt(velocity * velocity + 2.0 * gravity * gap)
    if velocity > 0.0:
        return 2.0 * gap / (velocity + speed)
    return (speed - velocity) / gravity


@compiled
def next_event(drill, state, segment):
    """What ends the segment, and after what time [s].

    Returns:
        One of END_*, and the duration.
    """
    duration = LONGEST_SEGMENT
    end = END_LIMIT
    if state.target_amplitude != state.amplitude:
        change = time_to_zero_displacement(state.phase, state.frequency)
        if change < duration:
            duration = change
            end = END_AMPLITUDE
    contact = state.contact
    root = math.inf
    if contact & CONTACT_DRILL_TOOL:
        if contact == CONTACT_DRILL_TOOL and segment.drill_tool_decay_rate == 0.0:
            root = release_time(
                segment.drill_tool_cosine,
                segment.drill_tool_sine,
                segment.drill_tool_angular_frequency,
                drill.gravity,
            )
        else:
            root = first_root(drill, segment, END_DRILL_TOOL_RELEASE, duration)
        if root < duration:
            duration = root
            end = END_DRILL_TOOL_RELEASE
    else:
        if contact == 0 and state.tool_at_rest:
            root = fall_time(-state.u_fm, state.v_fm, drill.gravity)
        else:
            root = first_root(drill, segment, END_DRILL_TOOL_IMPACT, duration)
        if root < duration:
            duration = root
            end = END_DRILL_TOOL_IMPACT
        if drill.in_rock and not state.tool_at_rest:
            root = first_root(drill, segment, END_DRILL_TOOL_REST, duration)
            if root < duration:
                duration = root
                end = END_DRILL_TOOL_REST
    actuator = END_ACTUATOR_RELEASE if contact & CONTACT_ACTUATOR else END_ACTUATOR_IMPACT
    root = first_root(drill, segment, actuator, duration)
    if root < duration:
        duration = root
        end = actuator
    return end, duration
