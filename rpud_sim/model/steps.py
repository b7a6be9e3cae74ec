"""Steps within which a guard cannot reach zero.

A guard whose second derivative is at least m stays above the parabola

    g + g' s + m s^2 / 2

so that it cannot reach zero before the parabola does. The least m is from a bound for the whole
segment. A bound J on the third derivative gives a greater one, g'' - J s, up to a time s at which
even a parabola of the current curvature is zero. And a guard in which the tip vibrates is at least
its slowly changing envelope.

Near a simple root the steps converge to it from the left. The last one is that which leads to
within ``TIME_RESOLUTION`` of it: what the greatest curvature would add to the parabola is known.
"""

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.tolerances import TIME_RESOLUTION

# A guard that does not bend still needs a bound to divide by [m/s^2 or N/s^2].
LEAST_BOUND = 1e-9

# Least step of a guard that does not fall [s].
_LEAST_STEP = 10.0 * TIME_RESOLUTION


class Step(NamedTuple):
    """A step within which a guard cannot reach zero."""

    time: float  # [s]
    ends: bool  # whether its end is within TIME_RESOLUTION of a root


@compiled
def safe_step(value, slope, bend):
    """Time within which a guard cannot reach zero if its second derivative is at least this [s]."""
    value = max(value, 0.0)
    bent = bend * value
    square = slope * slope
    if bent < -square:
        root = math.sqrt(square - 2.0 * bent)
        return 2.0 * value / (root - slope) if slope < 0.0 else (slope + root) / -bend
    # Without the root, and a little short of the parabola's zero: Halley's step, or twice the time
    # to its crest. In one division, as to guess which it is takes as long.
    falls = slope < 0.0
    numerator = -2.0 * slope * value if falls else 2.0 * slope
    whole = 2.0 * square - bent if falls else -bend
    ends = whole > 0.0
    time = numerator / (whole if ends else 1.0)
    return time if ends else math.inf


@compiled
def is_clear(value, slope, second, time):
    """Whether a guard that is above zero is certain to be so up to a time."""
    return value > 0.0 and value + time * (slope - 0.5 * second * time) > 0.0


@compiled
def ends_at_root(value, slope, step, least_bend, most_bend):
    """Whether a ``safe_step`` of the least bend ends within TIME_RESOLUTION of a root.

    ``most_bend`` is the greatest second derivative within it.
    """
    # There the parabola has this height times (2 / slope)^2.
    parabola = least_bend * least_bend * max(value, 0.0) * step * step
    # Above it the guard has at most this height, and falls at least so fast.
    height = 0.5 * (most_bend - least_bend) * step * step
    speed = -slope - most_bend * step
    square = slope * slope
    return slope < 0.0 and 0.25 * parabola < (TIME_RESOLUTION * speed - height) * square


@compiled
def step_with_curvature(value, slope, curvature, second, third):
    """Return the ``Step`` that follows from bounds on the second and third derivative."""
    reach = safe_step(value, slope, curvature)
    if reach == math.inf:
        reach = curvature / third
    bend = curvature - third * reach
    # Less than the bound for the whole segment it cannot be; and where the third derivative has
    # none, it is that.
    if not bend > -second:
        bend = -second
        reach = math.inf
    time = safe_step(value, slope, bend)
    if time > reach:
        return Step(max(reach, safe_step(value, slope, -second)), False)
    most = min(second, curvature + third * time)
    ends = ends_at_root(value, slope, time, bend, most)
    return Step(time, ends)


@compiled
def is_above(value, slope, second, allowance):
    """Whether a guard is certain to rise above an allowance before it can fall."""
    if slope <= 0.0 or value > allowance:
        return value > allowance
    return slope * slope > 2.0 * second * (allowance - value)


@compiled
def at_least(step, slope, least):
    """Return a ``Step`` that is at least as long as others, which lead to no root [s]."""
    if slope >= 0.0:
        least = max(least, _LEAST_STEP)
    return Step(least, False) if least > step.time else step


@compiled
def is_root(value, slope, step):
    """Whether a guard ends here, as there is no step left."""
    return slope < 0.0 and (value <= 0.0 or step.time < TIME_RESOLUTION)


# How a search is after a step: it continues, the guard is zero, or it is positive up to the limit.
RUNNING, MET, CLEAR = 0, 1, 2


@compiled
def after_step(time, step, is_root, limit):
    """Time after a step, and how the search is there; where the guard has its root it is over."""
    if is_root:
        return time, MET
    time += step.time
    if not time < limit:
        return limit, CLEAR
    return time, MET if step.ends else RUNNING
