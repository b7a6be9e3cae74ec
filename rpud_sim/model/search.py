"""Search for the end of the open segment: the only place that solves an equation numerically.

The search makes steps within which the guard is certain to stay positive (steps.py), one after
another. It cannot pass a root, however near two roots are, and near a simple root the steps
converge to it quadratically from the left.
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
)
from rpud_sim.model.motion import CONTACT_BOTH
from rpud_sim.model.resonator import time_to_update
from rpud_sim.model.segment import CONTACT_ACTUATOR, CONTACT_DRILL_TOOL
from rpud_sim.model.steps import (
    allowance_of,
    bent_step,
    envelope_step,
    going_on,
    is_above,
    is_root,
    positive_bounds,
)
from rpud_sim.model.strike import first_landing, first_strike
from rpud_sim.model.tolerances import LONGEST_SEARCH, LONGEST_SEGMENT, STEP_EFFORT, TOUCHING
from rpud_sim.model.vibration import time_to_zero_displacement

# How far two forces are followed at first [s].
FIRST_SPAN = 1e-5


@compiled
def first_root(segment, end, limit):
    """Time for which a guard stays positive, up to a limit [s].

    Args:
        end: one of END_*, but not ``END_ACTUATOR_IMPACT``.

    Returns:
        The time until which it is certain to be positive, whether it is zero there, and the number
        of steps.
    """
    if segment.contact == 0 and end == END_DRILL_TOOL_IMPACT:
        return first_landing(segment, limit)
    bounds = positive_bounds(segment, end)
    allowance = allowance_of(end)
    time = 0.0
    for number in range(LONGEST_SEARCH):
        guard = guard_at(segment, end, time)
        slope = guard.slope
        if allowance > 0.0 and is_above(guard.value, slope, bounds.second, allowance):
            allowance = 0.0
        value = guard.value + allowance
        envelope = guard.slow - bounds.vibration
        longest = envelope_step(envelope, guard.slow_slope, bounds.slow_second)
        step = bent_step(value, slope, guard.curvature, bounds.second, bounds.third)
        step = going_on(step, slope, longest)
        if is_root(value, slope, step):
            return time, True, number + 1
        time += step.time
        if not time < limit:
            return limit, False, number + 1
        if step.ends:
            return time, True, number + 1
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
def sooner_strike(state, segment, duration, event, turn):
    """Return the given duration and event, or those of the actuator's strike if it is sooner.

    ``turn`` is the ``Turn`` of the vibration at the segment's start.
    """
    time, is_struck, steps = first_strike(segment, duration, turn)
    state.effort += steps * STEP_EFFORT
    if time < duration:
        return time, END_ACTUATOR_IMPACT if is_struck else END_LIMIT
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
def next_event(drill, state, segment, turn):
    """Find the end of the segment, and its duration [s].

    ``turn`` is the ``Turn`` of the vibration at the segment's start.

    Returns:
        The duration, and one of END_*.
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
            return sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
        return sooner_release(state, segment, duration, event)
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
    if contact & CONTACT_ACTUATOR:
        return sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
    return sooner_strike(state, segment, duration, event, turn)
