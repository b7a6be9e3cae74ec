"""The paper's windows, with numbers that earlier versions gave as well."""

import numpy as np
import pytest

from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics
from rpud_sim.studies.reproduction.windows import run_windows


def test_windows_of_the_presets_are_what_they_were():
    members = run_windows(preset("drilling"), np.linspace(-0.1, 0.1, 12))
    means = {name: column.mean() for name, column in members.values.items()}

    assert members.stalled == 0
    assert means["drill_tool_impact_rate"] == pytest.approx(380.0, rel=0.1)
    assert means["kinetic_energy"] == pytest.approx(0.6 * 59.5, rel=0.1)
    assert means["reacting_force_mean"] == pytest.approx(20.5, rel=0.05)


def test_the_papers_mean_reacting_force_has_no_weight_on_bit_behind_it():
    members = run_windows(preset("drilling").replace(weight_on_bit=0.0), np.linspace(-0.1, 0.1, 12))

    assert members.values["reacting_force_mean"].mean() == pytest.approx(14.0, rel=0.05)


@pytest.mark.parametrize("regime", ["free", "drilling"])
def test_the_reacting_force_is_the_impulse_of_the_collisions(regime):
    """What the tool receives in a long run, less the weight of the free mass, the RPUD gives."""
    parameters = preset(regime)
    simulation = Simulation(parameters)
    block = simulation.advance_to(60 * SECOND)
    statistics = Statistics()
    statistics.add(block)

    received = float(block.impacts["impulse"].sum()) / 60.0
    expected = received - parameters.free_mass * parameters.gravity
    assert statistics.figures()["reacting_force_mean"] == pytest.approx(expected, rel=0.01)
