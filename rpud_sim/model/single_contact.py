"""Single contact of the free mass with the drill tool in the rock: eqs. (20)-(39)."""

from __future__ import annotations

import dataclasses

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
    duration: float  # t_con of eq. (39) [s]


def single_contact(parameters: Parameters, impact_velocity: float) -> Contact:
    """Return the contact after a blow on the resting drill tool; the velocity is in m/s."""
    tool = effective_tool(parameters)
    velocity = common_velocity(parameters.free_mass, float(impact_velocity), tool.mass, 0.0)
    start = 0.0, velocity, parameters.free_mass, tool.mass, tool.spring_rate, parameters.gravity
    peak_displacement, _ = contact.deformation(contact.time_of_maximum(*start), *start)
    return Contact(
        tool_mass=tool.mass,
        tool_spring_rate=tool.spring_rate,
        peak_force=contact.force_at_maximum(*start),
        peak_displacement=peak_displacement,
        duration=contact.contact_time(*start),
    )
