"""Free flight of the free mass: eqs. (10), (17) and (19)."""

from rpud_sim.model.compile import compiled


@compiled
def fall(position, velocity, gravity, time):
    """Position [m] and velocity [m/s] of the free mass after a time of flight [s], eq. (10)."""
    u_fm = position + velocity * time + 0.5 * gravity * time * time
    v_fm = velocity + gravity * time
    return u_fm, v_fm
