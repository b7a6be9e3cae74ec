"""Contact of the free mass with the drill tool in the rock, by the energy balance: eqs. (20)-(39).

The bottom of the drill tool is fixed; its two sections are springs. From the impact on, free mass
and drill tool move as one body of mass m_fmdt = m_fm + m_eff,dt on the spring k_eff,dt.
"""

import math
from typing import NamedTuple

from rpud_sim.model.compile import compiled
from rpud_sim.model.elementary import arc_tangent, hypotenuse, sin_cos

# Tangent of the angles that are a short series of it: the next term is less than 1e-19 rad.
_NEARLY_HALF = 1e-3


class EffectiveTool(NamedTuple):
    """The drill tool as one mass on one spring."""

    mass: float  # m_eff,dt [kg]
    spring_rate: float  # k_eff,dt [N/m]


def section_spring_rate(elastic_modulus, area, length):
    """k_dt1 or k_dt2 [N/m], eq. (20)."""
    return elastic_modulus * area / length


def printed_tool(k_1, k_2, m_1, m_2):
    """The drill tool with eqs. (22) and (27) as printed.

    The two terms of eq. (22) belong to two different mode shapes; ``mode_shape_tool`` and
    ``rayleigh_tool`` are the consistent forms of each.

    Args:
        k_1: spring rate of part I [N/m].
        k_2: spring rate of part II [N/m].
        m_1: mass of part I [kg].
        m_2: mass of part II [kg].
    """
    both = k_1 + k_2
    mass = ((k_1 * k_1 + 3.0 * k_1 * k_2 + 3.0 * k_2 * k_2) * m_1 + k_1 * k_1 * m_2) / (
        3.0 * both * both
    )
    spring_rate = (k_1 * k_1 - k_1 * k_2 + k_2 * k_2) / both
    return EffectiveTool(mass, spring_rate)


def rayleigh_tool(k_1, k_2, m_1, m_2):
    """The drill tool by Rayleigh's method: the static shape of two springs in series.

    That shape has f(L_dt1) = k_1 / (k_1 + k_2) and the spring rate k_1 k_2 / (k_1 + k_2).
    Arguments as for ``printed_tool``.
    """
    mass = _mass_of_shape(k_1 / (k_1 + k_2), m_1, m_2)
    return EffectiveTool(mass, k_1 * k_2 / (k_1 + k_2))


def mode_shape_tool(k_1, k_2, m_1, m_2):
    """The drill tool with the mode shape of eq. (24) as printed, in mass and spring rate.

    That shape has f(L_dt1) = k_2 / (k_1 + k_2). Its strain energy, eq. (26), gives the spring rate
    of eq. (27), and its kinetic energy, eq. (25), the mass that eq. (22) has with one index
    changed. Arguments as for ``printed_tool``.
    """
    mass = _mass_of_shape(k_2 / (k_1 + k_2), m_1, m_2)
    return EffectiveTool(mass, printed_tool(k_1, k_2, m_1, m_2).spring_rate)


def _mass_of_shape(shape, m_1, m_2):
    """m_eff,dt [kg] of a mode shape with f(L_dt1) = shape, eq. (25)."""
    return ((1.0 + shape + shape * shape) * m_1 + shape * shape * m_2) / 3.0


@compiled
def natural_frequency(free_mass, tool_mass, tool_spring_rate):
    """omega_fmdt [rad/s], eq. (32)."""
    return math.sqrt(tool_spring_rate / (free_mass + tool_mass))


@compiled
def deformation(time, displacement, velocity, free_mass, tool_mass, tool_spring_rate, gravity):
    """Axial deformation of the drill tool during a contact, eq. (36).

    Args:
        time: since the impact, t - t_j [s].
        displacement: u'_dt(t_j) [m].
        velocity: v'_dt(t_j) [m/s].
        free_mass: m_fm [kg].
        tool_mass: m_eff,dt [kg].
        tool_spring_rate: k_eff,dt [N/m].
        gravity: g [m/s^2].

    Returns:
        eta [m] and its second derivative [m/s^2].
    """
    omega = natural_frequency(free_mass, tool_mass, tool_spring_rate)
    rest = free_mass * gravity / tool_spring_rate
    sine, cosine = sin_cos(omega * time)
    eta = rest + velocity / omega * sine + (displacement - rest) * cosine
    acceleration = -omega * velocity * sine - omega * omega * (displacement - rest) * cosine
    return eta, acceleration


@compiled
def contact_force(acceleration, free_mass, gravity):
    """F_cf = m_fm (g - eta'') [N], eq. (30)."""
    return free_mass * (gravity - acceleration)


@compiled
def time_of_maximum(displacement, velocity, free_mass, tool_mass, tool_spring_rate, gravity):
    """t_max - t_j, when compression and contact force are greatest [s], eq. (38).

    The principal value of the arctangent printed in the paper is negative; this is the first
    maximum after the impact. Arguments as for ``deformation``.
    """
    omega = natural_frequency(free_mass, tool_mass, tool_spring_rate)
    rest = free_mass * gravity / tool_spring_rate
    angle = arc_tangent(velocity / omega, displacement - rest)
    if angle < 0.0:
        angle += 2.0 * math.pi
    return angle / omega


@compiled
def contact_time(displacement, velocity, free_mass, tool_mass, tool_spring_rate, gravity):
    """t_con, when the deformation is again what it was at the impact [s], eq. (39)."""
    return 2.0 * time_of_maximum(
        displacement, velocity, free_mass, tool_mass, tool_spring_rate, gravity
    )


@compiled
def force_at_maximum(displacement, velocity, free_mass, tool_mass, tool_spring_rate, gravity):
    """Greatest force of a contact that is left undisturbed [N], eqs. (30), (36) and (38)."""
    omega = natural_frequency(free_mass, tool_mass, tool_spring_rate)
    rest = free_mass * gravity / tool_spring_rate
    return free_mass * (gravity + omega * omega * hypotenuse(displacement - rest, velocity / omega))


@compiled
def release_time(cosine, sine, angular_frequency, gravity):
    """Time until the contact force returns to zero [s]; infinite for a mass at rest on the tool.

    The deformation about its rest is cosine cos(w s) + sine sin(w s). The force vanishes where the
    acceleration reaches that of gravity; for a real impact this is some attoseconds to picoseconds
    after eq. (39).

    Args:
        angular_frequency: w = omega_fmdt [rad/s].
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

    Section III of the paper treats the impact on the drill tool as instantaneous and gives no
    contact force. Here the impulse of eq. (13) is spread over a half sine whose duration is that
    of the two masses on the drill tool's effective spring. This is an estimate added to the paper.
    """
    reduced_mass = mass_1 * mass_2 / (mass_1 + mass_2)
    impulse = (1.0 + restitution) * reduced_mass * closing_velocity
    duration = math.pi * math.sqrt(reduced_mass / spring_rate)
    return 0.5 * math.pi * impulse / duration, duration, impulse
