"""A flight of our trajectory, from which other programs begin, and the impacts that follow it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from rpud_sim.simulation.sampling import Times
from rpud_sim.simulation.simulation import Block

LONG = 1e-4  # a flight that leaves room for another program's first step [s]
COUNTED = 0.1  # slower blows are part of a contact that lasts, for programs without one [m/s]
SAME = 1e-7  # how near two impacts are that agree [s]


class Bodies(NamedTuple):
    """Positions [m] and velocities [m/s] of nodal plane, free mass and drill tool."""

    u_np: float
    v_np: float
    u_fm: float
    v_fm: float
    u_dt: float
    v_dt: float


class Flight(NamedTuple):
    """State in the middle of a flight.

    Attributes:
        bodies: at that time.
        phase: of the vibration at that time [cycles].
        impact_times: from that time to each impact on the drill tool that follows [s].
    """

    bodies: Bodies
    phase: float
    impact_times: np.ndarray


def first_flight(block: Block) -> Flight:
    """Return the first long flight of a block."""
    flights = block.covering[block.covering["contact"] == 0]
    flight = flights[np.argmax(flights["duration"] > LONG)]
    middle = 0.5 * float(flight["duration"])
    seconds, fraction = int(flight["start_seconds"]), float(flight["start_fraction"]) + middle
    at = block.sample(Times(np.array([seconds]), np.array([fraction])))
    bodies = Bodies(
        at.nodal_plane_position[0],
        at.nodal_plane_velocity[0],
        at.free_mass_position[0],
        at.free_mass_velocity[0],
        at.drill_tool_displacement[0],
        at.drill_tool_velocity[0],
    )
    phase = float(flight["vibration_phase"] + middle * flight["vibration_frequency"])
    impacts = block.impacts[block.impacts["impact_velocity"] > COUNTED]
    times = (impacts["seconds"] - seconds) + (impacts["fraction"] - fraction)
    return Flight(bodies, phase, times[times > 0.0])


def agreeing(ours: np.ndarray, theirs: np.ndarray) -> int:
    """Return how many impacts come at the same times until the first that does not."""
    count = min(len(ours), len(theirs))
    apart = np.abs(ours[:count] - theirs[:count]) > SAME
    return int(np.argmax(apart)) if apart.any() else count
