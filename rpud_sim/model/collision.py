"""Instantaneous collisions: eqs. (4)-(7) and (11)-(13)."""

from rpud_sim.model.compile import compiled


@compiled
def collide(mass_1, velocity_1, mass_2, velocity_2, restitution):
    """Velocities after a collision, eqs. (6) and (13).

    Momentum is conserved, eqs. (4) and (11), and the closing velocity is returned with the
    coefficient of restitution, eqs. (5) and (12).
    """
    whole = 1.0 / (mass_1 + mass_2)
    after_1 = (
        (mass_1 - restitution * mass_2) * velocity_1 + (1.0 + restitution) * mass_2 * velocity_2
    ) * whole
    after_2 = (
        (mass_2 - restitution * mass_1) * velocity_2 + (1.0 + restitution) * mass_1 * velocity_1
    ) * whole
    return after_1, after_2


@compiled
def common_velocity(mass_1, velocity_1, mass_2, velocity_2):
    """Velocity of two bodies that go on together [m/s], eq. (21)."""
    return (mass_1 * velocity_1 + mass_2 * velocity_2) / (mass_1 + mass_2)
