"""Arm: quasi-static motion of a mount between a feed and the load spring, in closed form.

The mount has no mass: (c_a + c_1) dx/dt = A(x) - L(x), c_a the friction of its guide, c_1 the
damping of the load spring. A is the force of a spring k_a behind a play, whose host slips at the
anchoring force. L is k_1 (x - o), o the origin of the RPUD's displacement, less the mean k_1 u_np +
c_1 v_np during a step. A - L falls with x, linearly between its knots, so the mount moves in one
direction, by an exponential from knot to knot.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from typing import NamedTuple

from rpud_sim.model.elementary import exponential_minus_one, logarithm_one_plus


@dataclasses.dataclass(frozen=True)
class Arm:
    """Constants of the arm."""

    stiffness: float  # k_a [N/m]; 0 for a rigid arm
    damping: float  # c_a [N s/m], above 0
    half_play: float  # half of the whole play [m]
    anchoring: float  # force above which the host slips [N]

    @functools.cached_property
    def reach(self) -> float:
        """Greatest distance of the mount from its place at rest [m]."""
        if self.stiffness == 0.0:
            return self.half_play
        return self.half_play + self.anchoring / self.stiffness

    def stretch(self, deflection: float) -> float:
        """Deflection beyond the play [m]."""
        if deflection > self.half_play:
            return deflection - self.half_play
        behind = deflection + self.half_play
        return behind if behind < 0.0 else 0.0

    def stored(self, deflection: float) -> float:
        stretch = self.stretch(deflection)
        return 0.5 * self.stiffness * stretch * stretch


class SpringLoad(NamedTuple):
    """Force of the drill on the mount, away from the rock, by the mount's position."""

    spring_rate: float  # rate of the load spring [N/m]
    damping: float  # damping of the load spring [N s/m]
    origin: float  # position of the mount at which the load spring has no preload [m]
    push: float  # constant force toward the rock [N]

    def force(self, position: float) -> float:
        """Force on a mount at rest [N]."""
        return self.spring_rate * (position - self.origin) - self.push

    def work(self, start: float, end: float) -> float:
        """Work of this force on the drill in a motion [J]."""
        return 0.5 * (self.force(start) + self.force(end)) * (end - start)


class Move(NamedTuple):
    """Motion of the mount, with its energies."""

    position: float  # position of the mount at the end [m]
    slipped: float = 0.0  # travel of the host [m]
    damper: float = 0.0  # energy that friction of the guide and damping of the load spring took [J]
    slip: float = 0.0  # energy that the host's slipping took [J]
    work: float = 0.0  # work on the drill [J]
    shift_work: float = 0.0  # work that moved the place at rest [J]


def move_freely(arm: Arm, load: SpringLoad, position: float, rest: float, interval: float) -> Move:
    """Return the motion of the mount in an interval [s] in which nothing else moves.

    It begins within the arm's reach of ``rest``, where the arm is not deflected; an infinite
    interval gives the equilibrium.
    """
    start = position
    reach, half_play = arm.reach, arm.half_play
    knots = (rest - half_play, rest + half_play, rest - reach, rest + reach)
    damping = arm.damping + load.damping
    damper = 0.0
    while interval > 0.0:
        net = _net_force(arm, load, position, rest)
        if net == 0.0:
            break
        away = 1.0 if net > 0.0 else -1.0
        ahead = [travel for knot in knots if (travel := (knot - position) * away) > 0.0]
        distance = min(ahead, default=math.inf)
        deflection = position + away * (0.5 * distance if ahead else 1.0) - rest
        between = arm.half_play < abs(deflection) < reach
        # By which A - L falls with the position, up to the next knot [N/m].
        steepness = load.spring_rate + arm.stiffness if between else load.spring_rate
        length = min(_duration(damping, net * away, steepness, distance), interval)
        if steepness == 0.0:
            damper += net * net * length / damping
            travel = net * away * length / damping
        else:
            decay = -exponential_minus_one(-2.0 * steepness * length / damping)
            damper += 0.5 * net * net / steepness * decay
            end = -exponential_minus_one(-steepness * length / damping)
            travel = net * away / steepness * end
        travel = distance if length < interval else min(travel, distance)
        position += away * travel
        interval -= length
        if length == math.inf:
            break
    slipped = _excess(arm, position, rest)
    slip = arm.anchoring * abs(slipped)
    return Move(position, slipped, damper, slip, load.work(start, position))


def move_rest_position(
    arm: Arm, load: SpringLoad, position: float, rest: float, new_rest: float
) -> Move:
    """Return the motion of the mount while its place at rest jumps.

    A rigid arm carries the mount along; the host slips where that takes more than the anchoring
    force. Another arm is deflected.
    """
    if arm.stiffness > 0.0:
        before = arm.stored(position - rest)
        slipped = _excess(arm, position, new_rest)
        slip = arm.anchoring * abs(slipped)
        after = arm.stored(position - (new_rest + slipped))
        return Move(position, slipped, 0.0, slip, 0.0, after - before + slip)
    target = min(max(position, new_rest - arm.half_play), new_rest + arm.half_play)
    end = _held(arm, load, position, target)
    slip = arm.anchoring * abs(target - end)
    work = load.work(position, end)
    return Move(end, end - target, 0.0, slip, work, work + slip)


def arm_force(arm: Arm, load: SpringLoad, position: float, rest: float) -> float:
    """Return the force of the arm on the mount, toward the rock [N]."""
    if arm.stiffness > 0.0:
        return -arm.stiffness * arm.stretch(position - rest)
    held = load.force(position)
    if _in_play(arm, position, rest, -held):
        return 0.0
    return min(max(held, -arm.anchoring), arm.anchoring)


def _net_force(arm: Arm, load: SpringLoad, position: float, rest: float) -> float:
    """Return A - L in the direction in which the mount would move [N]; zero if it is held."""
    driving = -load.force(position)
    if arm.stiffness > 0.0:
        elastic = arm.stiffness * arm.stretch(position - rest)
        elastic = min(max(elastic, -arm.anchoring), arm.anchoring)
        return driving - elastic
    if _in_play(arm, position, rest, driving):
        return driving
    excess = abs(driving) - arm.anchoring
    return math.copysign(excess, driving) if excess > 0.0 else 0.0


def _in_play(arm: Arm, position: float, rest: float, driving: float) -> bool:
    """Return whether the play of a rigid arm lets a force drive the mount further."""
    # Compared with the knots themselves: the end of the play that is reached must count.
    if driving > 0.0:
        return position < rest + arm.half_play
    return position > rest - arm.half_play


def _duration(damping: float, net: float, steepness: float, distance: float) -> float:
    """Return the time in which a net force moves the mount over a distance [s]."""
    left = net - steepness * distance
    if distance == math.inf or left <= 0.0:
        return math.inf
    if steepness == 0.0:
        return damping * distance / net
    return -damping / steepness * logarithm_one_plus(-steepness * distance / net)


def _excess(arm: Arm, position: float, rest: float) -> float:
    deflection = position - rest
    excess = abs(deflection) - arm.reach
    return math.copysign(excess, deflection) if excess > 0.0 else 0.0


def _held(arm: Arm, load: SpringLoad, position: float, target: float) -> float:
    """Return how far a rigid arm carries the mount before its host slips [m]."""
    if load.spring_rate == 0.0:
        return target
    if target > position:
        end = load.origin + (load.push + arm.anchoring) / load.spring_rate
        return min(target, max(position, end))
    end = load.origin + (load.push - arm.anchoring) / load.spring_rate
    return max(target, min(position, end))
