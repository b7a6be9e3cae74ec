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
from typing import NamedTuple

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
    Bounds,
    gap_to_actuator,
    guard_at,
    guard_bounds,
    slow_gap,
)
from rpud_sim.model.motion import CONTACT_BOTH
from rpud_sim.model.resonator import time_to_update
from rpud_sim.model.segment import (
    CONTACT_ACTUATOR,
    CONTACT_DRILL_TOOL,
    nodal_plane_swing,
    vibration_turn,
)
from rpud_sim.model.suspension import NO_SWING, Swing
from rpud_sim.model.tolerances import (
    LONGEST_SEARCH,
    LONGEST_SEGMENT,
    STEP_EFFORT,
    TIME_RESOLUTION,
    TOUCHING,
    WEAKEST_PULL,
)
from rpud_sim.model.vibration import NO_TURN, TWO_PI, Turn, time_to_zero_displacement

# A guard that does not bend still needs a bound to divide by [m/s^2 or N/s^2].
LEAST_BOUND = 1e-9

# Where the envelope is this near to zero, every part of a guard is computed [m]; and a step counts
# as longer than another if it is so by more than rounding.
NEAR = 1e-11
MARGIN = 1.0 + 1e-6

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
def positive_bounds(segment, end):
    """Return the ``Bounds`` of a guard, fit to divide by."""
    bounds = guard_bounds(segment, end)
    return Bounds(
        max(bounds.second, LEAST_BOUND),
        max(bounds.third, LEAST_BOUND),
        max(bounds.slow_second, LEAST_BOUND),
        bounds.vibration,
    )


@compiled
def is_above(guard, bounds, allowance):
    """Whether a guard is certain to rise above an allowance before it can fall."""
    if guard.slope <= 0.0 or guard.value > allowance:
        return guard.value > allowance
    return guard.value + guard.slope**2 / (2.0 * bounds.second) > allowance


@compiled
def envelope_step(envelope, slow_slope, bounds):
    """Time within which an envelope cannot reach zero [s]; zero if it is not above it."""
    return safe_step(envelope, slow_slope, bounds.slow_second) if envelope > 0.0 else 0.0


@compiled
def certain_step(guard, bounds, allowance, least):
    """Time within which a guard cannot fall below the allowance [s].

    Args:
        guard: at a time.
        bounds: of the guard.
        allowance: how far below zero it may fall.
        least: ``envelope_step`` at that time [s].
    """
    value = guard.value + allowance
    step = max(
        safe_step(value, guard.slope, bounds.second),
        convex_step(value, guard.slope, guard.curvature, bounds.third),
        least,
    )
    if guard.slope >= 0.0:
        step = max(step, 10.0 * TIME_RESOLUTION)
    return step


@compiled
def is_root(guard, allowance, step):
    """Whether a guard ends here, as there is no step left."""
    return guard.slope < 0.0 and (guard.value + allowance <= 0.0 or step < TIME_RESOLUTION)


@compiled
def first_root(segment, end, limit):
    """Time for which a guard stays positive, up to a limit [s].

    Args:
        segment: a ``SEGMENT`` record.
        end: one of END_*, but not ``END_ACTUATOR_IMPACT``.
        limit: [s].

    Returns:
        The time until which it is certain to be positive, whether it is zero there, and the number
        of steps.
    """
    bounds = positive_bounds(segment, end)
    allowance = allowance_of(end)
    time = 0.0
    for number in range(LONGEST_SEARCH):
        guard = guard_at(segment, end, time)
        if allowance > 0.0 and is_above(guard, bounds, allowance):
            allowance = 0.0
        least = envelope_step(guard.slow - bounds.vibration, guard.slow_slope, bounds)
        step = certain_step(guard, bounds, allowance, least)
        if is_root(guard, allowance, step):
            return time, True, number + 1
        time += step
        if not time < limit:
            return limit, False, number + 1
    return time, False, LONGEST_SEARCH


