"""No parameter set hangs: too many events end a run with one line that names the parameters."""

import re

import pytest
from drill_configurations import tables
from trajectories import finished

from rpud_sim.model.drill import derive
from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import preset
from rpud_sim.model.tolerances import GREATEST_EFFORT

MICROGRAM = preset("free").replace(free_mass=1e-11)


def failure(parameters, stops):
    """Return why a drill cannot go on that is advanced from stop to stop [us]."""
    engine = Engine(parameters)
    try:
        for stop in stops:
            engine.advance(*divmod(stop * 1e-6, 1.0))
            engine.drain()
    except EngineError as error:
        return str(error)
    pytest.fail("it goes on")


def test_a_microgram_ends_with_one_line_that_names_it_wherever_a_caller_stops():
    text = failure(MICROGRAM, range(0, 3_000_000, 5000))
    assert re.fullmatch(
        r"events exceed their budget of 500000 in a simulated second at [01]\.\d+ s, "
        r"with free_mass = 1e-11 kg \(default: 0\.005\)",
        text,
    )
    assert text == failure(MICROGRAM, range(0, 3_000_000, 1777))


def test_a_burst_of_elastic_bounces_is_no_overload():
    """With no drive, 1000 N cage the free mass between tip and tool: it bounces ever faster."""
    heavy = tables("free").replace(weight_on_bit=1000.0)
    engine = Engine(heavy)
    engine.change(1, 0.0, derive(heavy), (1000.0, 0.0, 16000.0))
    counts = []
    for number in range(1, 51):
        engine.advance(*divmod(1.0 + 0.02 * number, 1.0))
        counts.append(len(finished(engine)[0]))
    assert max(counts) > 1e5
    assert engine._state["effort"][0] < GREATEST_EFFORT
