"""Single contact of the free mass with the drill tool in the rock: eqs. (20)-(39)."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from rpud_sim.model import contact
from rpud_sim.model.collision import common_velocity
from rpud_sim.model.drill import effective_tool
from rpud_sim.model.parameters import Parameters


@dataclasses.dataclass(frozen=True)
class Contact:
    """Result of one blow on the resting drill tool, by the energy balance."""

    tool_mass: float  # m_eff,dt [kg]
    tool_spring_rate: float  # k_eff,dt [N/m]
    peak_force: float  # greatest contact force [N]
    peak_displacement: float  # of the drill tool's upper side [m]
    duration: float  # t_con of eq. (39) [s].
    restitution: float  # velocity of the free mass after the contact over that before


def single_contact(parameters: Parameters, impact_velocity: float) -> Contact:
    """Return the contact after a blow on the resting drill tool.

    Args:
        parameters: of the drill, with its contact model.
        impact_velocity: of the free mass [m/s].
    """
    tool = effective_tool(parameters)
    start = _start(parameters, impact_velocity)
    summit, _ = contact.deformation(contact.time_of_maximum(*start), *start)
    return Contact(
        tool_mass=tool.mass,
        tool_spring_rate=tool.spring_rate,
        peak_force=contact.force_at_maximum(*start),
        peak_displacement=summit,
        duration=contact.contact_time(*start),
        restitution=start[1] / impact_velocity,
    )


def contact_history(
    parameters: Parameters, impact_velocity: float, times: Sequence[float] | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the tool's displacement [m] and the contact force [N], eqs. (30) and (36).

    Args:
        impact_velocity: of the free mass [m/s].
        times: since the impact, within the contact, shape (n,) [s].
    """
    start = _start(parameters, impact_velocity)
    displacement = np.empty(len(times))
    force = np.empty(len(times))
    for i, time in enumerate(times):
        displacement[i], acceleration = contact.deformation(float(time), *start)
        force[i] = contact.contact_force(acceleration, parameters.free_mass, parameters.gravity)
    return displacement, force


def _start(
    parameters: Parameters, impact_velocity: float
) -> tuple[float, float, float, float, float, float]:
    tool = effective_tool(parameters)
    velocity = common_velocity(parameters.free_mass, float(impact_velocity), tool.mass, 0.0)
    return 0.0, velocity, parameters.free_mass, tool.mass, tool.spring_rate, parameters.gravity
