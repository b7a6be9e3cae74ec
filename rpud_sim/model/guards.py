"""Guards: when the open segment ends. The only place where an equation is solved numerically.

Each guard is a function of time that is positive while the segment lasts: a gap between two bodies, or the force of a
contact. Its second derivative has a bound B, so that from a value g and a slope g' it cannot reach zero within

    step = (g' + sqrt(g'^2 + 2 B g)) / B

The search makes such steps, one after another. It cannot pass a root, however near two roots are, and near a simple
root the steps converge to it quadratically from the left. Two longer steps are as safe: while the second derivative
g'' is certain to stay positive, by a bound on the third, the guard lies above its tangent; and a gap to the vibrating
tip is at least the slowly changing gap to the tip's envelope.
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

# Touching bodies whose velocities differ by less [m/s] do not collide, unless they overlap by more than this [m].
SAME_VELOCITY = 1e-9
DEEPEST_OVERLAP = 1e-15

# A contact force may be negative by this much [N] before its contact opens.
WEAKEST_PULL = 1e-12


@compiled
def tip_acceleration_at(segment, time, motion):
    """Acceleration of the actuator's tip, given ``motion_at`` the same time [m/s^2]."""
    u_np, v_np, u_ut, v_ut, _, _, _, _ = motion
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
    acceleration, _ = decaying_derivatives(
        nodal_plane_motion(segment),
        u_np - steady - segment.nodal_plane_offset,
        v_np - steady_rate,
    )
    return acceleration - omega * omega * (u_ut - u_np + steady)


@compiled
def drill_tool_acceleration_at(segment, motion):
    """Acceleration of the drill tool, given ``motion_at`` the same time [m/s^2]."""
    _, _, _, _, _, _, u_dt, v_dt = motion
    acceleration, _ = decaying_derivatives(
        drill_tool_motion(segment), u_dt - segment.drill_tool_offset, v_dt
    )
    return acceleration


@compiled
def gap_to_actuator(segment, time):
    """Gap u_fm - u_ut between free mass and actuator.

    Returns:
        Value [m], slope [m/s] and second derivative [m/s^2] of the gap; value and slope of the gap to the envelope.
    """
    motion = motion_at(segment, time)
    u_np, v_np, u_ut, v_ut, u_fm, v_fm, _, _ = motion
    if segment.contact == 0:
        acceleration = segment.free_mass_acceleration
    else:
        acceleration = drill_tool_acceleration_at(segment, motion)
    acceleration -= tip_acceleration_at(segment, time, motion)
    envelope = u_fm - u_np - segment.vibration_amplitude
    return u_fm - u_ut, v_fm - v_ut, acceleration, envelope, v_fm - v_np


