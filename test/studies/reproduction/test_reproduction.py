"""The tool that Fig. 12 implies gives Fig. 12."""

import numpy as np
import pytest

from rpud_sim.studies.reproduction.reproduction import figure_12_implies


def test_the_tool_that_figure_12_implies_gives_figure_12():
    implied = figure_12_implies()
    free_mass = 5e-3
    rate = np.sqrt(implied["tool_spring_rate"] / (free_mass + implied["tool_mass"]))
    velocity = 5.0 * free_mass / (free_mass + implied["tool_mass"])

    assert velocity / rate == pytest.approx(42e-6)
    assert free_mass * rate * velocity == pytest.approx(1650.0)
