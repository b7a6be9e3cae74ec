"""No parameter set hangs: too many events end a run with one line that names the parameters."""

import re

import pytest

from rpud_sim.model.engine import Engine, EngineError
from rpud_sim.model.parameters import preset

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
