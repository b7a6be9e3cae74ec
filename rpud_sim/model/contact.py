"""Collisions, eqs. (4)-(7), (11)-(13), (21), and the contact in the rock, eqs. (20)-(39).

From the impact on, free mass and drill tool are one body m_fmdt = m_fm + m_eff,dt on k_eff,dt.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.contact_models import LAWS, EffectiveTool
from rpud_sim.model.elementary import arc_tangent, hypotenuse, sin_cos
from rpud_sim.model.parameters import Parameters

# Tangent of the angles that are a short series of it: the next term is less than 1e-19 rad.
_NEARLY_HALF = 1e-3


def effective_tool(parameters: Parameters) -> EffectiveTool:
    """Return the drill tool in the rock by the chosen contact model."""
    if parameters.contact_model == "given":
        return EffectiveTool(parameters.effective_tool_mass, parameters.effective_tool_spring_rate)
    sections = (
        (parameters.section_1_area, parameters.section_1_length),
        (parameters.section_2_area, parameters.section_2_length),
    )
    rates = (parameters.elastic_modulus * area / length for area, length in sections)  # eq. (20)
    masses = (parameters.drill_tool_density * area * length for area, length in sections)
    _, law = LAWS[parameters.contact_model]
    return law(*rates, *masses)


@compiled
def collide(mass_1, velocity_1, mass_2, velocity_2, restitution):
    """Velocities after a collision, eqs. (6) and (13)."""
    whole = 1.0 / (mass_1 + mass_2)
    after_1 = (mass_1 - restitution * mass_2) * velocity_1
    after_1 += (1.0 + restitution) * mass_2 * velocity_2
    after_2 = (mass_2 - restitution * mass_1) * velocity_2
    after_2 += (1.0 + restitution) * mass_1 * velocity_1
    return after_1 * whole, after_2 * whole


@compiled
def common_velocity(mass_1, velocity_1, mass_2, velocity_2):
    """Velocity of two bodies that continue together [m/s], eq. (21)."""
    return (mass_1 * velocity_1 + mass_2 * velocity_2) / (mass_1 + mass_2)


class Contact(NamedTuple):
    """Contact in the rock after an impact at t_j, which nothing disturbs."""

    displacement: float  # u'_dt(t_j) [m]
    velocity: float  # v'_dt(t_j) [m/s]
    free_mass: float  # m_fm [kg]
    tool: EffectiveTool
    gravity: float  # g [m/s^2]

    @property
    def _swing(self) -> tuple[float, float, float, float]:
        """omega_fmdt of eq. (32), the deformation at rest, and cosine and sine about it [m]."""
        omega = math.sqrt(self.tool.spring_rate / (self.free_mass + self.tool.mass))
        rest = self.free_mass * self.gravity / self.tool.spring_rate
        return omega, rest, self.displacement - rest, self.velocity / omega

    def deformation(self, time: float) -> tuple[float, float]:
        """Axial deformation eta of the drill tool [m] and eta'' [m/s^2], eq. (36)."""
        omega, rest, along, across = self._swing
        sine, cosine = sin_cos(omega * time)
        eta = rest + across * sine + along * cosine
        return eta, -omega * self.velocity * sine - omega * omega * along * cosine

    @property
    def time_of_maximum(self) -> float:
        """t_max - t_j, when compression and contact force are greatest [s], eq. (38).

        The paper prints the principal value, which is negative; this is the first maximum.
        """
        omega, _, along, across = self._swing
        angle: float = arc_tangent(across, along)
        return (angle + 2.0 * math.pi if angle < 0.0 else angle) / omega

    @property
    def duration(self) -> float:
        """t_con, when the deformation is again what it was at the impact [s], eq. (39)."""
        return 2.0 * self.time_of_maximum

    @property
    def peak_displacement(self) -> float:
        """Displacement of the drill tool's upper side at the maximum [m]."""
        return self.deformation(self.time_of_maximum)[0]

    @property
    def peak_force(self) -> float:
        """Contact force at its maximum [N], eqs. (30), (36) and (38)."""
        omega, _, along, across = self._swing
        pull: float = omega * omega * hypotenuse(along, across)
        return self.free_mass * (self.gravity + pull)


def single_contact(parameters: Parameters, impact_velocity: float) -> Contact:
    """Return the contact after a blow on the resting drill tool; the velocity is in m/s."""
    tool, free_mass = effective_tool(parameters), parameters.free_mass
    velocity = free_mass * impact_velocity / (free_mass + tool.mass)  # eq. (21)
    return Contact(0.0, velocity, free_mass, tool, parameters.gravity)


@compiled
def release_time(cosine, sine, angular_frequency, gravity):
    """Time until the contact force returns to zero [s]; infinite for a mass at rest on the tool.

    The deformation about its rest is cosine cos(w s) + sine sin(w s). The force vanishes where the
    acceleration reaches gravity: after a blow on a tool at rest, about g m_eff / (k v)
    after eq. (39), v being the common velocity. That is 105 ps for the default drill at 3 m/s,
    and infinitely late where the mass stays on the tool.
    """
    lift = gravity / (angular_frequency * angular_frequency)
    square = cosine * cosine + sine * sine - lift * lift
    if not square > 0.0:
        return math.inf
    # The point (cosine, -sine) turns until it is (-lift, root).
    root = math.sqrt(square)
    across = cosine * root - sine * lift
    along = -cosine * lift - sine * root
    if abs(across) < -_NEARLY_HALF * along:
        ratio = across / along
        near = ratio * ratio
        angle = math.pi + ratio * (1.0 - near * (1.0 / 3.0 - 0.2 * near))
    else:
        angle = arc_tangent(across, along)
    if angle < 0.0 and sine > 0.0:
        angle += 2.0 * math.pi
    return max(angle, 0.0) / angular_frequency


@compiled
def release_turn(cosine, sine, angular_frequency, gravity):
    """Cosine and sine of the angle w s at that time, without the angle; arguments the same."""
    lift = gravity / (angular_frequency * angular_frequency)
    square = cosine * cosine + sine * sine
    root = math.sqrt(max(square - lift * lift, 0.0))
    whole = 1.0 / square
    return -(lift * cosine + root * sine) * whole, (root * cosine - lift * sine) * whole


@compiled
def half_sine_impulse(mass_1, mass_2, restitution, closing_velocity, spring_rate):
    """Estimate the force of a collision: peak force [N], duration [s] and impulse [N s].

    An addition to the paper, whose Section III has none: the impulse of eq. (13) as a half sine, as
    long as the half sine of the two masses on the drill tool's spring.
    """
    reduced_mass = mass_1 * mass_2 / (mass_1 + mass_2)
    impulse = (1.0 + restitution) * reduced_mass * closing_velocity
    duration = math.pi * math.sqrt(reduced_mass / spring_rate)
    return 0.5 * math.pi * impulse / duration, duration, impulse
