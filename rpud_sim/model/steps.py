"""Steps within which a guard cannot reach zero.

A guard whose second derivative is bounded by B cannot fall from a value g with a slope g' to zero
within

    step = (g' + sqrt(g'^2 + 2 B g)) / B

Two longer steps are as safe: while the second derivative is certain to stay positive, by a bound on
the third, the guard lies above its tangent; and a guard in which the tip vibrates is at least its
slowly changing envelope.
"""

import math

from rpud_sim.model.compile import compiled
from rpud_sim.model.guards import (
    END_ACTUATOR_IMPACT,
    END_DRILL_TOOL_IMPACT,
    END_DRILL_TOOL_REST,
    Bounds,
    guard_bounds,
)
from rpud_sim.model.tolerances import TIME_RESOLUTION, TOUCHING, WEAKEST_PULL

# A guard that does not bend still needs a bound to divide by [m/s^2 or N/s^2].
LEAST_BOUND = 1e-9


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
    return guard.value + guard.slope * guard.slope / (2.0 * bounds.second) > allowance


@compiled
def envelope_step(envelope, slow_slope, bounds):
    """Time within which an envelope cannot reach zero [s]; zero if it is not above it."""
    return safe_step(envelope, slow_slope, bounds.slow_second) if envelope > 0.0 else 0.0


@compiled
def certain_step(guard, bounds, allowance, least):
    """Time within which a guard cannot fall below the allowance [s].

    Args:
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
