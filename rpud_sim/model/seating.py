"""Seating: the transition of a free drill tool into the rock.

Before drilling the tool may be millimetres from zero and moving; in the rock it is at zero between
contacts. Stiff rock that took hold at once would throw it back with energy that has no source. So
the spring that holds the tool stiffens step by step, from the restoring spring to the tool's own
elasticity. Positions and velocities stay continuous and the bodies follow. The energy that this
adds is small and soon damped.
"""

from __future__ import annotations

from rpud_sim.model.drill import ROCK_DAMPING_RATIO, Drill
from rpud_sim.model.elementary import power
from rpud_sim.model.suspension import damping_coefficient

# Assumed, as the paper has no such transition: many periods of tool and drill, so that both follow,
# and a small part of the time for which a user drills.
SEATING_TIME = 0.1  # [s]
SEATING_STEPS = 20


def seating(before: Drill, after: Drill) -> list[tuple[float, Drill]]:
    """Return the constants of each step, with the time of the step after the change [s].

    The last step has the requested constants. The steps before it are as before drilling: the
    impacts of eqs. (11)-(13) and the suspension of eq. (14). Only the change of a free drill tool
    to one in the rock takes steps; every other change takes effect at once.
    """
    if before.in_rock or not after.in_rock:
        return [(0.0, after)]
    steps = []
    for step in range(1, SEATING_STEPS):
        share = step / SEATING_STEPS
        spring_rate = power(before.tool_spring_rate, 1.0 - share) * power(
            after.tool_spring_rate, share
        )
        drill = after._replace(
            in_rock=False,
            tool_mass=before.tool_mass,
            tool_spring_rate=spring_rate,
            tool_damping=damping_coefficient(ROCK_DAMPING_RATIO, before.tool_mass, spring_rate),
        )
        steps.append((SEATING_TIME * (share - 1.0 / SEATING_STEPS), drill))
    return [*steps, (SEATING_TIME, after)]