@compiled
def gap_to_drill_tool(segment, time):
    """Gap u_dt - u_fm between drill tool and free mass: value [m], slope [m/s] and second derivative [m/s^2]."""
    motion = motion_at(segment, time)
    _, _, _, _, u_fm, v_fm, u_dt, v_dt = motion
    acceleration = drill_tool_acceleration_at(segment, motion)
    if segment.contact == 0:
        acceleration -= segment.free_mass_acceleration
    else:
        acceleration -= tip_acceleration_at(segment, time, motion)
    return u_dt - u_fm, v_dt - v_fm, acceleration


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
def derivative_bounds(drill, segment, end):
    """Bounds that hold for the whole segment on the derivatives of a guard.

    Returns:
        Bounds on the second derivative of the guard and on its third (infinite where it is not used), and on the
        second derivative of the gap to the tip's envelope.
    """
    nodal_plane = nodal_plane_motion(segment)
    drill_tool = drill_tool_motion(segment)
    omega = TWO_PI * segment.vibration_frequency
    np_rate = undamped_frequency(nodal_plane)
    dt_rate = undamped_frequency(drill_tool)
    np_acceleration = np_rate**2 * decaying_amplitude(nodal_plane)
    dt_acceleration = dt_rate**2 * decaying_amplitude(drill_tool)
    tip_acceleration = omega**2 * math.hypot(
        segment.nodal_plane_vibration_sine + segment.vibration_amplitude,
        segment.nodal_plane_vibration_cosine,
    )
    if end == END_ACTUATOR_IMPACT:
        slow = np_acceleration + (drill.gravity if segment.contact == 0 else dt_acceleration)
        third = np_rate * np_acceleration + omega * tip_acceleration
        if segment.contact != 0:
            third += dt_rate * dt_acceleration
        return slow + tip_acceleration, third, slow
    if end == END_DRILL_TOOL_IMPACT:
        third = dt_rate * dt_acceleration
        if segment.contact == 0:
            return dt_acceleration + drill.gravity, third, 0.0
        third += np_rate * np_acceleration + omega * tip_acceleration
        return dt_acceleration + np_acceleration + tip_acceleration, third, 0.0
    if end == END_DRILL_TOOL_REST:
        return dt_acceleration, math.inf, 0.0
    if segment.contact == CONTACT_DRILL_TOOL:
        return drill.free_mass * dt_rate**2 * dt_acceleration, math.inf, 0.0
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
    bound += tip_acceleration * (mass * omega**2 + damping * omega + spring_rate)
    return bound, math.inf, 0.0


@compiled
def safe_step(value, slope, bound):
    """Time within which a guard cannot reach zero, by a bound on its second derivative [s]."""
    return (slope + math.sqrt(slope * slope + 2.0 * bound * max(value, 0.0))) / bound


@compiled
def convex_step(value, slope, curvature, bound):
    """Time within which a guard cannot reach zero, as long as it is certain to be convex [s]."""
    if not curvature > 0.0:
        return 0.0
    convex = curvature / bound
    if slope < 0.0:
        convex = min(convex, max(value, 0.0) / -slope)
    return convex


@compiled
def first_root(drill, segment, end, limit):
    """First time before the limit at which a guard reaches zero from above [s]; infinite if there is none."""
    bound, third_bound, envelope_bound = derivative_bounds(drill, segment, end)
    # A guard that cannot bend still needs a bound to divide by.
    bound = max(bound, 1e-9)
    third_bound = max(third_bound, 1e-9)
    envelope_bound = max(envelope_bound, 1e-9)
    is_gap = end == END_ACTUATOR_IMPACT or end == END_DRILL_TOOL_IMPACT
    touching_step = math.sqrt(2.0 * DEEPEST_OVERLAP / bound)
    shortest_step = 10.0 * TIME_RESOLUTION
    if not is_gap:
        shortest_step = max(shortest_step, math.sqrt(2.0 * WEAKEST_PULL / bound))
    time = 0.0
    while time < limit:
        curvature = 0.0
        step = 0.0
        if end == END_ACTUATOR_IMPACT:
            value, slope, curvature, envelope, envelope_slope = gap_to_actuator(segment, time)
            if envelope > 0.0:
                step = safe_step(envelope, envelope_slope, envelope_bound)
        elif end == END_DRILL_TOOL_IMPACT:
            value, slope, curvature = gap_to_drill_tool(segment, time)
        elif end == END_ACTUATOR_RELEASE:
            value, slope = force_on_actuator(drill, segment, time)
        elif end == END_DRILL_TOOL_RELEASE:
            value, slope = force_on_drill_tool(drill, segment, time)
        else:
            value, slope = decaying_part(drill_tool_motion(segment), time)
        step = max(
            step,
            safe_step(value, slope, bound),
            convex_step(value, slope, curvature, third_bound),
        )
        if is_gap and slope > -SAME_VELOCITY and value > -DEEPEST_OVERLAP:
            step = max(step, touching_step)
        elif slope < 0.0 and (value <= 0.0 or step < TIME_RESOLUTION):
            return time
        time += max(step, shortest_step)
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
