"""The elastic bar against exact waves, by the method of characteristics."""

import pytest

from rpud_sim.simulation import preset
from validation.elastic_bar import WAVE_STEPS, strike, strike_by_waves

# The meshes take seconds.
pytestmark = pytest.mark.extended

DRILL = preset("drilling").replace(gravity=0.0)
SPEED = 5.0


@pytest.mark.parametrize("elements", [5, 20])
def test_energy_and_momentum_are_kept(elements):
    bar = strike(DRILL, SPEED, elements)

    assert abs(bar.energy_error) < 1e-5
    assert bar.impulse == pytest.approx(DRILL.free_mass * SPEED * (1.0 + bar.restitution))


def test_the_mesh_converges_to_exact_waves():
    restitution, displacement = strike_by_waves(DRILL, SPEED)
    coarse, middle, fine = (strike(DRILL, SPEED, elements) for elements in (10, 20, 40))

    errors = [abs(bar.peak_displacement / displacement - 1.0) for bar in (coarse, middle, fine)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.002
    errors = [abs(bar.restitution - restitution) for bar in (coarse, middle, fine)]
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.05


@pytest.mark.parametrize("mass", [1e-3, 5e-3, 50e-3])
def test_the_waves_have_converged(mass):
    drill = DRILL.replace(free_mass=mass)
    coarse = strike_by_waves(drill, SPEED, WAVE_STEPS // 4)
    assert strike_by_waves(drill, SPEED) == pytest.approx(coarse, abs=0.02)
