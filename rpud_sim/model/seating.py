"""Seating: how the rock takes hold of a drill tool that has been free.

Before drilling the tool may be millimetres from zero and moving; in the rock it is at zero between
contacts. Stiff rock that took hold at once would throw it back with joules that nobody has put in.
So the drill is fed into the rock: the spring that holds the tool stiffens step by step from the
restoring spring to the tool's own elasticity. Positions and velocities are continuous all the
while, the bodies follow, and what the feed puts in is little and soon damped.
"""

from __future__ import annotations

from rpud_sim.model.drill import ROCK_DAMPING_RATIO, Drill
from rpud_sim.model.suspension import damping_coefficient

# Assumed, as the paper has no such transition: long beside the periods of tool and drill, so that
# both follow, and short beside what a user calls drilling.
SEATING_TIME = 0.1  # [s]
SEATING_STEPS = 20


def seating(before: Drill, after: Drill) -> list[tuple[float, Drill]]:
    """Return through which constants the drill goes, and when after the change [s].

    The last ones are those asked for. The steps before them are as before drilling: the impacts of
    eqs. (11)-(13) and the suspension of eq. (14). Any change but that of a free drill tool to one
    in the rock is done at once.

    Args:
        before: the present constants.
        after: the constants asked for.
    """
    if before.in_rock or not after.in_rock:
        return [(0.0, after)]
    steps = []
    for step in range(1, SEATING_STEPS):
        share = step / SEATING_STEPS
        spring_rate = before.tool_spring_rate ** (1.0 - share) * after.tool_spring_rate**share
        drill = after._replace(
            in_rock=False,
            tool_mass=before.tool_mass,
            tool_spring_rate=spring_rate,
            tool_damping=damping_coefficient(ROCK_DAMPING_RATIO, before.tool_mass, spring_rate),
        )
        steps.append((SEATING_TIME * (share - 1.0 / SEATING_STEPS), drill))
    return [*steps, (SEATING_TIME, after)]
