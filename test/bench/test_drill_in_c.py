"""The drill in C is a fair anchor: it finds our impacts until roundings part the two."""

import math
import shutil

import pytest

from bench.drill_in_c import DrillInC
from bench.flight import agreeing, first_flight
from rpud_sim.foundation.time import SECOND
from rpud_sim.simulation import preset
from rpud_sim.simulation.simulation import Simulation
from rpud_sim.simulation.statistics import Statistics

pytestmark = pytest.mark.skipif(
    shutil.which("gcc") is None and shutil.which("cc") is None, reason="there is no C compiler"
)


@pytest.fixture(scope="module")
def program():
    with DrillInC() as built:
        yield built


@pytest.mark.parametrize("regime", ["drilling", "free"])
@pytest.mark.parametrize("phase", [0.0, 0.1, 0.45, 0.8])
def test_it_finds_our_impacts(program, regime, phase):
    simulation = Simulation(preset(regime), phase)
    simulation.advance_to(SECOND)
    flight = first_flight(simulation.advance_to(2 * SECOND))
    _, times = program.run(preset(regime), 1.0, flight)
    assert times[0] == pytest.approx(flight.impact_times[0], abs=1e-13)
    # A rounding grows a thousandfold from one impact to the next.
    assert agreeing(flight.impact_times, times) >= 3


@pytest.mark.parametrize(
    ("regime", "names"),
    [
        ("drilling", ("drill_tool_impact_rate", "contact_force_mean", "reacting_force_mean")),
        ("free", ("drill_tool_impact_rate", "impact_velocity_mean", "reacting_force_mean")),
    ],
)
def test_its_statistics_are_ours(program, regime, names):
    simulation = Simulation(preset(regime))
    statistics = Statistics()
    block = simulation.advance_to(60 * SECOND)
    statistics.add(block)
    ours = statistics.figures()
    theirs, _ = program.run(preset(regime), 60.0, first_flight(block))
    for name in names:
        assert math.isclose(theirs[name], ours[name], rel_tol=0.05), name
