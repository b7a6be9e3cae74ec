"""Records of a trajectory, and free flight by eqs. (10), (17) and (19)."""

import pytest
from scipy.integrate import solve_ivp

from rpud_sim.model.segment import fall


@pytest.mark.parametrize("gravity", [0.0, 1.62, 9.81])
def test_fall_solves_the_equation_of_motion(gravity):
    solution = solve_ivp(
        lambda _, y: (y[1], gravity), (0, 0.3), (-0.01, -2.0), rtol=1e-12, atol=1e-14
    )
    assert fall(-0.01, -2.0, gravity, 0.3) == pytest.approx(solution.y[:, -1], rel=1e-11)
