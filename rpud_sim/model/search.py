"""Search for the end of the open segment: the only place that solves an equation numerically.

A guard whose second derivative is bounded by B cannot fall from a value g with a slope g' to zero
within

    step = (g' + sqrt(g'^2 + 2 B g)) / B

The search makes such steps, one after another. It cannot pass a root, however near two roots are,
and near a simple root the steps converge to it quadratically from the left. Two longer steps are
as safe: while the second derivative is certain to stay positive, by a bound on the third, the
guard lies above its tangent; and a guard in which the tip vibrates is at least its slowly changing
envelope.
"""

import math

from rpud_sim.model.compile import compiled
from rpud_sim.model.contact import release_time
from rpud_sim.model.guards import (
    END_ACTUATOR_IMPACT,
    END_ACTUATOR_RELEASE,
    END_AMPLITUDE,
    END_DRILL_TOOL_IMPACT,
    END_DRILL_TOOL_RELEASE,
    END_DRILL_TOOL_REST,
    END_LIMIT,
    guard_at,
    guard_bounds,
)
from rpud_sim.model.motion import CONTACT_BOTH
from rpud_sim.model.resonator import time_to_update
from rpud_sim.model.segment import CONTACT_ACTUATOR, CONTACT_DRILL_TOOL
from rpud_sim.model.tolerances import (
    LONGEST_SEARCH,
    LONGEST_SEGMENT,
    STEP_EFFORT,
    TIME_RESOLUTION,
    TOUCHING,
    WEAKEST_PULL,
)
from rpud_sim.model.vibration import time_to_zero_displacement

# A guard that does not bend still needs a bound to divide by [m/s^2 or N/s^2].
LEAST_BOUND = 1e-9

# How far two forces are followed at first [s].
FIRST_SPAN = 1e-5


@compiled
def safe_step(value, slope, bound):
    """Time within which a guard cannot reach zero, by a bound on its second derivative [s]."""
    value = max(value, 0.0)
    root = math.sqrt(slope * slope + 2.0 * bound * value)
    if slope < 0.0:
        return 2.0 * value / (root - slope)  # without the cancellation
    return (slope + root) / bound


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
def allowance_of(end):
    """Return how far below zero a guard may be that was not yet as far above zero."""
    if end in (END_ACTUATOR_IMPACT, END_DRILL_TOOL_IMPACT):
        return TOUCHING
    if end == END_DRILL_TOOL_REST:
        return 0.0
    return WEAKEST_PULL


@compiled
def first_root(segment, end, limit):
    """Time for which a guard stays positive, up to a limit [s].

    Returns:
        The time until which it is certain to be positive, whether it is zero there, and the number
        of steps.
    """
    bounds = guard_bounds(segment, end)
    bound = max(bounds.second, LEAST_BOUND)
    third_bound = max(bounds.third, LEAST_BOUND)
    slow_bound = max(bounds.slow_second, LEAST_BOUND)
    allowance = allowance_of(end)
    time = 0.0
    for number in range(LONGEST_SEARCH):
        value, slope, curvature, slow, slow_slope = guard_at(segment, end, time)
        # The guard is certain to rise to `crest` before it can fall.
        crest = value + max(slope, 0.0) ** 2 / (2.0 * bound)
        if crest > allowance:
            allowance = 0.0
        value += allowance
        step = max(
            safe_step(value, slope, bound), convex_step(value, slope, curvature, third_bound)
        )
        envelope = slow - bounds.vibration
        if envelope > 0.0:
            step = max(step, safe_step(envelope, slow_slope, slow_bound))
        if slope >= 0.0:
            step = max(step, 10.0 * TIME_RESOLUTION)
        elif value <= 0.0 or step < TIME_RESOLUTION:
            return time, True, number + 1
        time += step
        if not time < limit:
            return limit, False, number + 1
    return time, False, LONGEST_SEARCH


@compiled
def fall_time(gap, velocity, gravity):
    """Time in which the free mass falls onto a tool at rest [s]; infinite if it does not."""
    if velocity <= 0.0 and gravity == 0.0:
        return math.inf
    if velocity <= 0.0 and gap + velocity * velocity / (2.0 * gravity) <= TOUCHING:
        gap += TOUCHING
    gap = max(gap, 0.0)
    speed = math.sqrt(velocity * velocity + 2.0 * gravity * gap)
    if velocity > 0.0:
        return 2.0 * gap / (velocity + speed)
    return (speed - velocity) / gravity


@compiled
def sooner(state, segment, end, duration, event):
    """Return the given duration and event, or those of a guard if they are sooner.

    The steps of the search add to the state's effort.
    """
    time, is_root, steps = first_root(segment, end, duration)
    state.effort += steps * STEP_EFFORT
    if time < duration:
        return time, end if is_root else END_LIMIT
    return duration, event


@compiled
def sooner_release(state, segment, duration, event):
    """Return the given duration and event, or those of the three bodies' contact if sooner.

    Either force may vanish long before the other: the search follows both by turns, in growing
    spans.
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
def next_event(drill, state, segment):
    """Find the end of the segment, and its duration [s].

    Returns:
        One of END_*, and the duration.
    """
    duration = LONGEST_SEGMENT
    event = END_LIMIT
    if state.resonant:
        if not state.steady:
            change = time_to_update(state)
            if change < duration:
                duration = change
                event = END_AMPLITUDE
    elif state.target_amplitude != state.amplitude:
        change = time_to_zero_displacement(state.phase, state.frequency)
        if change < duration:
            duration = change
            event = END_AMPLITUDE
    contact = state.contact
    if contact == CONTACT_BOTH:
        if drill.jammed:
            duration, event = sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
        else:
            duration, event = sooner_release(state, segment, duration, event)
        return event, duration
    wedged = drill.jammed and contact & CONTACT_DRILL_TOOL
    if contact == CONTACT_DRILL_TOOL and not wedged and segment.drill_tool_decay_rate == 0.0:
        root = release_time(
            segment.drill_tool_cosine,
            segment.drill_tool_sine,
            segment.drill_tool_angular_frequency,
            drill.gravity,
        )
        if root < duration:
            duration = root
            event = END_DRILL_TOOL_RELEASE
    elif contact == 0 and state.tool_at_rest:
        root = fall_time(-state.u_fm, state.v_fm, drill.gravity)
        if root < duration:
            duration = root
            event = END_DRILL_TOOL_IMPACT
    elif not wedged:
        end = END_DRILL_TOOL_IMPACT
        if contact & CONTACT_DRILL_TOOL:
            end = END_DRILL_TOOL_RELEASE
        duration, event = sooner(state, segment, end, duration, event)
    if drill.in_rock and not contact & CONTACT_DRILL_TOOL and not state.tool_at_rest:
        duration, event = sooner(state, segment, END_DRILL_TOOL_REST, duration, event)
    end = END_ACTUATOR_RELEASE if contact & CONTACT_ACTUATOR else END_ACTUATOR_IMPACT
    duration, event = sooner(state, segment, end, duration, event)
    return event, duration