class Strike(NamedTuple):
    """End of a search for the actuator's strike, with the functions that were computed there."""

    time: float  # until which the gap is certain to be open [s]
    struck: bool  # whether it closes there
    steps: int
    turn: Turn  # of the vibration, if it closes
    swing: Swing  # of the nodal plane, if it closes


# Stands for a strike that does not end the segment.
NO_STRIKE = Strike(-1.0, False, 0, NO_TURN, NO_SWING)


@compiled
def is_out_of_reach(envelope, gap, bounds, omega, step):
    """Whether no bound allows a longer step than the envelope does, wherever the vibration is.

    ``certain_step`` is then that of the envelope, and the vibration need not be computed. Steps are
    compared without dividing: each is where a parabola or a line reaches zero.
    """
    reach = bounds.vibration
    fastest = max(gap.v_fm - gap.v_np + omega * reach, 0.0)
    bend = gap.free_mass_acceleration - gap.nodal_plane_acceleration
    most_bent = max(bend, 0.0) + omega * omega * reach
    highest = envelope + 2.0 * reach
    return (
        envelope > NEAR
        and step > 1000.0 * TIME_RESOLUTION
        and 0.5 * bounds.second * step * step > MARGIN * (highest + fastest * step)
        and bounds.third * step > MARGIN * most_bent
    )


@compiled
def first_strike(segment, limit, start):
    """Find when the actuator strikes the free mass, which does not touch it, up to a limit [s].

    The same as ``first_root`` with the gap to the actuator.

    Args:
        segment: a ``SEGMENT`` record.
        limit: [s].
        start: ``Turn`` of the vibration at the segment's start.

    Returns:
        The ``Strike``.
    """
    bounds = positive_bounds(segment, END_ACTUATOR_IMPACT)
    omega = TWO_PI * segment.vibration_frequency
    allowance = TOUCHING
    time = 0.0
    for number in range(LONGEST_SEARCH):
        swing = nodal_plane_swing(segment, time)
        gap = slow_gap(segment, time, swing)
        envelope = gap.u_fm - gap.u_np - bounds.vibration
        step = envelope_step(envelope, gap.v_fm - gap.v_np, bounds)
        if is_out_of_reach(envelope, gap, bounds, omega, step):
            allowance = 0.0
        else:
            turn = start if time == 0.0 else vibration_turn(segment, time)
            guard = gap_to_actuator(segment, gap, turn)
            if allowance > 0.0 and is_above(guard, bounds, allowance):
                allowance = 0.0
            step = certain_step(guard, bounds, allowance, step)
            if is_root(guard, allowance, step):
                return Strike(time, True, number + 1, turn, swing)
        time += step
        if not time < limit:
            return Strike(limit, False, number + 1, start, swing)
    return Strike(time, False, LONGEST_SEARCH, start, swing)


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
def sooner_strike(state, segment, duration, event, start):
    """Return the given duration and event, or those of the actuator's strike if it is sooner.

    ``start`` is the ``Turn`` of the vibration at the segment's start. Also returns the ``Strike``.
    """
    strike = first_strike(segment, duration, start)
    state.effort += strike.steps * STEP_EFFORT
    if strike.time < duration:
        return strike.time, END_ACTUATOR_IMPACT if strike.struck else END_LIMIT, strike
    return duration, event, NO_STRIKE


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
def next_event(drill, state, segment, start):
    """Find the end of the segment, and its duration [s].

    Args:
        drill: the constants.
        state: the moving state.
        segment: the segment that follows from it.
        start: ``Turn`` of the vibration at its start.

    Returns:
        One of END_*, the duration, and the ``Strike`` if that is the end.
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
        return event, duration, NO_STRIKE
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
        duration, event = sooner(state, segment, END_ACTUATOR_RELEASE, duration, event)
        return event, duration, NO_STRIKE
    duration, event, strike = sooner_strike(state, segment, duration, event, start)
    return event, duration, strike
