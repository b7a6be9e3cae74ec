"""Search for the actuator's strike: the engine's most frequent one.

It makes the same steps as every search (steps.py), with less work: it does not compute the
vibration where that cannot shorten a step, and hands on what it has computed at the strike.
"""

from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.guards import END_ACTUATOR_IMPACT, gap_to_actuator, slow_gap
from rpud_sim.model.segment import nodal_plane_swing, vibration_turn
from rpud_sim.model.steps import (
    certain_step,
    envelope_step,
    is_above,
    is_root,
    positive_bounds,
)
from rpud_sim.model.suspension import NO_SWING, Swing
from rpud_sim.model.tolerances import LONGEST_SEARCH, TIME_RESOLUTION, TOUCHING
from rpud_sim.model.vibration import NO_TURN, TWO_PI, Turn

# Where the envelope is this near to zero, the vibration is computed [m]; and a step counts as
# longer than another if it is so by more than rounding.
NEAR = 1e-11
MARGIN = 1.0 + 1e-6


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
