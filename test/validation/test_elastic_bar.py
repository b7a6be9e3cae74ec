"""The elastic bar against exact waves, by the method of characteristics."""

import numpy as np
import pytest

from rpud_sim.simulation import preset
from validation.elastic_bar import strike

DRILL = preset("drilling").replace(gravity=0.0)
SPEED = 5.0


def wave_speed(drill):
    return np.sqrt(drill.elastic_modulus / drill.drill_tool_density)


def waves(drill, speed, steps, stop):
    """Restitution and greatest displacement by the method of characteristics.

    Waves pass through both sections unchanged and are split at the step; the mass is integrated
    implicitly with as many steps as part I has.
    """
    step = drill.section_1_length / wave_speed(drill) / steps
    # Wave impedance of part I [N s/m]
    upper = drill.section_1_area * np.sqrt(drill.elastic_modulus * drill.drill_tool_density)
    lower = upper * drill.section_2_area / drill.section_1_area
    reflected = (upper - lower) / (upper + lower)
    rest = round(drill.section_2_length / wave_speed(drill) / step)
    down_1, up_1, down_2, up_2 = (np.zeros(n) for n in (steps, steps, rest, rest))
    velocity, mass_position, tip_position, touching, greatest = speed, 0.0, 0.0, True, 0.0
    for _ in range(int(stop / step)):
        arriving, at_step, at_rock, from_rock = up_1[0], down_1[-1], down_2[-1], up_2[0]
        down_1, down_2 = np.roll(down_1, 1), np.roll(down_2, 1)
        up_1, up_2 = np.roll(up_1, -1), np.roll(up_2, -1)
        up_1[-1] = reflected * at_step + (1.0 - reflected) * from_rock
        down_2[0] = (1.0 + reflected) * at_step - reflected * from_rock
        up_2[-1] = -at_rock
        force = 0.0
        if touching:
            pushed = drill.free_mass * velocity + 2.0 * step * upper * arriving
            together = pushed / (drill.free_mass + upper * step)
            force = upper * (together - 2.0 * arriving)
            touching = force > 0.0
        force = max(force, 0.0)
        velocity -= force * step / drill.free_mass
        tip_velocity = 2.0 * arriving + force / upper
        down_1[0] = tip_velocity - arriving
        mass_position += velocity * step
        tip_position += tip_velocity * step
        touching = touching or mass_position >= tip_position
        mass_position = min(mass_position, tip_position)
        greatest = max(greatest, tip_position)
    return -velocity / speed, greatest


@pytest.mark.parametrize("elements", [5, 20])
def test_energy_and_momentum_are_kept(elements):
    bar = strike(DRILL, SPEED, elements)

    assert abs(bar.energy_error) < 1e-5
    assert bar.impulse == pytest.approx(DRILL.free_mass * SPEED * (1.0 + bar.restitution))


def test_the_mesh_converges_to_exact_waves():
    restitution, displacement = waves(DRILL, SPEED, 800, 7e-5)
    coarse, middle, fine = (strike(DRILL, SPEED, elements) for elements in (10, 20, 40))

    errors = [abs(bar.peak_displacement / displacement - 1.0) for bar in (coarse, middle, fine)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.002
    errors = [abs(bar.restitution - restitution) for bar in (coarse, middle, fine)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.05
